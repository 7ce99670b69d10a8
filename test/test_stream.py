"""What StreamGuard promises: streams whose time never decreases, and a reason wherever one ends."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.events import Events
from etd_ros.parameters import ParameterError
from etd_ros.stream import RESTARTS_MAX, Restart, StreamBatch, StreamConfig, StreamGuard

MS = 1_000_000


def events_at(*times_ns: int, width: int = 8, height: int = 6) -> Events:
    n = len(times_ns)
    x = (np.arange(n) % width).astype(np.uint16)
    return Events(np.array(times_ns, np.int64), x, np.zeros(n, np.uint16), np.ones(n, np.uint8), width, height)


def times(batches: list[StreamBatch]) -> list[list[int]]:
    return [batch.events.t.tolist() for batch in batches]


def test_a_clean_batch_is_handed_on_as_it_is():
    events = events_at(1, 2, 2, 9)
    (batch,) = StreamGuard().feed(events)
    assert batch.events is events
    assert batch.restart is None


def test_an_empty_batch_yields_nothing():
    assert list(StreamGuard().feed(events_at())) == []


def test_a_small_step_back_inside_a_batch_is_clamped_and_counted():
    guard = StreamGuard()
    batches = list(guard.feed(events_at(10 * MS, 8 * MS, 9 * MS, 11 * MS)))
    assert times(batches) == [[10 * MS, 10 * MS, 10 * MS, 11 * MS]]
    assert guard.counters.clamped_events == 2
    assert guard.counters.restarts == 0


def test_a_small_step_back_across_batches_is_clamped_and_counted():
    guard = StreamGuard()
    list(guard.feed(events_at(10 * MS)))
    (batch,) = guard.feed(events_at(8 * MS, 12 * MS))
    assert batch.events.t.tolist() == [10 * MS, 12 * MS]
    assert batch.restart is None
    assert guard.counters.clamped_events == 1


def test_clamping_leaves_the_callers_array_alone():
    events = events_at(10, 5)
    list(StreamGuard().feed(events))
    assert events.t.tolist() == [10, 5]


def test_a_long_step_back_starts_a_new_stream_at_that_event():
    guard = StreamGuard()
    batches = list(guard.feed(events_at(500 * MS, 600 * MS, 100 * MS, 110 * MS)))
    assert times(batches) == [[500 * MS, 600 * MS], [100 * MS, 110 * MS]]
    assert [batch.restart for batch in batches] == [None, Restart.TIME_STEP_BACK]
    assert guard.counters.restarts == 1


def test_a_long_step_back_between_batches_starts_a_new_stream():
    guard = StreamGuard()
    list(guard.feed(events_at(500 * MS)))
    (batch,) = guard.feed(events_at(100 * MS))
    assert batch.restart is Restart.TIME_STEP_BACK


def test_the_longest_step_back_is_a_parameter_and_inclusive():
    guard = StreamGuard(StreamConfig(step_back_max_s=0.01))
    batches = list(guard.feed(events_at(20 * MS, 10 * MS, 10 * MS - 1)))
    assert times(batches) == [[20 * MS, 20 * MS], [10 * MS - 1]]
    with pytest.raises(ParameterError, match="step_back_max_s"):
        StreamConfig(step_back_max_s=-1.0)


def test_a_batch_of_senseless_times_starts_few_streams_and_loses_nothing():
    guard = StreamGuard()
    batches = list(guard.feed(events_at(*[0, 1000 * MS] * 500)))
    assert guard.counters.restarts == RESTARTS_MAX
    assert sum(len(batch.events) for batch in batches) == 1000
    assert all((np.diff(batch.events.t) >= 0).all() for batch in batches)
    (batch,) = guard.feed(events_at(5 * MS, 6 * MS))
    assert batch.restart is Restart.TIME_STEP_BACK
    assert batch.events.t.tolist() == [5 * MS, 6 * MS]


def test_a_gap_in_the_sequence_starts_a_new_stream_and_counts_what_was_lost():
    guard = StreamGuard()
    list(guard.feed(events_at(1), seq=4))
    assert [batch.restart for batch in guard.feed(events_at(2), seq=5)] == [None]
    assert [batch.restart for batch in guard.feed(events_at(3), seq=9)] == [Restart.GAP]
    assert guard.counters.gaps == 1
    assert guard.counters.lost_messages == 3


def test_messages_that_were_dropped_on_the_way_to_it_are_no_losses():
    guard = StreamGuard()
    list(guard.feed(events_at(1), seq=4))
    assert [batch.restart for batch in guard.feed(events_at(2), seq=7, dropped=2)] == [Restart.DROPPED]
    assert (guard.counters.gaps, guard.counters.lost_messages) == (0, 0)
    assert [batch.restart for batch in guard.feed(events_at(3), seq=13, dropped=2)] == [Restart.GAP]
    assert (guard.counters.gaps, guard.counters.lost_messages) == (1, 3)
    assert [batch.restart for batch in guard.feed(events_at(4), seq=14, dropped=2)] == [None]


def test_a_sequence_that_starts_again_is_a_gap_of_unknown_length():
    guard = StreamGuard()
    list(guard.feed(events_at(1), seq=100))
    assert [batch.restart for batch in guard.feed(events_at(2), seq=0)] == [Restart.GAP]
    assert guard.counters.lost_messages == 0


def test_a_loop_of_numbered_messages_is_a_step_back_and_not_a_loss():
    guard = StreamGuard()
    list(guard.feed(events_at(1000 * MS), seq=9))
    (batch,) = guard.feed(events_at(1 * MS), seq=0)
    assert batch.restart is Restart.TIME_STEP_BACK
    assert guard.counters.lost_messages == 0


def test_a_senseless_sequence_number_does_not_count_as_losses():
    guard = StreamGuard()
    list(guard.feed(events_at(1 * MS), seq=1))
    (batch,) = guard.feed(events_at(2 * MS), seq=2**60)
    assert batch.restart is Restart.GAP
    assert guard.counters.lost_messages == 0


def test_a_gap_before_an_empty_batch_restarts_with_the_next_event():
    guard = StreamGuard()
    list(guard.feed(events_at(1), seq=1))
    assert list(guard.feed(events_at(), seq=3)) == []
    assert [batch.restart for batch in guard.feed(events_at(2), seq=4)] == [Restart.GAP]
    assert guard.counters.restarts == 1


def test_a_new_sensor_size_or_encoding_starts_a_new_stream():
    guard = StreamGuard()
    list(guard.feed(events_at(1), encoding="evt3"))
    assert [batch.restart for batch in guard.feed(events_at(2), encoding="mono")] == [Restart.ENCODING]
    assert [batch.restart for batch in guard.feed(events_at(3, width=9), encoding="mono")] == [Restart.SIZE]
    assert guard.counters.restarts == 2


def test_a_new_size_is_told_also_where_a_gap_came_with_it():
    guard = StreamGuard()
    list(guard.feed(events_at(1), seq=1))
    assert [batch.restart for batch in guard.feed(events_at(2, height=9), seq=7)] == [Restart.SIZE]


def test_after_a_restart_time_may_be_earlier_without_a_second_restart():
    guard = StreamGuard()
    list(guard.feed(events_at(900 * MS), seq=1))
    (batch,) = guard.feed(events_at(0), seq=9)
    assert batch.restart is Restart.GAP
    assert batch.events.t.tolist() == [0]
    assert guard.counters.restarts == 1


def oracle(batches: list[list[int]], step_back_max_ns: int) -> list[list[int]]:
    """The streams, one event at a time."""
    streams: list[list[int]] = []
    for t in (t for batch in batches for t in batch):
        if not streams or streams[-1][-1] - t > step_back_max_ns:
            streams.append([t])
        else:
            streams[-1].append(max(t, streams[-1][-1]))
    return streams


@settings(deadline=None, max_examples=100)
@given(st.lists(st.lists(st.integers(0, 40), max_size=8), max_size=8))
def test_streams_do_not_depend_on_the_cut_into_batches(batches):
    guard = StreamGuard(StreamConfig(step_back_max_s=10e-9))
    streams: list[list[int]] = []
    for batch in batches:
        for part in guard.feed(events_at(*batch)):
            if part.restart is not None or not streams:
                streams.append([])
            streams[-1].extend(part.events.t.tolist())
    assert streams == oracle(batches, 10)
    assert guard.counters.restarts == max(len(streams) - 1, 0)
