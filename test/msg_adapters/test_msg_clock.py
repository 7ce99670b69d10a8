"""Sensor time to ROS time: offset, drift, jitter, jumps."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from msg_oracles import NS, events_of, rows_of

from msg_adapters import EventMessage, SensorClock, Triggers

STAMP_NS = 1_700_000_000 * NS


def message(stamp_ns, times_ns, *, is_sensor_time=True):
    events = events_of([(t, 1, 2, 1) for t in times_ns], 640, 480)
    return EventMessage(stamp_ns, "c", 0, "evt3", events, is_sensor_time, Triggers.empty(), 0, 0)


def test_the_first_packets_first_event_has_the_headers_stamp():
    assert SensorClock().to_ros(message(STAMP_NS, [1000, 5000])).t.tolist() == [STAMP_NS, STAMP_NS + 4000]


def test_only_the_times_change():
    sent = message(STAMP_NS, [1000])
    assert rows_of(SensorClock().to_ros(sent)) == [(STAMP_NS, 1, 2, 1)]
    assert sent.events.t.tolist() == [1000]


def test_ros_time_stays_as_it_is():
    sent = message(STAMP_NS, [1000], is_sensor_time=False)
    assert SensorClock().to_ros(sent) is sent.events


def test_an_empty_packet_says_nothing_about_the_offset():
    clock = SensorClock()
    assert len(clock.to_ros(message(STAMP_NS, []))) == 0
    assert clock.to_ros(message(STAMP_NS + 5, [0])).t.tolist() == [STAMP_NS + 5]


def test_a_later_arrival_moves_the_offset_by_a_hundredth():
    clock = SensorClock()
    clock.to_ros(message(STAMP_NS, [0]))
    assert clock.to_ros(message(STAMP_NS + 1_100_000, [1_000_000])).t.tolist() == [STAMP_NS + 1_001_000]


def test_the_offset_follows_a_sensor_that_runs_slow():
    clock = SensorClock()
    for k in range(3000):
        times = clock.to_ros(message(STAMP_NS + k * 4_000_400, [k * 4_000_000])).t
    assert abs(int(times[0]) - (STAMP_NS + 2999 * 4_000_400)) < 50_000
    assert clock.resets == 0


@settings(deadline=None, max_examples=50)
@given(st.lists(st.tuples(st.integers(0, 3_000_000), st.integers(-400_000_000, 400_000_000)), min_size=2, max_size=40))
def test_ros_time_does_not_decrease_from_packet_to_packet_whatever_the_jitter(steps):
    clock = SensorClock()
    sensor_ns, found = 0, []
    for step_ns, jitter_ns in steps:
        sensor_ns += step_ns
        found += clock.to_ros(message(STAMP_NS + sensor_ns + jitter_ns, [sensor_ns, sensor_ns + 100])).t.tolist()
        sensor_ns += 100
    assert found == sorted(found)
    assert clock.resets == 0


def test_sensor_time_that_goes_back_more_than_a_second_starts_a_new_offset_and_says_so():
    clock = SensorClock()
    clock.to_ros(message(STAMP_NS, [5 * NS]))
    assert clock.to_ros(message(STAMP_NS + 9, [7])).t.tolist() == [STAMP_NS + 9]
    assert clock.resets == 1


def test_a_bag_that_loops_with_its_stamps_counts_as_a_jump_too():
    clock = SensorClock()
    for _ in range(2):
        for second in (0, 1, 2):
            times = clock.to_ros(message(STAMP_NS + second * NS, [second * NS])).t
            assert times.tolist() == [STAMP_NS + second * NS]
    assert clock.resets == 1


def test_wraps_missed_while_messages_were_lost_count_as_a_jump():
    clock = SensorClock()
    clock.to_ros(message(STAMP_NS, [0]))
    assert clock.to_ros(message(STAMP_NS + 20 * NS, [3 * NS])).t.tolist() == [STAMP_NS + 20 * NS]
    assert clock.resets == 1


def test_a_small_step_back_is_delivered_and_is_no_jump():
    clock = SensorClock()
    clock.to_ros(message(STAMP_NS, [10_000_000]))
    times = clock.to_ros(message(STAMP_NS - 2_000_000, [8_000_000])).t
    assert times.tolist() == [STAMP_NS - 2_000_000]
    assert clock.resets == 0


def test_a_reset_forgets_the_offset_without_counting_a_jump():
    clock = SensorClock()
    clock.to_ros(message(STAMP_NS, [5 * NS]))
    clock.reset()
    assert clock.to_ros(message(STAMP_NS, [0])).t.tolist() == [STAMP_NS]
    assert clock.resets == 0


def test_the_same_messages_give_the_same_times():
    messages = [message(STAMP_NS + k * 1_000_003 + (k * k) % 977, [k * 1_000_000]) for k in range(50)]
    first, second = SensorClock(), SensorClock()
    for sent in messages:
        np.testing.assert_array_equal(first.to_ros(sent).t, second.to_ros(sent).t)


def test_times_that_are_kept_are_never_overwritten():
    clock = SensorClock()
    kept = [clock.to_ros(message(STAMP_NS + k * 1000, [k * 1000])).t for k in range(20)]
    assert [times.tolist() for times in kept] == [[STAMP_NS + k * 1000] for k in range(20)]


def test_message_after_message_is_shifted_without_new_memory():
    clock = SensorClock()
    places = {clock.to_ros(message(STAMP_NS + k * 1000, [k * 1000])).t.ctypes.data for k in range(20)}
    assert len(places) == 1
