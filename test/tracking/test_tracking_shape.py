"""How far a thing reaches in each direction is told from where its events are."""

import math

import numpy as np
import pytest

from etd_ros.tracking.shape import DIRECTIONS, POINTS_MIN, reach_of, turned_reaches

EIGHTH = math.pi / 4


def along_lines(*corners, points=400):
    """Points along the sides of a polygon, shape (n, 2)."""
    starts, share = np.array(corners, float), np.linspace(0, 1, points // len(corners), endpoint=False)
    ends = np.roll(starts, -1, axis=0)
    return np.concatenate([a + np.outer(share, b - a) for a, b in zip(starts, ends, strict=True)])


SQUARE = along_lines((-1, -1), (1, -1), (1, 1), (-1, 1))
ON_ITS_CORNER = along_lines((1, 0), (0, 1), (-1, 0), (0, -1))
ROUND = np.stack([f(np.linspace(0, 2 * np.pi, 400, endpoint=False)) for f in (np.cos, np.sin)], axis=1)


@pytest.mark.parametrize(
    ("points", "times"),
    [(SQUARE, math.sqrt(2)), (ROUND, 1.0), (ON_ITS_CORNER, math.sqrt(0.5))],
    ids=["a square", "a disc", "a square on its corner"],
)
def test_by_an_eighth_of_a_turn_a_thing_becomes_as_wide_as_it_is_across(points, times):
    left, right, up, down = turned_reaches(reach_of(points), 40.0, 40.0, EIGHTH)
    assert (left + right, up + down) == pytest.approx((40 * times, 40 * times), rel=0.04)


@pytest.mark.parametrize("points", [SQUARE, ROUND, ON_ITS_CORNER])
def test_upright_and_after_quarter_turns_it_is_as_wide_and_high_as_its_box(points):
    reach = reach_of(points)
    assert turned_reaches(reach, 40.0, 30.0, 0.0) == pytest.approx((20, 20, 15, 15))
    assert turned_reaches(reach, 40.0, 30.0, math.pi / 2) == pytest.approx((15, 15, 20, 20))
    assert turned_reaches(reach, 40.0, 30.0, math.pi) == pytest.approx((20, 20, 15, 15))


def test_a_rectangle_reaches_as_far_as_its_corners():
    left, right, up, down = turned_reaches(reach_of(SQUARE), 60.0, 20.0, 0.5)
    width, height = 60 * math.cos(0.5) + 20 * math.sin(0.5), 60 * math.sin(0.5) + 20 * math.cos(0.5)
    assert (left + right, up + down) == pytest.approx((width, height), rel=0.04)


def test_the_box_of_a_triangle_does_not_stay_round_its_middle():
    pointing_right = along_lines((1, 0), (-1, 1), (-1, -1))
    left, right, _, _ = turned_reaches(reach_of(pointing_right), 40.0, 40.0, -EIGHTH)
    assert left == pytest.approx(20 * math.sqrt(2), rel=0.1)
    assert right == pytest.approx(20 * math.sqrt(0.5), rel=0.1)


def test_it_turns_clockwise_as_seen():
    # Only its corner to the right and down is missing.
    cut = along_lines((-1, -1), (1, -1), (1, 0), (0, 1), (-1, 1))
    left, right, up, down = turned_reaches(reach_of(cut), 40.0, 40.0, EIGHTH)
    assert down < 0.85 * min(left, right, up)


def test_noise_round_a_thing_does_not_enlarge_it():
    noise = np.random.default_rng(1).uniform(-1, 1, (4, 2))
    noisy, clean = reach_of(np.concatenate([ROUND, noise])), reach_of(ROUND)
    assert np.abs(noisy - clean).max() < 0.05


def test_few_points_and_those_of_a_part_tell_nothing():
    assert reach_of(ROUND[: POINTS_MIN - 1]) is None
    assert reach_of(SQUARE[SQUARE[:, 0] < 0.5]) is None


def test_it_reaches_no_farther_than_the_boxs_corners():
    reach = reach_of(np.random.default_rng(2).uniform(-1.05, 1.05, (500, 2)))
    angles = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    assert (reach <= np.abs(np.cos(angles)) + np.abs(np.sin(angles)) + 1e-9).all()
