"""What moves with a fast target just beyond its box is taken into it, where nothing else moves near by."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tracked_scenes import HEIGHT, WIDTH, frames_of, overlap, tracked

from etd_ros.simulation import Path, Scene, Sprite
from etd_ros.tracking import outline
from etd_ros.tracking.outline import (
    BINS,
    INSIDE_MIN,
    NEAR_PX,
    NEAR_S,
    OTHERS_MAX,
    RIM_MIN,
    RIM_QUANTILE,
    RIM_SHARE,
    RIM_TIMES,
    ZONE_PX,
    Beyond,
    beyond_box,
)
from etd_ros.tracking.steady_change import SteadyChange
from etd_ros.warm_up import warm_up

SPEED = np.array([1000.0, -400.0, 0.0, 0.0])
POSE = np.array([100.0, 80.0, 1.0, 0.0])
SIDES = (0, -1), (0, 1), (1, -1), (1, 1)
"""Left, right, top, bottom: an axis, and its direction outwards."""
NEAR = NEAR_PX + NEAR_S * math.hypot(*SPEED[:2])


def points_at(places, rng):
    """Points of these places relative to the middle, of ages up to 2 ms."""
    ages = rng.uniform(0, 0.002, len(places))
    places = POSE[:2] + places - ages[:, None] * SPEED[:2]
    polarity = rng.choice([-1.0, 1.0], len(places))
    return np.column_stack([places, ages, polarity]).astype(np.float32)


def rim(radius_px, number):
    angle = np.linspace(0, 2 * math.pi, number, endpoint=False)
    return radius_px * np.column_stack([np.cos(angle), np.sin(angle)])


def oracle(points, width, height):
    """`beyond_box` by sets of points."""
    offsets = points[:, :2] + points[:, 2:3] * SPEED[:2] - POSE[:2]
    out = np.abs(offsets) - np.array([width, height]) / 2 - NEAR
    farther = out.max(axis=1)
    inside = np.count_nonzero(farther <= 0)
    if inside < INSIDE_MIN or np.count_nonzero((farther > ZONE_PX) & (farther <= 3 * ZONE_PX)) > OTHERS_MAX * inside:
        return (0.0,) * 4
    found = []
    for axis, sign in SIDES:
        of_side = (np.sign(offsets[:, axis]) == sign) & (out[:, axis] > 0) & (out[:, 1 - axis] <= ZONE_PX / 2)
        depths = np.sort(out[of_side & (out[:, axis] <= ZONE_PX), axis])
        others = np.count_nonzero(of_side & (out[:, axis] > ZONE_PX) & (out[:, axis] <= 3 * ZONE_PX))
        is_rim = len(depths) >= max(RIM_MIN, RIM_SHARE * inside) and len(depths) > RIM_TIMES * (others + 1)
        found.append(NEAR + depths[math.ceil(RIM_QUANTILE * len(depths)) - 1] if is_rim else 0.0)
    is_ahead = any(beyond > 0 and sign * SPEED[axis] >= 0 for beyond, (axis, sign) in zip(found, SIDES, strict=True))
    return tuple(found) if is_ahead else (0.0,) * 4


@pytest.mark.parametrize("seed", range(20))
def test_it_says_what_sets_of_points_say(seed):
    rng = np.random.default_rng(seed)
    width, height = rng.uniform(15, 40, 2)
    spread = np.array([width, height]) / 2 + rng.uniform(-2, 4)
    places = np.concatenate([rng.uniform(-1, 1, (200, 2)) * spread, rng.uniform(-30, 30, (rng.integers(0, 20), 2))])
    points = points_at(places, rng)
    found = beyond_box(points, len(points), POSE, SPEED, width, height)
    assert found == pytest.approx(oracle(points, width, height), abs=ZONE_PX / BINS)


def test_a_rim_beyond_the_box_is_found_on_each_side_and_a_box_that_fits_has_none():
    points = points_at(np.concatenate([rim(13, 100), rim(3, 40)]), np.random.default_rng(0))
    found = beyond_box(points, len(points), POSE, SPEED, 20.0, 20.0)
    assert min(found) > 1.0
    assert max(found) < 4.5
    assert beyond_box(points, len(points), POSE, SPEED, 26.0, 26.0) == (0, 0, 0, 0)


def test_where_other_things_move_near_by_nothing_is_said():
    rng = np.random.default_rng(0)
    places = np.concatenate([rim(12, 100), rim(3, 40), rng.uniform(-18, 18, (60, 2))])
    points = points_at(places, rng)
    assert beyond_box(points, len(points), POSE, SPEED, 20.0, 20.0) == (0, 0, 0, 0)


def test_events_that_trail_behind_do_not_count_by_themselves():
    rng = np.random.default_rng(0)
    trail = np.column_stack([rng.uniform(-13.2, -11.5, 60), rng.uniform(-5, 5, 60)])
    points = points_at(np.concatenate([rim(9, 200), trail]), rng)
    assert beyond_box(points, len(points), POSE, SPEED, 20.0, 20.0) == (0, 0, 0, 0)
    ahead = points_at(np.concatenate([rim(9, 200), -trail]), rng)
    assert beyond_box(ahead, len(ahead), POSE, SPEED, 20.0, 20.0).right > 1


def test_a_box_grows_by_the_mean_of_both_sides_or_by_the_one_that_says_something():
    assert Beyond(0.0, 0.0, 0.0, 0.0).growth(20, 10) == 0
    assert Beyond(1.0, 1.0, 0.0, 0.0).growth(20, 10) == pytest.approx(math.log(1.1))
    assert Beyond(1.0, 1.0, 0.5, 0.5).growth(20, 10) == pytest.approx(math.log(1.1))
    assert Beyond(0.0, 4.0, 1.0, 0.0).shift == (2.0, -0.5)


def test_a_rate_that_was_below_0_is_doubted():
    change = SteadyChange(0.3)
    for rate, doubted in ((-1.0, -0.5), (1.0, 1.0), (0.0, 0.0)):
        change.per_s = rate
        change.doubt_if_below_0()
        assert change.per_s == doubted


def growing_ball(*, growth_per_s, stripe_px, down_px_s, first):
    """A grey disc that flies past stripes, by turns brighter and darker than it."""
    duration_s, side = 0.2, 61
    y, x = np.mgrid[:side, :side] - side // 2
    opacity = np.clip(side // 2 - np.hypot(x, y) + 0.5, 0, 1)

    def pose(times_s):
        scale = 16 / side * np.exp(growth_per_s * times_s)
        return 20 + 1000 * times_s, HEIGHT / 2 + down_px_s * (times_s - 0.1), scale, np.zeros_like(times_s)

    stripes = np.where((np.arange(WIDTH) // stripe_px + first) % 2, 0.25, 0.75)
    ball = Sprite("thing", np.full((side, side), 0.45), opacity, Path.of(pose, duration_s))
    return Scene(WIDTH, HEIGHT, duration_s, np.tile(stripes, (HEIGHT, 1)), (ball,))


@pytest.mark.parametrize(
    ("growth_per_s", "stripe_px", "down_px_s", "first"), [(0.0, 30, 0, 0), (3.0, 45, 0, 0), (4.0, 20, -300, 1)]
)
def test_a_ball_whose_rim_changes_its_polarity_is_followed_as_it_grows(growth_per_s, stripe_px, down_px_s, first):
    scene = growing_ball(growth_per_s=growth_per_s, stripe_px=stripe_px, down_px_s=down_px_s, first=first)
    found = tracked(scene, start_s=0.01, frames=frames_of(scene))
    overlaps = [overlap(report, truth) for time_s, report, truth in found if 0.03 < time_s < 0.18]
    assert len(overlaps) > 50
    assert np.mean(overlaps) > 0.65, "without its outline the ball has .43 to .5 where it grows"


def test_the_warm_up_compiles_it():
    warm_up(("tracking",))
    assert outline._beyond_box.signatures
