"""The live benchmark's scene as messages: exact rates, times that go on, and a target where it is said to be."""

from __future__ import annotations

import numpy as np
import pytest

from etd_ros.benchmarking.live_packets import ENCODINGS, TIME_HIGH_NS, Packets
from etd_ros.benchmarking.live_scene import NS_PER_US, SENSORS, TURN_US, LiveScene
from etd_ros.benchmarking.streams import BenchmarkError
from etd_ros.stream import StreamGuard
from msg_adapters import Layout, SensorClock, decoder_for

START_NS = 1_700_000_000_000_000_000 // TIME_HIGH_NS * TIME_HIGH_NS
PACKET = "event_camera_msgs/msg/EventPacket"


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize(("rate", "messages_per_s"), [(1_000_000, 100), (4_000_000, 250)])
def test_messages_hold_the_rate_and_their_times_go_on_from_loop_to_loop(sensor, rate, messages_per_s):
    packets = Packets(LiveScene(*sensor), rate, messages_per_s)
    decoder, clock, guard = decoder_for(PACKET, Layout.ROS2), SensorClock(), StreamGuard()
    for number in range(2 * len(packets) + 2):
        message = decoder.decode(packets.message(number, number, START_NS))
        (batch,) = guard.feed(clock.to_ros(message), message.seq, message.encoding)
        since_ns = batch.events.t - (START_NS + number * packets.duration_us * NS_PER_US)
        assert 0 <= since_ns[0] <= since_ns[-1] < packets.duration_us * NS_PER_US
        assert message.stamp_ns == batch.events.t[0]
        assert len(batch.events) == rate // messages_per_s
        assert (message.encoding, message.skipped_words, message.off_sensor) == (ENCODINGS[sensor].name, 0, 0)
    assert (guard.counters.restarts, guard.counters.clamped_events, guard.counters.gaps, clock.resets) == (0, 0, 0, 0)


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_message_is_the_scenes_events(sensor):
    scene, start_us = LiveScene(*sensor), 7 * 4000
    rng = np.random.default_rng(5)
    messages = [scene.events(first_us, 4000, 40_000, rng) for first_us in range(0, start_us + 4000, 4000)]
    expected = messages[-1]
    expected.check()
    packets = Packets(scene, 10_000_000, 250)
    events = SensorClock().to_ros(decoder_for(PACKET, Layout.ROS2).decode(packets.message(7, 7, START_NS)))
    for name in ("x", "y", "p"):
        assert np.array_equal(getattr(events, name), getattr(expected, name))
    assert np.array_equal(events.t - START_NS, expected.t)


@pytest.mark.parametrize("sensor", SENSORS)
def test_the_targets_events_lie_in_its_box_all_the_way_round(sensor):
    scene, rng = LiveScene(*sensor), np.random.default_rng(1)
    centres = []
    for first_us in range(0, 2 * TURN_US, TURN_US // 16):
        events = scene.events(first_us, 10_000, 0, rng)
        box = scene.box(first_us + 5_000)
        assert events.x.min() == pytest.approx(box.x, abs=4)
        assert events.y.min() == pytest.approx(box.y, abs=4)
        assert events.x.max() == pytest.approx(box.x + box.w, abs=4)
        assert events.y.max() == pytest.approx(box.y + box.h, abs=4)
        centres.append(box.center)
    assert np.ptp(np.array(centres), axis=0).min() > box.w
    assert np.allclose(centres[:16], centres[16:])


def test_the_target_is_left_alone_by_the_texture():
    scene = LiveScene(240, 180)
    events = scene.events(0, 4000, 40_000, np.random.default_rng(1))
    right = max(scene.box(time_us).x + scene.box(time_us).w for time_us in range(0, TURN_US, 10_000))
    beside_target = np.count_nonzero(events.x <= right)
    assert beside_target < 0.05 * len(events)


def test_messages_must_last_whole_microseconds():
    with pytest.raises(BenchmarkError, match="300 messages/s do not last whole microseconds"):
        Packets(LiveScene(240, 180), 1e6, 300)
