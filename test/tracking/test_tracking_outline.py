"""What moves with a fast target just beyond its box is taken into it, where nothing else moves near by."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from tracked_scenes import HEIGHT, WIDTH, frames_of, overlap, tracked

from etd_ros.boxes import Box
from etd_ros.simulation import Path, Scene, Sprite
from etd_ros.tracking.body import SCALE_LIMITS, pair
from etd_ros.tracking.contour_config import ContourConfig
from etd_ros.tracking.contour_drawing import splat
from etd_ros.tracking.contours import OUTLINE_GAIN, Contours
from etd_ros.tracking.outline import (
    AHEAD_SHARE,
    BINS,
    INSIDE_MIN,
    NEAR_PX,
    NEAR_S,
    OTHERS_MAX,
    RIM_QUANTILE,
    RIM_SHARE,
    RIM_TIMES,
    ZONE_PX,
    Beyond,
    beyond_box,
)
from etd_ros.tracking.steady_change import SteadyChange
from etd_ros.tracking.surface import TimeSurface

SPEED = np.array([1000.0, -400.0, 0.0, 0.0])
POSE = np.array([100.0, 80.0, 1.0, 0.0])
SIDES = (0, -1), (0, 1), (1, -1), (1, 1)
"""Left, right, top, bottom: an axis, and its direction outwards."""
NEAR = NEAR_PX + NEAR_S * math.hypot(*SPEED[:2])


def points_at(places, rng, velocity=SPEED):
    """Points of these places relative to the middle, of ages up to 2 ms."""
    ages = rng.uniform(0, 0.002, len(places))
    places = POSE[:2] + places - ages[:, None] * velocity[:2]
    polarity = rng.choice([-1.0, 1.0], len(places))
    return np.column_stack([places, ages, polarity]).astype(np.float32)


def rim(radius_px, number):
    angle = np.linspace(0, 2 * math.pi, number, endpoint=False)
    return radius_px * np.column_stack([np.cos(angle), np.sin(angle)])


def found_at(places, width, height, velocity=SPEED):
    points = points_at(places, np.random.default_rng(0), velocity)
    return beyond_box(points, len(points), POSE, velocity, width, height)


def oracle(points, width, height):
    """`beyond_box` by sets of points, and how many of them are inside and in the ring."""
    offsets = points[:, :2] + points[:, 2:3] * SPEED[:2] - POSE[:2]
    out = np.abs(offsets) - np.array([width, height]) / 2 - NEAR
    farther = out.max(axis=1)
    inside = np.count_nonzero(farther <= 0)
    ring = np.count_nonzero((farther > ZONE_PX) & (farther <= 3 * ZONE_PX))
    found = []
    for axis, sign in SIDES:
        of_side = (np.sign(offsets[:, axis]) == sign) & (out[:, axis] > 0) & (out[:, 1 - axis] <= ZONE_PX / 2)
        depths = np.sort(out[of_side & (out[:, axis] <= ZONE_PX), axis])
        others = np.count_nonzero(of_side & (out[:, axis] > ZONE_PX) & (out[:, axis] <= 3 * ZONE_PX))
        is_rim = len(depths) >= RIM_SHARE * inside and len(depths) > RIM_TIMES * (others + 1)
        found.append(NEAR + depths[math.ceil(RIM_QUANTILE * len(depths)) - 1] if is_rim else 0.0)
    ahead = AHEAD_SHARE * math.hypot(*SPEED[:2])
    is_ahead = any(beyond > 0 and sign * SPEED[axis] > ahead for beyond, (axis, sign) in zip(found, SIDES, strict=True))
    says = is_ahead and inside >= INSIDE_MIN and ring <= OTHERS_MAX * inside
    return tuple(found) if says else (0.0,) * 4, inside, ring


def scattered(seed):
    """Points of a thing that is larger or smaller than its box, and of others round it; the box's width and height."""
    rng = np.random.default_rng(seed)
    width, height = rng.uniform(15, 40, 2)
    spread = np.array([width, height]) / 2 + rng.uniform(0, 4)
    number, others = rng.integers(5, 200), rng.choice([0, 20, 60])
    places = np.concatenate([rng.uniform(-1, 1, (number, 2)) * spread, rng.uniform(-30, 30, (others, 2))])
    return points_at(places, rng), width, height


