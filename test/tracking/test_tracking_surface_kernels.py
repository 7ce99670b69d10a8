"""The surface's kernels against what they say they do, in NumPy."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from etd_ros.tracking.surface_kernels import (
    count_within,
    fired_count,
    keep_more_times,
    keep_times,
    kept_count,
    kept_points,
)


@settings(deadline=None)
@given(
    *(arrays.arrays(np.uint8, (6, 70, 2)), st.integers(0, 6), st.integers(0, 6), st.integers(0, 70)),
    st.integers(0, 70),
)
def test_levels_become_times_in_the_window_and_nowhere_else(data, top, bottom, left, right):
    times = np.full((6, 70, 2), -1, np.int64)
    count = keep_times(times.reshape(6, -1), data.reshape(6, -1), 1000, 255_000, top, bottom, left, right)
    expected = np.full_like(times, -1)
    inside = np.zeros_like(data, bool)
    inside[top:bottom, left:right] = True
    fired = inside & (data > 0)
    expected[fired] = 1000 + data[fired].astype(np.int64) * 1000
    np.testing.assert_array_equal(times, expected)
    assert count == np.count_nonzero(fired)


windows = st.tuples(*[st.integers(0, size) for size in (6, 6, 70, 70)]).map(
    lambda edges: (*sorted(edges[:2]), *sorted(edges[2:]))
)


@settings(deadline=None)
@given(arrays.arrays(np.uint8, (6, 70, 2)), st.lists(windows, max_size=5))
def test_windows_that_overlap_are_kept_as_if_each_was_alone(data, windows):
    times, expected = np.full((2, 6, 140), -1, np.int64)
    levels, kept = data.reshape(6, -1), np.zeros((6, 2), np.int64)
    for window in windows:
        keep_more_times(times, levels, 1000, 255_000, *window, kept)
        keep_times(expected, levels, 1000, 255_000, *window)
    np.testing.assert_array_equal(times, expected)


def test_points_are_the_events_young_enough_with_their_ages_and_polarities():
    times = np.full((4, 5, 2), -1, np.int64)
    times[1, 2, 0], times[3, 4, 1], times[0, 0, 0] = 900, 1000, 100
    points = np.zeros((8, 4), np.float32)
    assert kept_points(times, 1000, 500, 0, 4, 0, 5, points) == 2
    np.testing.assert_allclose(points[:2], [[2.5, 1.5, 1e-7, 1.0], [4.5, 3.5, 0.0, -1.0]])


def test_more_points_than_there_is_room_for_are_left_out():
    times = np.full((4, 5, 2), 1000, np.int64)
    points = np.zeros((8, 4), np.float32)
    assert kept_points(times, 1000, 500, 0, 4, 0, 5, points[:7]) == 7
    np.testing.assert_array_equal(points[7], 0)


@settings(deadline=None)
@given(arrays.arrays(np.int64, (6, 70, 2), elements=st.integers(0, 9)), windows, windows)
def test_events_are_counted_in_a_window_of_the_surface_or_of_points(times, window, wide):
    top, bottom, left, right = window
    inside = times[top:bottom, left:right]
    assert kept_count(times.reshape(6, -1), 8, 3, *window) == np.count_nonzero((inside > 3) & (inside <= 8))
    points = np.zeros((times.size, 4), np.float32)
    count = kept_points(times, 9, 3, *wide, points)
    columns, rows = np.floor(points[:count, :2]).T
    within = (columns >= left) & (columns < right) & (rows >= top) & (rows < bottom)
    assert count_within(points, count, *window) == np.count_nonzero(within)


@settings(deadline=None)
@given(arrays.arrays(np.uint8, (6, 70, 2)), windows)
def test_a_frames_event_pixels_are_counted_in_a_window(data, window):
    top, bottom, left, right = window
    assert fired_count(data.reshape(6, -1), *window) == np.count_nonzero(data[top:bottom, left:right])
