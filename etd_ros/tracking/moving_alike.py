"""The events that move like the object at a click, and not like what stands nearer or farther."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.tracking.discovery_kernels import AGE, Float32Array, X, Y, draw

OTHER_SPEEDS = (0.4, 0.65, 1.6, 2.5)
"""Before a camera that slides, what stands nearer or farther goes the same way, so many times as fast."""
SMOOTHING_PX = 1.2


def are_own(points: Float32Array, velocity: tuple[float, float], side: int) -> npt.NDArray[np.bool_]:
    """Which events fall on at least as many others at a velocity as at slower and faster ones of its direction.

    Args:
        points: the events, places from the corner of a square picture, float32, shape (n, 3).
        velocity: along x and y (pixels/s).
        side: of the picture (pixels).

    Returns:
        bool, shape (n,).
    """
    at_others = np.zeros(len(points), np.float32)
    for times in OTHER_SPEEDS:
        np.maximum(at_others, _company(points, (times * velocity[0], times * velocity[1]), side), out=at_others)
    return np.asarray(_company(points, velocity, side) >= at_others, np.bool_)


def _company(points: Float32Array, velocity: tuple[float, float], side: int) -> Float32Array:
    """How dense the events are where each of them is now, if all move with a velocity, shape (n,)."""
    picture = np.zeros((side, side), np.float32)
    draw(points, *velocity, picture)
    smooth = cv2.GaussianBlur(picture, (0, 0), SMOOTHING_PX)
    columns, rows = (
        np.clip(points[:, axis] + speed * points[:, AGE], 0, side - 1).astype(np.int64)
        for axis, speed in zip((X, Y), velocity, strict=True)
    )
    return np.asarray(smooth[rows, columns], np.float32)