@pytest.mark.parametrize("seed", range(40))
def test_it_says_what_sets_of_points_say(seed):
    points, width, height = scattered(seed)
    expected, _, _ = oracle(points, width, height)
    assert beyond_box(points, len(points), POSE, SPEED, width, height) == pytest.approx(expected, abs=ZONE_PX / BINS)


def test_those_sets_are_of_all_kinds():
    answers = [oracle(*scattered(seed)) for seed in range(40)]
    assert sum(any(expected) for expected, _, _ in answers) >= 10
    assert sum(ring > OTHERS_MAX * inside for _, inside, ring in answers) >= 10
    assert sum(inside < INSIDE_MIN for _, inside, _ in answers) >= 1


def test_a_rim_beyond_the_box_is_found_on_each_side_and_a_box_that_fits_has_none():
    places = np.concatenate([rim(13, 100), rim(3, 40)])
    assert found_at(places, 20.0, 20.0) == pytest.approx((3.0,) * 4, abs=0.3)
    assert found_at(places, 26.0, 26.0) == (0, 0, 0, 0)


@pytest.mark.parametrize(
    ("points", "inside", "is_rim"), [(4, 100, False), (5, 100, True), (5, 300, False), (6, 300, True)]
)
def test_few_points_are_no_rim(points, inside, is_rim):
    ahead = np.column_stack([np.full(points, 12.5), np.linspace(-3, 3, points)])
    found = found_at(np.concatenate([rim(9, inside), ahead]), 20.0, 20.0)
    assert (found.right > 0) == is_rim
    assert found.left == 0


def test_where_other_things_move_near_by_nothing_is_said():
    places = np.concatenate([rim(12, 100), rim(3, 40)])
    corners = np.array([(x, y) for x in (-17, 17) for y in (-17, 17)] * 2, float)
    assert found_at(places, 20.0, 20.0).left > 0
    assert found_at(np.concatenate([places, corners]), 20.0, 20.0) == (0, 0, 0, 0), "no side sees its corners"


@pytest.mark.parametrize("sideways_px_s", [-50.0, 0.0, 50.0])
def test_events_behind_and_beside_do_not_count_by_themselves_as_they_may_be_a_trail(sideways_px_s):
    rng = np.random.default_rng(0)
    behind = np.column_stack([rng.uniform(-13.2, -11.5, 60), rng.uniform(-5, 5, 60)])
    above, below, ahead = behind[:, ::-1], -behind[:, ::-1], -behind
    velocity = np.array([1000.0, sideways_px_s, 0.0, 0.0])

    def found_with(*sides):
        return found_at(np.concatenate([rim(9, 200), *sides]), 20.0, 20.0, velocity)

    assert found_with(behind) == found_with(above) == found_with(below, behind) == (0, 0, 0, 0)
    assert found_with(ahead).right > 1
    assert min(found_with(behind, above, below, ahead)) > 1


FRAMES, FRAME_NS = 8, 250_000
SCALE_GAIN = ContourConfig().scale_gain


def looked_at(
    places,
    *,
    velocity_px_s=(1000.0, 0.0),
    growing_per_s=0.0,
    scale=1.0,
    scale_gain=SCALE_GAIN,
    trust=1.0,
):
    """A fast target of 20 pixels that has looked once at 2 ms of events of these places, in short frames."""
    velocity = np.array(velocity_px_s)
    contours = Contours(Box(90.0, 70.0, 20.0, 20.0), 0, ContourConfig(scale_gain=scale_gain))
    body = contours.body
    body.velocity = velocity_px_s
    body.growing.per_s = growing_per_s
    span_s = FRAMES * FRAME_NS * 1e-9
    points = points_at(scale * places, np.random.default_rng(0), velocity)
    frames = np.minimum((span_s - points[:, 2]) / (FRAME_NS * 1e-9), FRAMES - 1e-3)
    surface = TimeSurface(WIDTH, HEIGHT)
    body.pose = *pair(POSE[:2] - velocity * span_s), scale, 0.0
    for number in range(FRAMES):
        is_of_frame = frames.astype(int) == number
        of_frame = points[is_of_frame]
        levels = np.zeros((HEIGHT, WIDTH, 2), np.uint8)
        rows, columns = of_frame[:, 1].astype(int), of_frame[:, 0].astype(int)
        levels[rows, columns, (of_frame[:, 3] < 0).astype(int)] = 1 + 254 * (frames[is_of_frame] % 1)
        surface.take((number + 1) * FRAME_NS, levels, number * FRAME_NS)
        contours.keep(surface)
    body.be_at(*pair(POSE[:2]))
    body.stamp_ns = FRAMES * FRAME_NS
    splat(
        *surface.points(surface.window(body.box, 20.0), 1.0),
        np.array(body.pose),
        contours.cell_px,
        body.motion,
        contours.drawn,
    )
    contours.begin(np.array([1.0, 0.0, 0.0, 0.0]), 1.0, 10)
    contours.adapt(surface, span_s, trust, sees_covers=False)
    return contours


