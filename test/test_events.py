"""Events: the one in-memory form."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd_ros.events import EVENT_DTYPE, Events, EventsError, check_pixel_map, check_sensor_size, concatenate


def make_events(times, width=10, height=8):
    n = len(times)
    x = np.arange(n, dtype=np.uint16) % width
    y = np.arange(n, dtype=np.uint16) % height
    return Events(np.array(times, np.int64), x, y, np.arange(n, dtype=np.uint8) % 2, width, height)


@given(st.lists(st.integers(0, 10**15), max_size=50).map(sorted))
def test_structured_events_come_back_unchanged(times):
    events = make_events(times)
    again = Events.from_structured(events.to_structured(), 10, 8)
    for name in ("t", "x", "y", "p"):
        np.testing.assert_array_equal(getattr(again, name), getattr(events, name))


@given(st.lists(st.integers(0, 1000), max_size=50).map(sorted), st.integers(0, 1000), st.integers(0, 1000))
def test_between_takes_the_half_open_interval(times, start, end):
    taken = make_events(times).between(start, end)
    assert taken.t.tolist() == [t for t in times if start <= t < end]


def test_events_are_frozen_and_can_be_replaced_field_by_field():
    events = make_events(range(3))
    for field in dataclasses.fields(events):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(events, field.name, None)
        replaced = dataclasses.replace(events, **{field.name: "new"})
        for other in dataclasses.fields(events):
            expected = "new" if other is field else getattr(events, other.name)
            assert getattr(replaced, other.name) is expected


def test_slices_are_views_and_concatenation_restores_the_whole():
    events = make_events(range(20))
    parts = [events[:7], events[7:7], events[7:]]
    assert np.shares_memory(parts[0].t, events.t)
    assert concatenate(parts).t.tolist() == events.t.tolist()


def test_batches_of_different_sensors_are_not_concatenated():
    with pytest.raises(EventsError, match="one sensor size"):
        concatenate([Events.empty(10, 8), Events.empty(8, 10)])
    with pytest.raises(EventsError, match="at least one"):
        concatenate([])


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [("t", -5, "decreases at event 2"), ("x", 10, "10x8 sensor"), ("y", 8, "10x8 sensor"), ("p", 2, "polarity of 2")],
)
def test_impossible_events_are_refused(field, value, words):
    array = make_events(range(4)).to_structured()
    array[field][2] = value
    with pytest.raises(EventsError, match=words):
        Events.from_structured(array, 10, 8)


def test_a_missing_field_is_named():
    with pytest.raises(EventsError, match="lack the fields p"):
        Events.from_structured(np.zeros(3, [(name, EVENT_DTYPE[name]) for name in ("t", "x", "y")]), 10, 8)


def test_a_wrong_dtype_is_named():
    events = make_events(range(4))
    wrong = Events(events.t.astype(np.float64), events.x, events.y, events.p, 10, 8)
    with pytest.raises(EventsError, match=r"events\.t is float64"):
        wrong.check()


@pytest.mark.parametrize("size", [(0, 5), (5, 0), (65536, 5), (-1, 5)])
def test_impossible_sensor_sizes_are_refused(size):
    with pytest.raises(EventsError, match="impossible"):
        check_sensor_size(*size)


def test_state_is_kept_for_real_sensors_only():
    check_pixel_map(4096, 4096)
    with pytest.raises(EventsError, match="65535x65535 is impossible: no sensor"):
        check_pixel_map(65535, 65535)
