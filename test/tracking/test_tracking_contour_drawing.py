"""The contour tracker's drawing kernels against what they say they do, in NumPy."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.tracking.contour_drawing import (
    COHERENCE_FLOOR,
    CROWDING_POWER,
    agreements,
    blur,
    climbed,
    coherence,
    learn,
    most_coherent,
    normalise,
    room_for_parts,
    splat,
)
from etd_ros.tracking.contour_kernels import DENSITY, GRADIENT_X, GRADIENT_Y, MAPS, RIDGE, WEIGHT

ROWS, COLUMNS = 20, 24
STILL = np.zeros(4)
UPRIGHT = np.array([30.0, 40.0, 1.0, 0.0])


def points_at(x, y, polarity=1.0, age_s=0.0):
    x, y = np.broadcast_arrays(np.asarray(x, np.float32), np.asarray(y, np.float32))
    return np.stack([x, y, np.full_like(x, age_s), np.full_like(x, polarity)], axis=1).astype(np.float32)


def drawn_and_normalised(points):
    drawn = np.zeros((2, ROWS, COLUMNS), np.float32)
    splat(points, len(points), UPRIGHT, 1.0, STILL, drawn)
    normalise(drawn, np.zeros_like(drawn), np.ones((ROWS, COLUMNS), np.float32), 1.0)
    return drawn


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


def test_only_the_gradient_along_the_motion_is_learnt():
    maps = np.zeros((MAPS, ROWS, COLUMNS), np.float32)
    maps[WEIGHT] = 1
    learn(maps, drawn_and_normalised(points_at(np.arange(23.0, 38.0), 40.0)), np.array([1.0, 0.0, 0.0, 0.0]), 1.0)
    assert np.abs(maps[GRADIENT_X]).max() > 0
    assert np.abs(maps[GRADIENT_Y]).max() == 0
    assert maps[RIDGE].sum() == pytest.approx(0, abs=1e-3)
    assert maps[DENSITY].min() >= 0


def test_what_turns_teaches_each_place_the_gradient_along_its_own_way():
    maps = np.zeros((MAPS, ROWS, COLUMNS), np.float32)
    maps[WEIGHT] = 1
    drawn = np.zeros((2, ROWS, COLUMNS), np.float32)
    drawn[0, 2, 11], drawn[1, 17, 11] = 1.0, 1.0
    learn(maps, drawn, np.array([0.0, 0.0, 0.1, 0.0]), 1.0)
    # Above the middle things move to the right, below it to the left: one slope explains both.
    assert maps[GRADIENT_X, 2, 11] > 0.1
    assert maps[GRADIENT_X, 17, 11] == pytest.approx(maps[GRADIENT_X, 2, 11], rel=1e-5)
    again = maps.copy()
    learn(again, drawn, np.array([0.0, 0.0, 0.1, 0.0]), 1.0)
    assert abs(0.75 * again[GRADIENT_X, 2, 11] - 1) < abs(0.75 * maps[GRADIENT_X, 2, 11] - 1)


def test_points_of_what_turns_and_grows_are_drawn_where_they_are_now():
    drawn = np.zeros((2, ROWS, COLUMNS), np.float32)
    splat(points_at([36.0], [40.0], age_s=0.1), 1, UPRIGHT, 1.0, np.array([10.0, 0.0, 1.0, -2.0]), drawn)
    columns, rows = drawn[0].sum(axis=0) @ np.arange(COLUMNS), drawn[0].sum(axis=1) @ np.arange(ROWS)
    # 7 px to the right of the middle after moving; a fifth nearer, and a tenth of 7 px down.
    np.testing.assert_allclose([columns, rows], [5.6 + (COLUMNS - 1) / 2, 0.7 + (ROWS - 1) / 2], atol=1e-4)


def agreement_of(points, velocity, time_s=0.03):
    weight, room = np.ones((ROWS, COLUMNS), np.float32), room_for_parts(4, ROWS, COLUMNS)
    velocity, shares = np.array(velocity, float), np.ones(len(points), np.float32)
    return coherence(points, len(points), shares, weight, UPRIGHT, 1.0, velocity, time_s, room)


def points_often():
    """The same line in each part of the time."""
    return np.concatenate([points_at(np.linspace(25, 35, 25), 40.0, age_s=-age_s) for age_s in (0, 0.01, 0.02, 0.029)])


def test_events_agree_best_for_the_right_motion():
    rng = np.random.default_rng(3)
    start, elapsed_s = np.round(rng.uniform(-6, 6, (300, 2)) / 4) * 4, rng.uniform(0, 0.03, 300)
    moved = start + np.array([200.0, -100.0]) * elapsed_s[:, None] + [30, 40]
    points = np.column_stack([moved, -elapsed_s, np.ones(300)]).astype(np.float32)
    speeds = [(x, y) for x in range(-400, 401, 100) for y in range(-400, 401, 100)]
    assert speeds[int(np.argmax([agreement_of(points, speed)[0] for speed in speeds]))] == (200, -100)


def test_what_a_single_part_of_the_time_draws_agrees_with_nothing():
    once = points_at(np.linspace(25, 35, 100), 40.0, age_s=-0.001)
    assert agreement_of(once, (0, 0)) == (0, 0)
    assert agreement_of(points_often(), (0, 0))[0] > 1


def test_parts_that_draw_the_same_are_alike_and_those_of_noise_are_not():
    assert agreement_of(points_often(), (0, 0))[1] == pytest.approx(1.0)
    rng = np.random.default_rng(2)
    x, y = rng.uniform((22, 32), (38, 48), (60, 2)).T
    ages_s, polarities = -rng.uniform(0, 0.03, 60), rng.choice([-1, 1], 60)
    assert agreement_of(np.column_stack([x, y, ages_s, polarities]).astype(np.float32), (0, 0))[1] < 0.3


def test_opposite_polarities_disagree():
    turned = np.concatenate([points_at([30.0], 40.0, 1 - 2 * (part % 2), -0.01 * part) for part in (0, 1)])
    assert max(agreement_of(turned.reshape(-1, 4), (0, 0))) < 0


def test_events_that_count_for_nothing_agree_with_nothing():
    weight, room = np.ones((ROWS, COLUMNS), np.float32), room_for_parts(4, ROWS, COLUMNS)
    shares, velocity = np.zeros(100, np.float32), np.zeros(2)
    agreement = coherence(points_often(), 100, shares, weight, UPRIGHT, 1.0, velocity, 0.03, room)
    assert agreement == (0, 0)


def parts_by_definition(points, shares, velocity, time_s):
    """On and Off of four parts of a time, drawn one by one and smoothed, shape (4, 2, ROWS, COLUMNS)."""
    parts = np.zeros((4, 2, ROWS, COLUMNS), np.float32)
    for (x, y, age_s, polarity), share in zip(points, shares, strict=True):
        column = x + velocity[0] * age_s - UPRIGHT[0] + (COLUMNS - 1) / 2
        row = y + velocity[1] * age_s - UPRIGHT[1] + (ROWS - 1) / 2
        if not (0 <= column < COLUMNS - 1 and 0 <= row < ROWS - 1):
            continue
        layer = parts[min(3, int(-age_s / time_s * 4)), 0 if polarity > 0 else 1]
        for r, c in itertools.product((int(row), int(row) + 1), (int(column), int(column) + 1)):
            layer[r, c] += share * (1 - abs(row - r)) * (1 - abs(column - c))
    for part in parts:
        blur(part, np.zeros_like(part))
    return parts


def product_by_definition(weight, part, other):
    alike = (part[0] - part[1] / 2) * other[0] + (part[1] - part[0] / 2) * other[1]
    return np.sum(weight**2 * alike, dtype=float)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 200))
def test_coherence_is_that_of_its_definition(seed, count):
    rng = np.random.default_rng(seed)
    points = np.column_stack([
        rng.uniform(15, 45, count), rng.uniform(25, 55, count), -rng.uniform(0, 0.03, count), rng.choice([-1, 1], count)
    ]).astype(np.float32)  # fmt: skip
    weight, shares = rng.uniform(0, 1, (ROWS, COLUMNS)).astype(np.float32), rng.uniform(0, 1, count).astype(np.float32)
    velocity, room = rng.uniform(-100, 100, 2), room_for_parts(4, ROWS, COLUMNS)
    parts = parts_by_definition(points, shares, velocity, 0.03)
    pairs = list(itertools.combinations(parts, 2))
    found = sum(product_by_definition(weight, *pair) for pair in pairs)
    own = [product_by_definition(weight, part, part) for part in parts]
    possible = sum(math.sqrt(one * other) for one, other in itertools.combinations(own, 2))
    agreement, alike = coherence(points, count, shares, weight, UPRIGHT, 1.0, velocity, 0.03, room)
    assert agreement == pytest.approx(found / (possible + COHERENCE_FLOOR) ** CROWDING_POWER, rel=1e-3, abs=1e-4)
    assert alike * possible == pytest.approx(found, rel=1e-3, abs=1e-3 * possible + 1e-6)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), number=st.integers(1, 20))
def test_the_most_coherent_of_some_velocities_is_the_first_that_agrees_best(seed, number):
    rng = np.random.default_rng(seed)
    points = np.column_stack([
        rng.uniform(20, 40, 100), rng.uniform(30, 50, 100), -rng.uniform(0, 0.03, 100), rng.choice([-1, 1], 100)
    ]).astype(np.float32)  # fmt: skip
    velocities = np.repeat(rng.uniform(-60, 60, (number, 2)), 2, axis=0)
    weight, room = np.ones((ROWS, COLUMNS), np.float32), room_for_parts(4, ROWS, COLUMNS)
    best, agreement, alike = most_coherent(
        points, np.ones(100, np.float32), weight, UPRIGHT, 1.0, velocities, 0.03, 0.01, room
    )
    agreements = [
        agreement_of(points, velocity)[0] * math.exp(-0.01 * 0.03 * math.hypot(*velocity)) for velocity in velocities
    ]
    assert best % 2 == 0
    assert agreement == pytest.approx(max(agreements), rel=1e-6)
    assert agreements[best] == pytest.approx(agreement, rel=1e-6)
    assert alike == pytest.approx(agreement_of(points, velocities[best])[1], rel=1e-6)


def climbed_by_definition(points, so_far, middle, step_px, reach, change_weight, rest_weight):
    found = {}
    top, best = None, (0, 0)
    while best != top:
        top = best
        near = [range(max(at - 1, -reach), min(at + 1, reach) + 1) for at in top]
        for step in itertools.product(*near):
            if step not in found:
                velocity = middle + np.array(step) * (step_px / 0.03)
                rest = math.exp(-rest_weight * 0.03 * math.hypot(*velocity))
                change = math.exp(-change_weight * (0.03 * math.dist(velocity, so_far)) ** 2)
                found[step] = agreement_of(points, velocity)[0] * rest * change, velocity
        best = max(found, key=lambda step: found[step][0])
    return found[best][1]


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), reach=st.integers(0, 3))
def test_the_best_velocity_is_climbed_to_as_its_definition_says(seed, reach):
    rng = np.random.default_rng(seed)
    texture, which = rng.uniform((20, 30), (40, 50), (20, 2)), rng.integers(0, 20, 150)
    ages_s, moving = -rng.uniform(0, 0.03, 150), rng.uniform(-60, 60, 2)
    places = texture[which] - np.outer(ages_s, moving)
    points = np.column_stack([places, ages_s, rng.choice([-1, 1], 20)[which]]).astype(np.float32)
    so_far, middle = rng.uniform(-60, 60, (2, 2))
    expected = climbed_by_definition(points, so_far, middle, 0.5, reach, 0.001, 0.01)
    weight, shares = np.ones((ROWS, COLUMNS), np.float32), np.ones(150, np.float32)
    *velocity, agreement, alike = climbed(
        points, shares, weight, UPRIGHT, 1.0, so_far, middle, 0.5, reach, 0.03, 0.001, 0.01,
        room_for_parts(4, ROWS, COLUMNS),
    )  # fmt: skip
    assert velocity == pytest.approx(expected)
    plain, alike_there = agreement_of(points, np.array(velocity))
    assert agreement == pytest.approx(plain * math.exp(-0.01 * 0.03 * math.hypot(*velocity)), rel=1e-6)
    assert alike == pytest.approx(alike_there, rel=1e-6)


def test_each_event_agrees_with_those_of_other_times_that_move_like_it():
    ages_s = -np.repeat([0.001, 0.01, 0.02, 0.029], 3)
    start = np.tile([22.0, 29.0, 36.0], 4)
    moving, still = (
        np.column_stack([start - speed * ages_s, np.full(12, row), ages_s, np.ones(12)]).astype(np.float32)
        for speed, row in ((200.0, 36.0), (0.0, 44.0))
    )
    beside = points_at([1000.0], [40.0], age_s=-0.01)
    points = np.concatenate([moving, still, beside])
    agreed = np.full(25, np.nan, np.float32)
    velocity = np.array([200.0, 0.0])
    agreements(points, 25, UPRIGHT, 1.0, velocity, 0.03, COLUMNS, room_for_parts(4, ROWS, COLUMNS), agreed)
    assert agreed[:12].mean() > 2 * agreed[12:24].mean()
    assert agreed[24] == 0
