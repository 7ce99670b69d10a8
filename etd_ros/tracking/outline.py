"""Whether a fast target's box is too small: where nothing else moves near by, all that moves with the target is of it.

Before a background that is bright here and dark there, a thing's rim appears, vanishes and changes its polarity. What
is learnt of it may then be one part of the rim; a model that follows that part no longer sees that the thing grows,
however far the rest lies beyond the box.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from etd_ros.tracking.contour_kernels import AGE, ALONG_X, ALONG_Y, Float32Array, Float64Array, X, Y

NEAR_PX, NEAR_S = 1.0, 0.0004
"""A box has its rim in it to this much, and to what it moves in this time: pixels are not read out at once."""
ZONE_PX = 3.0
"""What is of the target lies up to this far beyond that; twice as far beyond it, other things would be seen."""
OTHERS_MAX = 0.05
"""Nothing else moves near by if there are no more points than this share of those in the box."""
RIM_SHARE = 0.02
"""A side of the rim has this share of the points in the box."""
RIM_TIMES = 4.0
"""And more than so many times as many as lie beyond them, and one."""
RIM_QUANTILE = 0.8
"""The rim is where this share of its points is nearer."""
BINS = 12
"""Parts of the zone's depth that are told apart."""
AHEAD_SHARE = 0.2
"""A side is ahead to which the target moves at more than this share of its speed."""
INSIDE_MIN = 12.0
"""Fewer points in the box say nothing about it."""


class Beyond(NamedTuple):
    """How far a target lies beyond its box on each side (pixels); 0 where it does not, or that cannot be told."""

    left: float
    right: float
    top: float
    bottom: float

    def growth(self, width: float, height: float) -> float:
        """By how much the box is too small (the logarithm of its scale) if it is so wide and high (pixels).

        Where one of both says nothing, as of what moves along it, the other one says it.
        """
        wider = math.log1p((self.left + self.right) / width)
        higher = math.log1p((self.top + self.bottom) / height)
        return (wider + higher) / 2 if wider and higher else max(wider, higher)

    @property
    def shift(self) -> tuple[float, float]:
        """How far the middle is from the box's, x and y (pixels)."""
        return (self.right - self.left) / 2, (self.bottom - self.top) / 2


def beyond_box(
    points: Float32Array, count: int, pose: Float64Array, velocity: Float64Array, width: float, height: float
) -> Beyond:
    """What a target's points say of its box: nothing where they say nothing of a side ahead.

    Args:
        points: as `TimeSurface.points` returns them, of the box, some ten pixels round it, and where
            what is there was before.
        count: of the points.
        pose: x, y of the middle (pixels), and what else a pose has.
        velocity: x, y (pixels/s), and what else a motion has.
        width: of the box (pixels).
        height: of the box (pixels).
    """
    return Beyond(*_beyond_box(points, count, pose, velocity, width / 2, height / 2).tolist())


@njit(cache=True, nogil=True)
def _beyond_box(points: Float32Array, count: int, pose: Float64Array, velocity: Float64Array, half_width: float,
                half_height: float) -> Float64Array:  # fmt: skip
    """`beyond_box`; float64, shape (4,). Zone and what lies beyond it are square rings, a side's part as long as the
    box and half of the zone."""
    speed = math.hypot(velocity[ALONG_X], velocity[ALONG_Y])
    near_px = NEAR_PX + NEAR_S * speed
    outward = -velocity[ALONG_X], velocity[ALONG_X], -velocity[ALONG_Y], velocity[ALONG_Y]
    rims = np.zeros((4, BINS))
    others = np.zeros(4)
    inside = ring = 0.0
    for index in range(count):
        age = points[index, AGE]
        dx = points[index, X] + velocity[ALONG_X] * age - pose[0]
        dy = points[index, Y] + velocity[ALONG_Y] * age - pose[1]
        out_x, out_y = abs(dx) - half_width - near_px, abs(dy) - half_height - near_px
        farther = max(out_x, out_y)
        if farther <= 0:
            inside += 1
        elif ZONE_PX < farther <= 3 * ZONE_PX:
            ring += 1
        for is_upright, out, along in ((0, out_x, out_y), (1, out_y, out_x)):
            if out <= 0 or out > 3 * ZONE_PX or along > ZONE_PX / 2:
                continue
            side = 2 * is_upright + int((dy if is_upright else dx) > 0)
            if out <= ZONE_PX:
                rims[side, min(BINS - 1, int(out / ZONE_PX * BINS))] += 1
            else:
                others[side] += 1
    beyond, is_ahead = np.zeros(4), False
    if inside < INSIDE_MIN or ring > OTHERS_MAX * inside:
        return beyond
    for side in range(4):
        rim = rims[side].sum()
        if rim >= RIM_SHARE * inside and rim > RIM_TIMES * (others[side] + 1):
            part, nearer = 0, rims[side, 0]
            while nearer < RIM_QUANTILE * rim:
                part += 1
                nearer += rims[side, part]
            beyond[side] = near_px + (part + 0.5) / BINS * ZONE_PX
            if outward[side] > AHEAD_SHARE * speed:
                is_ahead = True
    # Behind and beside alone it may be a trail: pixels that follow the light late have events there.
    return beyond if is_ahead else np.zeros(4)
