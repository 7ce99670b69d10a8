"""What moves as one round a target, of events whose motion is known, and on simulated scenes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from etd_ros.evaluation.suite import evaluate_sequence
from etd_ros.simulation.suite import sequence_named
from etd_ros.tracking.backdrop import AGAIN_S, OWN_MIN, SELDOM_S, SPEED_MAX_PX_S, Backdrop
from etd_ros.tracking.backdrop_kernels import ring_shift, smooth

POSE = np.array([80.0, 60.0, 1.0, 0.0])
SIZE = (30.0, 24.0)
SPAN_S = 0.04


def backdrop():
    return Backdrop(SIZE, 1.0, 1.2, 10.0)


def points_of(velocity, *, inner=0.0, outer=1.9, count=1500, pixels=250, seed=1):
    """The events of some pixels beyond `inner` and within `outer` times the box, which fire again and again as they
    move; where they are in the middle of the time."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-outer / 2, outer / 2, (pixels, 2)) * SIZE
    places = places[np.any(np.abs(places) > inner / 2 * np.array(SIZE), axis=1)]
    which, ages_s = rng.integers(0, len(places), count), rng.uniform(0, SPAN_S, count)
    moved = POSE[:2] + places[which] + np.outer(SPAN_S / 2 - ages_s, velocity)
    return np.column_stack([moved, ages_s, np.where(which % 2, 1.0, -1.0)]).astype(np.float32)


def seen(points, looks=2):
    found = backdrop()
    for _ in range(looks):
        found.see(points, len(points), POSE, SPAN_S)
    return found


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (150.0, -60.0), (-220.0, 200.0)])
def test_the_velocity_of_what_is_round_the_target_is_told(velocity):
    found = seen(points_of(velocity))
    assert found.is_known
    assert math.dist(found.velocity, velocity) * SPAN_S < 0.5


def test_what_the_target_itself_does_is_left_out():
    events = np.concatenate([points_of((120.0, 0.0), inner=1.2), points_of((-90.0, 50.0), outer=0.8, seed=2)])
    assert math.dist(seen(events).velocity, (120.0, 0.0)) * SPAN_S < 0.5


@pytest.mark.parametrize("axis", [0, 1])
def test_what_lies_on_one_side_alone_is_no_backdrop(axis):
    events = points_of((150.0, -60.0), inner=1.2)
    is_beside = (events[:, axis] < POSE[axis]) & (np.abs(events[:, 1 - axis] - POSE[1 - axis]) < SIZE[1 - axis] / 3)
    assert not seen(events[is_beside]).is_known


def test_few_events_and_noise_are_none():
    assert not seen(points_of((150.0, 0.0), inner=1.2, count=30)).is_known
    strewn = points_of((0.0, 0.0), count=1500, pixels=100_000)
    assert not seen(strewn).is_known


def test_what_is_lost_from_sight_is_forgotten():
    found = seen(points_of((150.0, 0.0)))
    found.see(points_of((150.0, 0.0), count=10), 10, POSE, SPAN_S)
    assert not found.is_known
    assert found.velocity == (0.0, 0.0)


def test_no_velocity_is_believed_beyond_the_limit():
    found = backdrop()
    found.velocity = SPEED_MAX_PX_S + 100, 0.0
    events = points_of(found.velocity)
    found.see(events, len(events), POSE, SPAN_S)
    assert not found.is_known


def test_a_start_tells_it_by_events_whose_ages_count_back_from_the_start():
    points = points_of((150.0, -60.0))
    points[:, 2] -= np.float32(SPAN_S)
    found = backdrop()
    found.see_start(points, POSE, SPAN_S)
    assert math.dist(found.velocity, (150.0, -60.0)) * SPAN_S < 0.5


def test_the_targets_own_events_are_kept_and_those_of_what_lies_behind_are_not():
    own, behind = points_of((-20.0, 0.0), outer=0.8, count=400, pixels=60, seed=2), points_of((150.0, -60.0))
    found = seen(points_of((150.0, -60.0)))
    order = np.random.default_rng(0).permutation(len(own) + len(behind))
    points, is_own = np.concatenate([own, behind])[order], (np.arange(len(order)) < len(own))[order]
    kept = points[: found.keep_own(points, len(points), POSE, (-20.0, 0.0), SPAN_S)]
    numbers = {tuple(point): mine for point, mine in zip(np.concatenate([own, behind])[order], is_own, strict=True)}
    mine = np.array([numbers[tuple(point)] for point in kept])
    assert mine.sum() > 0.8 * len(own)
    assert (~mine).sum() < 0.25 * len(behind)


def test_all_are_kept_where_a_small_share_would_be_left():
    found, points = seen(points_of((150.0, -60.0))), points_of((150.0, -60.0))
    assert found.keep_own(points, len(points), POSE, (-20.0, 0.0), SPAN_S) == len(points)


def test_all_are_kept_where_both_move_alike_or_nearly_none_would_be_left():
    found = seen(points_of((150.0, -60.0)))
    points = points_of((150.0, -60.0))
    assert found.keep_own(points.copy(), len(points), POSE, (140.0, -60.0), SPAN_S) == len(points)
    few = points[:OWN_MIN]
    assert found.keep_own(few.copy(), len(few), POSE, (-150.0, 60.0), SPAN_S) == len(few)


