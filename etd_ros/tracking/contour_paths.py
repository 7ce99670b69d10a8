"""Closed contours round a point: in log-polar coordinates they are paths from one side of the picture to the other."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from etd_ros.tracking.discovery_kernels import Float32Array, Float64Array, Int64Array

ANGLES, RADII = 128, 56
RADIUS_MIN_PX = 3.0
FINE_PX, COARSE_PX = 0.8, 1.6
"""Smoothing (pixels) where rays are near one another and where they are far apart."""
SMOOTHED_RAYS = 5
FAINT = 0.02
"""What has less events a pixel than this is empty."""
BEND_COST = 0.05
"""What a step to the next radius costs, in parts of the strongest edge."""


@dataclass(frozen=True, slots=True)
class ContourPaths:
    """Closed contours round a point, each found once.

    Attributes:
        boxes: round them: left, top, width, height (pixels of the picture), float64, shape (n, 4).
        support: mean strength of the edges along each, 0 to 1, float64, shape (n,).
    """

    boxes: Float64Array
    support: Float64Array


def contour_paths(picture: Float32Array) -> ContourPaths:
    """The closed contours round the middle of a picture.

    For each radius along one ray, the path round the middle and back to that radius with the strongest edges on it.
    Radii are spaced geometrically, so that a shape costs the same at any size.

    Args:
        picture: events a pixel, moved on to now, float32, square, of an even side of at least 8 pixels.
    """
    middle = picture.shape[0] / 2
    radii = np.geomspace(RADIUS_MIN_PX, middle - 1, RADII)
    angles = np.linspace(0.0, 2 * np.pi, ANGLES, endpoint=False, dtype=np.float64)
    strengths = _edge_strengths(picture, radii, angles)
    paths = np.unique(best_paths(strengths, BEND_COST), axis=0)
    x, y = middle + radii[paths] * np.cos(angles), middle + radii[paths] * np.sin(angles)
    left, top = x.min(axis=1), y.min(axis=1)
    boxes = np.stack([left, top, x.max(axis=1) - left, y.max(axis=1) - top], axis=1)
    return ContourPaths(boxes, strengths[paths, np.arange(ANGLES)].mean(axis=1, dtype=np.float64))


def _edge_strengths(picture: Float32Array, radii: Float64Array, angles: Float64Array) -> Float32Array:
    """How strong the edges are at each radius and angle, from 0 to 1, float32, shape (radii, angles)."""
    middle = picture.shape[0] / 2 - 0.5
    columns = (middle + radii[:, None] * np.cos(angles)).astype(np.float32)
    rows = (middle + radii[:, None] * np.sin(angles)).astype(np.float32)
    fine, coarse = (
        cv2.remap(cv2.GaussianBlur(picture, (0, 0), size_px), columns, rows, cv2.INTER_LINEAR)
        for size_px in (FINE_PX, COARSE_PX)
    )
    ray_distance_px = radii[:, None] * (2 * np.pi / len(angles))
    is_far = np.clip((ray_distance_px - FINE_PX) / COARSE_PX, 0, 1).astype(np.float32)
    around = cv2.copyMakeBorder(
        fine * (1 - is_far) + coarse * is_far, 0, 0, SMOOTHED_RAYS, SMOOTHED_RAYS, cv2.BORDER_WRAP
    )
    events = cv2.blur(around, (SMOOTHED_RAYS, 1))[:, SMOOTHED_RAYS:-SMOOTHED_RAYS]
    seen = events[events > FAINT]
    usual = float(np.median(seen)) if len(seen) else 1.0
    return np.asarray(events / (events + usual), np.float32)


@njit(cache=True, nogil=True)
def best_paths(strengths: Float32Array, bend_cost: float) -> Int64Array:
    """The closed path of the greatest strength through each radius of the first ray, by dynamic programming.

    Args:
        strengths: shape (radii, angles), at least 2 of both.
        bend_cost: taken off for each step to a neighbouring radius; paths take one step at most from ray to ray.

    Returns:
        The radius at each angle, shape (radii, angles): row r is the path through radius r at the first angle.
    """
    radii, angles = strengths.shape
    paths = np.empty((radii, angles), np.int64)
    best = np.empty((angles, radii), np.float32)
    steps = np.zeros((angles, radii), np.int8)
    nothing = np.float32(-1e9)
    for start in range(radii):
        best[0, :] = nothing
        best[0, start] = strengths[start, 0]
        for angle in range(1, angles):
            for radius in range(radii):
                total, step = best[angle - 1, radius], 0
                if radius > 0 and best[angle - 1, radius - 1] - bend_cost > total:
                    total, step = best[angle - 1, radius - 1] - bend_cost, -1
                if radius < radii - 1 and best[angle - 1, radius + 1] - bend_cost > total:
                    total, step = best[angle - 1, radius + 1] - bend_cost, 1
                best[angle, radius] = total + strengths[radius, angle]
                steps[angle, radius] = step
        last, total = start, best[angles - 1, start]
        if start > 0 and best[angles - 1, start - 1] - bend_cost > total:
            last, total = start - 1, best[angles - 1, start - 1] - bend_cost
        if start < radii - 1 and best[angles - 1, start + 1] - bend_cost > total:
            last = start + 1
        radius = last
        for angle in range(angles - 1, -1, -1):
            paths[start, angle] = radius
            radius += steps[angle, radius]
    return paths