LARGER = np.concatenate([rim(13, 300), rim(12.5, 300), rim(3, 100)])
ONE_SIDED = np.concatenate([rim(8, 200), np.column_stack([np.full(40, 12.5), np.linspace(-8, 8, 40)])])


def test_a_look_takes_a_part_of_what_lies_beyond_into_the_box():
    assert looked_at(LARGER).body.pose[2] == pytest.approx(1.3**OUTLINE_GAIN, abs=0.04)


def test_a_target_that_seemed_to_shrink_is_doubted_to():
    shrinking, growing = (looked_at(LARGER, growing_per_s=rate).body.motion[3] for rate in (-4.0, 4.0))
    assert shrinking > -2.5
    assert growing > 3.5


def test_the_middle_moves_towards_what_lies_beyond_one_side():
    moved_px = np.subtract(looked_at(ONE_SIDED).body.pose[:2], POSE[:2])
    assert moved_px == pytest.approx((OUTLINE_GAIN * 2.5 / 2, 0), abs=0.15)


@pytest.mark.parametrize(
    "changed",
    [{"velocity_px_s": (50.0, 0.0)}, {"trust": 0.4}, {"scale_gain": 0.0}],
    ids=["slow", "doubted", "size kept"],
)
def test_a_slow_or_doubted_target_or_one_that_is_to_keep_its_size_takes_in_nothing(changed):
    contours = looked_at(ONE_SIDED, **changed)
    assert contours.body.pose[:2] == pair(POSE[:2])
    if "scale_gain" in changed:
        assert contours.body.pose[2] == 1


def test_a_target_grows_no_further_than_the_limit():
    assert looked_at(LARGER[:600], scale=SCALE_LIMITS[1]).body.pose[2] == SCALE_LIMITS[1]


def test_what_follows_closely_is_seen_where_it_was():
    """Points 11 pixels behind the box of a target that moves at 4,000 px/s were 8 pixels farther behind 2 ms before."""
    behind = np.column_stack([np.full(40, -21.0), np.linspace(-8, 8, 40)])
    alone, followed = (
        looked_at(places, velocity_px_s=(4000.0, 0.0)) for places in (LARGER, np.concatenate([LARGER, behind]))
    )
    assert followed.body.pose[2] < alone.body.pose[2] - 0.02


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


def mean_overlap(scene):
    found = tracked(scene, start_s=0.01, frames=frames_of(scene))
    overlaps = [overlap(report, truth) for time_s, report, truth in found if 0.03 < time_s < 0.18]
    assert len(overlaps) > 50
    return np.mean(overlaps)


def test_balls_whose_rims_change_their_polarity_are_followed_as_they_grow():
    """A single one may have less: how sums are rounded, which processors do differently, decides on its course."""
    balls = itertools.product((3.0, 4.0), (20, 45), (0, -300), (0, 1))
    means = [
        mean_overlap(growing_ball(growth_per_s=growth_per_s, stripe_px=stripe_px, down_px_s=down_px_s, first=first))
        for growth_per_s, stripe_px, down_px_s, first in balls
    ]
    assert np.mean(means) > 0.72, "without their outlines they have .46"


def test_a_ball_that_does_not_grow_keeps_its_size():
    scene = growing_ball(growth_per_s=0.0, stripe_px=30, down_px_s=0, first=0)
    found = tracked(scene, start_s=0.01, frames=frames_of(scene))
    widths = [report.box.w / truth.w for time_s, report, truth in found if time_s < 0.18]
    assert len(widths) > 50
    assert max(widths) < 1.1