class Surface:
    """The same events whenever it is asked, and how often it was."""

    def __init__(self, points):
        self.stamp_ns, self.asked, self._points = 0, 0, points

    def points(self, window, span_s):
        self.asked += 1
        return self._points, len(self._points)


@pytest.mark.parametrize(("velocity", "wait_s"), [((-50.0, 0.0), AGAIN_S), ((150.0, -40.0), SELDOM_S)])
def test_it_is_looked_at_soon_where_it_can_be_told_from_the_target(velocity, wait_s):
    found, surface = seen(points_of((150.0, -60.0))), Surface(points_of((150.0, -60.0)))

    def asked_by(stamp_ns):
        surface.stamp_ns = stamp_ns
        if found.is_due(stamp_ns, velocity, SPAN_S):
            found.look(surface, (0, 0, 0, 0), POSE)
        return surface.asked

    assert asked_by(0) == 1
    assert asked_by(round(wait_s * 1e9) - 1) == 1
    assert asked_by(round(wait_s * 1e9)) == 2
    # The stream starts again.
    assert asked_by(-(10**12)) == 3


@given(arrays(np.float32, (7, 9), elements=st.floats(-10, 10, width=32)))
def test_smoothing_weighs_each_cell_with_its_neighbours(drawn):
    padded = np.pad(drawn, 1).astype(np.float64)
    along = padded[:, :-2] + 2 * padded[:, 1:-1] + padded[:, 2:]
    expected = along[:-2] + 2 * along[1:-1] + along[2:]
    smooth(drawn, np.empty_like(drawn))
    np.testing.assert_allclose(drawn, expected, atol=1e-3)


def shift_by_numpy(points, velocity, ring, reach):
    """The shift of cells at which the polarities of both halves, drawn to the nearest cell, agree best."""
    rows, columns = ring.shape
    halves = np.zeros((2, rows, columns))
    for x, y, age_s, polarity in points.astype(np.float64):
        since_s = age_s - SPAN_S / 2
        column = round(x + velocity[0] * since_s - POSE[0] + (columns - 1) / 2)
        row = round(y + velocity[1] * since_s - POSE[1] + (rows - 1) / 2)
        halves[int(since_s <= 0), row, column] += polarity
    scores = {
        (across, down): (ring * halves[0] * np.roll(halves[1], (-down, -across), (0, 1))).sum()
        for down in range(-reach, reach + 1)
        for across in range(-reach, reach + 1)
    }
    return max(scores, key=lambda shift: scores[shift])


@pytest.mark.parametrize("shift", [(0, 0), (2, -1), (-3, 3)])
def test_the_shift_between_both_halves_is_that_of_the_plain_correlation(shift):
    velocity = np.array(shift) / (SPAN_S / 2)
    points = points_of(np.zeros(2), outer=1.6, pixels=80)
    points[:, :2] = np.round(points[:, :2])
    newer = points[:, 2] < SPAN_S / 2
    points[newer, :2] += shift
    ring = np.ones((71, 81), np.float32)
    halves, room, sides = np.zeros((2, 71, 81), np.float32), np.zeros((71, 81), np.float32), np.zeros(4)
    found = ring_shift(points, len(points), POSE, 1.0, np.zeros(2), SPAN_S, ring, 5, halves, room, sides)
    assert shift_by_numpy(points, np.zeros(2), ring, 5) == shift
    assert found[:2] == pytest.approx(shift, abs=0.3)
    assert found[2] > 0.7
    assert sides.sum() == len(points)
    moved_on = ring_shift(points, len(points), POSE, 1.0, velocity, SPAN_S, ring, 5, halves, room, sides)
    assert abs(moved_on[0]) + abs(moved_on[1]) < abs(shift[0]) + abs(shift[1]) + 0.5


def test_a_shift_at_the_border_of_what_was_tried_says_nothing():
    points = points_of(np.zeros(2), outer=1.6, pixels=80)
    points[points[:, 2] < SPAN_S / 2, 0] += 2
    halves, room, sides = np.zeros((2, 71, 81), np.float32), np.zeros((71, 81), np.float32), np.zeros(4)
    ring = np.ones((71, 81), np.float32)
    assert ring_shift(points, len(points), POSE, 1.0, np.zeros(2), SPAN_S, ring, 2, halves, room, sides)[2] == 0


def result_of(seed, target):
    """Of a thing that moves before a panning camera."""
    results = evaluate_sequence(sequence_named("pan").with_seed(seed))
    return next(result for result in results if result.target == target)


@pytest.mark.parametrize(("seed", "target"), [(8, "ball_1"), (12, "car_2"), (26, "ball_1")])
def test_a_start_before_a_background_that_moves_otherwise_takes_the_targets_motion(seed, target):
    assert result_of(seed, target).ap > 0.75


@pytest.mark.parametrize(("seed", "target"), [(4, "car_2"), (15, "ball_1")])
def test_a_target_is_not_drawn_along_by_a_background_that_moves_otherwise(seed, target):
    assert result_of(seed, target).ap > 0.75
