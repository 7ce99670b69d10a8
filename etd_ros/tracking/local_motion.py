"""How the picture moves near a point: the velocity that makes the events there fall together."""

from __future__ import annotations

import numpy as np

from etd_ros.tracking.discovery_kernels import AGE, Float32Array, X, Y, refined_velocity, score_tiles

WINDOWS_S = (0.2, 0.14, 0.1, 0.07, 0.05, 0.035, 0.025)
"""Times of events to look at: the longest in which the motion is not too far tells the most."""
REACH = 7
"""Velocities of the grid to each side of 0."""
STEP_PX = 1.6
"""Distance of the velocities (pixels of motion in the window)."""
FAR_STEPS = 6
"""A motion of more steps in a window may be one that is farther still."""
EVENTS_MIN, EVENTS_MAX = 20, 600
RADIUS_MIN_PX, RADIUS_MAX_PX = 24.0, 90.0
"""The events are those in a square round the point that reaches so far."""


def motion_near(points: Float32Array, x: float, y: float) -> tuple[tuple[float, float], float] | None:
    """The velocity near a point, and the time in which it can be followed.

    Args:
        points: the events of the longest of WINDOWS_S, from `RecentEvents.points`.
        x: of the point (pixels).
        y: the same.

    Returns:
        Velocity along x and y (pixels/s), and the window (s) in which that is about ten pixels at most; None where
        there are hardly any events.
    """
    velocity, window_s = None, WINDOWS_S[-1]
    for window_s in WINDOWS_S:
        found = _fitted(points[points[:, AGE] < window_s], x, y, window_s)
        if found is None:
            # A shorter window has fewer events still.
            break
        velocity, steps = found
        if steps <= FAR_STEPS:
            break
    return None if velocity is None else (velocity, window_s)


def _fitted(points: Float32Array, x: float, y: float, window_s: float) -> tuple[tuple[float, float], int] | None:
    """The best velocity (pixels/s) of the events nearest to a point, and how far out it lies on the grid (steps)."""
    if len(points) < EVENTS_MIN:
        return None
    off_x, off_y = np.abs(points[:, X] - x), np.abs(points[:, Y] - y)
    off = np.maximum(off_x, off_y)
    nearest = min(EVENTS_MAX, len(points)) - 1
    radius = float(np.clip(np.partition(off, nearest)[nearest], RADIUS_MIN_PX, RADIUS_MAX_PX))
    local = points[off < radius]
    if len(local) < EVENTS_MIN:
        return None
    local = np.ascontiguousarray(local[:: -(-len(local) // EVENTS_MAX)])
    local[:, X] -= np.float32(x - radius)
    local[:, Y] -= np.float32(y - radius)
    return _sharpest(local, int(2 * radius) + 1, window_s)


def _sharpest(points: Float32Array, side: int, window_s: float) -> tuple[tuple[float, float], int]:
    scores = np.zeros((1, 2 * REACH + 1, 2 * REACH + 1), np.float32)
    score_tiles(points[None], np.array([len(points)], np.int32), 1, side, STEP_PX, window_s, scores)
    row, column = (int(index) - REACH for index in np.unravel_index(int(scores.argmax()), scores.shape[1:]))
    step_px_s = STEP_PX / window_s
    room = np.zeros((side, side), np.float32)
    velocity = refined_velocity(points, column * step_px_s, row * step_px_s, step_px_s, room)
    return (float(velocity[0]), float(velocity[1])), max(abs(row), abs(column))
