"""How much the cells of a model count, by where they lie."""

from __future__ import annotations

import numpy as np

from etd_ros.tracking.contour_kernels import Float32Array

WEIGHT_FADES, OUTSIDE_FADES = (1.0925, 1.4375), (1.0, 1.2)
"""Where cells count less and less, and where they are more and more taken to lie outside of the target: ovals of so
many times the box's width and height."""


def oval(rows: int, columns: int, width: float, height: float, fades: tuple[float, float]) -> Float32Array:
    """Weights of cells round a box.

    Args:
        rows: of the cells.
        columns: of the cells.
        width: of the box in their middle (cells).
        height: of the box (cells).
        fades: ovals of so many times the box's width and height, between which the weights fall from 1 to 0.

    Returns:
        float32, shape (rows, columns).
    """
    inner, outer = fades
    y, x = np.mgrid[0:rows, 0:columns]
    radius = np.hypot((x - (columns - 1) / 2) / (0.5 * width), (y - (rows - 1) / 2) / (0.5 * height))
    return np.asarray(np.clip((outer - radius) / (outer - inner), 0, 1), np.float32)
