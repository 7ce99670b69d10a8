"""How far a thing reaches in each direction, by where its events are in its start box: the box of what turns is that of
its turned shape."""

from __future__ import annotations

import math

import numpy as np

from etd_ros.tracking.contour_kernels import Float64Array

DIRECTIONS = 32
"""A multiple of four, so that the axes are among them."""
POINTS_MIN = 60
BEYOND_SHARE = 0.01
"""So many of the points may lie farther out: noise does."""
INSIDE = 1.06
"""Points so far beyond the box are of its edges still, in parts of half of its size."""
SHORT_MIN = 0.8
"""A shape that does not reach so far along an axis is not seen as a whole."""
_ANGLES = np.arange(DIRECTIONS) * (2 * math.pi / DIRECTIONS)
_TOWARDS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])
_LEAST, _MOST = np.abs(_TOWARDS).max(axis=0), np.abs(_TOWARDS).sum(axis=0)
"""A square on its corner in the box, and all of the box."""


def reach_of(points: Float64Array) -> Float64Array | None:
    """How far a shape reaches in DIRECTIONS directions, from that of x on towards that of y, shape (DIRECTIONS,); None
    where the points do not tell.

    Args:
        points: of the shape, from the middle of its box, in parts of half of the box's width and height, shape (n, 2).
    """
    inside = points[(np.abs(points) <= INSIDE).all(axis=1)]
    if len(inside) < POINTS_MIN:
        return None
    beyond = max(1, round(BEYOND_SHARE * len(inside)))
    reach = -np.partition(-(inside @ _TOWARDS), beyond, axis=0)[beyond]
    axes = reach[:: DIRECTIONS // 4]
    if axes.min() < SHORT_MIN:
        return None
    # Along the axes the box says how far it reaches.
    short = np.interp(_ANGLES, np.arange(5) * (math.pi / 2), 1 / np.append(axes, axes[0]))
    return np.asarray(np.clip(short * reach, _LEAST, _MOST), np.float64)


def turned_reaches(
    reach: Float64Array, width: float, height: float, angle_rad: float
) -> tuple[float, float, float, float]:
    """How far a shape of this width and height (pixels) reaches to the left, to the right, up and down (pixels) when it
    is turned."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    to_right, to_left = (_along(reach, sign * cos * width / 2, -sign * sin * height / 2) for sign in (1, -1))
    down, up = (_along(reach, sign * sin * width / 2, sign * cos * height / 2) for sign in (1, -1))
    return to_left, to_right, up, down


def _along(reach: Float64Array, x: float, y: float) -> float:
    """How far it reaches along a direction, times the length of that."""
    at = math.atan2(y, x) / (2 * math.pi) * DIRECTIONS
    first = math.floor(at)
    before, after = float(reach[first % DIRECTIONS]), float(reach[(first + 1) % DIRECTIONS])
    return math.hypot(x, y) * (before + (at - first) * (after - before))
