"""The contour tracker's kernels against what they say they do, in NumPy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from etd_ros.tracking.contour_kernels import (
    DENSITY,
    GRADIENT_X,
    GRADIENT_Y,
    MAPS,
    RIDGE,
    WEIGHT,
    blur,
    coherence,
    gather,
    keep_times,
    learn,
    measure_norms,
    normalise,
    parabola,
    score_at,
    search,
    splat,
)

ROWS, COLUMNS = 20, 24
STILL = np.zeros(2)
UPRIGHT = np.array([30.0, 40.0, 1.0, 0.0])


def points_at(x, y, polarity=1.0, age_s=0.0):
    x, y = np.broadcast_arrays(np.asarray(x, np.float32), np.asarray(y, np.float32))
    return np.stack([x, y, np.full_like(x, age_s), np.full_like(x, polarity)], axis=1).astype(np.float32)


def cross(x, y):
    """Points on two lines that cross at (x, y)."""
    reach = np.arange(-7, 8)
    return np.concatenate([points_at(x + reach, np.full(15, y)), points_at(np.full(15, x), y + reach)])


def model_of(points, pose, direction):
    """Maps that have learnt these points."""
    maps = np.zeros((MAPS, ROWS, COLUMNS), np.float32)
    maps[WEIGHT] = 1
    drawn = np.zeros((2, ROWS, COLUMNS), np.float32)
    splat(points, len(points), pose, 1.0, STILL, drawn)
    normalise(drawn, np.zeros_like(drawn), maps[WEIGHT], 1.0)
    learn(maps, drawn, np.array(direction, float), 1.0)
    norms = np.zeros(4)
    measure_norms(maps, norms)
    return maps, norms


@settings(deadline=None)
@given(arrays.arrays(np.uint8, (6, 7, 2)), st.integers(0, 6), st.integers(0, 6), st.integers(0, 7), st.integers(0, 7))
def test_levels_become_times_in_the_window_and_nowhere_else(data, top, bottom, left, right):
    times = np.full((6, 7, 2), -1, np.int64)
    count = keep_times(times, data, 1000, 255_000, top, bottom, left, right)
    expected = np.full_like(times, -1)
    inside = np.zeros_like(data, bool)
    inside[top:bottom, left:right] = True
    fired = inside & (data > 0)
    expected[fired] = 1000 + data[fired].astype(np.int64) * 1000
    np.testing.assert_array_equal(times, expected)
    assert count == np.count_nonzero(fired)


def test_points_are_the_events_young_enough_with_their_ages_and_polarities():
    times = np.full((4, 5, 2), -1, np.int64)
    times[1, 2, 0], times[3, 4, 1], times[0, 0, 0] = 900, 1000, 100
    points = np.zeros((8, 4), np.float32)
    assert gather(times, 1000, 500, 0, 4, 0, 5, points) == 2
    np.testing.assert_allclose(points[:2], [[2.5, 1.5, 1e-7, 1.0], [4.5, 3.5, 0.0, -1.0]])


def test_more_points_than_there_is_room_for_are_left_out():
    times = np.full((4, 5, 2), 1000, np.int64)
    points = np.zeros((8, 4), np.float32)
    assert gather(times, 1000, 500, 0, 4, 0, 5, points[:7]) == 7
    np.testing.assert_array_equal(points[7], 0)


@settings(deadline=None)
@given(x=st.floats(20.5, 39), y=st.floats(32, 48), scale=st.floats(0.5, 2.0), angle=st.floats(-3, 3))
def test_a_drawn_point_weighs_one_in_all_round_its_place(x, y, scale, angle):
    drawn = np.zeros((2, ROWS, COLUMNS), np.float32)
    pose = np.array([30.0, 40.0, scale, angle])
    inside = splat(points_at([x], [y]), 1, pose, 1.0, STILL, drawn)
    assert drawn.sum() == pytest.approx(inside, abs=1e-4)
    if inside:
        turned = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]) @ [x - 30, y - 40] / scale
        columns, rows = drawn[0].sum(axis=0) @ np.arange(COLUMNS), drawn[0].sum(axis=1) @ np.arange(ROWS)
        np.testing.assert_allclose([columns, rows], turned + np.array([COLUMNS - 1, ROWS - 1]) / 2, atol=1e-3)


def test_smoothing_is_a_gaussian_of_one_cell_inside():
    drawn = np.zeros((2, ROWS, COLUMNS), np.float32)
    drawn[1, 10, 12] = 1
    blur(drawn, np.zeros_like(drawn))
    kernel = np.array([1, 4, 6, 4, 1]) / 16
    np.testing.assert_allclose(drawn[1, 8:13, 10:15], np.outer(kernel, kernel), atol=1e-6)
    assert drawn[0].max() == 0


@settings(deadline=None)
@given(st.floats(-0.49, 0.49), st.floats(0.1, 10))
def test_a_parabola_has_its_top_where_it_was_made(top, steepness):
    values = [-steepness * (x - top) ** 2 for x in (-1, 0, 1)]
    assert parabola(*values) == pytest.approx(top, abs=1e-6)


def test_what_has_no_top_is_left_in_the_middle():
    assert parabola(2.0, 1.0, 2.0) == 0


@settings(deadline=None)
@given(dx=st.floats(-3.4, 3.4), dy=st.floats(-3.4, 3.4))
def test_a_shape_is_found_where_it_went_between_pixels(dx, dy):
    maps, norms = model_of(cross(30.0, 40.0), UPRIGHT, (1, 0))
    points = cross(30 + dx, 40 + dy)
    found = search(
        points, len(points), maps, norms, UPRIGHT, 1.0, STILL, np.array([4.0, 0.0]), UPRIGHT, 0.5, False, 1.0,
        np.zeros((9, 9, 4)),
    )  # fmt: skip
    np.testing.assert_allclose(found, [30 + dx, 40 + dy], atol=0.7)


def test_the_way_back_shows_the_other_polarity():
    points = cross(30.0, 40.0)
    maps, norms = model_of(points, UPRIGHT, (1, 0))
    back = points.copy()
    back[:, 3] *= -1

    def score(points, motion_x, any_motion=False):
        motion = np.array([motion_x, 0.0])
        return score_at(points, len(points), maps, norms, UPRIGHT, 1.0, STILL, motion, 0.5, any_motion)[0]

    assert score(points, 1.0) == pytest.approx(score(back, -1.0))
    assert score(back, 1.0) < 0.5 * score(points, 1.0)
    assert score(back, 1.0, any_motion=True) == pytest.approx(score(points, 1.0), rel=0.1)


def test_only_the_gradient_along_the_motion_is_learnt():
    maps, _ = model_of(cross(30.0, 40.0), UPRIGHT, (1, 0))
    assert np.abs(maps[GRADIENT_X]).max() > 0
    assert np.abs(maps[GRADIENT_Y]).max() == 0
    assert maps[RIDGE].sum() == pytest.approx(0, abs=1e-3)
    assert maps[DENSITY].min() >= 0


def agreement_of(points, velocity, time_s=0.03):
    weight, parts = np.ones((ROWS, COLUMNS), np.float32), np.zeros((4, 2, ROWS, COLUMNS), np.float32)
    velocity = np.array(velocity, float)
    return coherence(points, len(points), weight, UPRIGHT, 1.0, velocity, time_s, parts, np.zeros_like(parts[0]))


def test_events_agree_best_for_the_right_motion():
    rng = np.random.default_rng(3)
    start, elapsed_s = np.round(rng.uniform(-6, 6, (300, 2)) / 4) * 4, rng.uniform(0, 0.03, 300)
    moved = start + np.array([200.0, -100.0]) * elapsed_s[:, None] + [30, 40]
    points = np.column_stack([moved, -elapsed_s, np.ones(300)]).astype(np.float32)
    speeds = [(x, y) for x in range(-400, 401, 100) for y in range(-400, 401, 100)]
    assert speeds[int(np.argmax([agreement_of(points, speed) for speed in speeds]))] == (200, -100)


def test_what_a_single_part_of_the_time_draws_agrees_with_nothing():
    once = points_at(np.linspace(25, 35, 100), 40.0, age_s=-0.001)
    assert agreement_of(once, (0, 0)) == 0
    often = np.concatenate([points_at(np.linspace(25, 35, 25), 40.0, age_s=-age_s) for age_s in (0, 0.01, 0.02, 0.029)])
    assert agreement_of(often, (0, 0)) > 1


def test_opposite_polarities_disagree():
    turned = np.concatenate([points_at([30.0], 40.0, 1 - 2 * (part % 2), -0.01 * part) for part in (0, 1)])
    assert agreement_of(turned.reshape(-1, 4), (0, 0)) < 0
