"""Kernels of `camera_slide`: pictures of where edges are, and how alike two of them are along lines."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.tracking.contour_kernels import Float32Array, Float64Array


@njit(cache=True, nogil=True)
def light_cells(data: npt.NDArray[np.uint8], cell_px: int, stride: int, lit: Float32Array) -> int:
    """Set those cells to 1 in which a pixel has fired.

    Args:
        data: a frame, shape (height, width, 2); rows and columns that fill no cell are left out.
        cell_px: pixels along the side of a cell.
        stride: pixels from one that is looked at to the next, along rows and columns.
        lit: the cells, shape (rows, columns); renewed.

    Returns:
        How many are 1 now.
    """
    rows, columns = lit.shape
    height, width, _ = data.shape
    for row in range(0, min(height, rows * cell_px), stride):
        for column in range(0, min(width, columns * cell_px), stride):
            if data[row, column, 0] | data[row, column, 1]:
                lit[row // cell_px, column // cell_px] = 1
    return int(lit.sum())


@njit(cache=True, nogil=True)
def likeness_along(
    alike: Float32Array,
    directions: Float64Array,
    nearest: float,
    farthest: float,
    step: float,
    least: float,
    likeness: Float64Array,
) -> float:
    """How alike two pictures are if what one shows is moved in each direction, by any way.

    Args:
        alike: their correlation for each way, shape (rows, columns), more than the longest way; ways back and up count
            from its end.
        directions: x and y of length 1, shape (directions, 2).
        nearest: the shortest way that is tried (cells).
        farthest: the longest one.
        step: from one to the next.
        least: less than this says nothing.
        likeness: the sum of the squares of what exceeds that, shape (directions,); renewed.

    Returns:
        The way (cells) at which they are most alike, in the direction of the most likeness; 0 if there is none.
    """
    most = best_way = 0.0
    for number in range(len(directions)):
        total = peak = peak_way = 0.0
        way = nearest
        while way <= farthest:
            x, y = directions[number, 0] * way, directions[number, 1] * way
            left, above = math.floor(x), math.floor(y)
            right_share, below_share = x - left, y - above
            right, below = left + 1, above + 1
            # Negative ones count from the end by themselves, where a remainder would take most of the time.
            upper = (1 - right_share) * alike[above, left] + right_share * alike[above, right]
            lower = (1 - right_share) * alike[below, left] + right_share * alike[below, right]
            over = (1 - below_share) * upper + below_share * lower - least
            if over > 0:
                total += over * over
            if over > peak:
                peak, peak_way = over, way
            way += step
        likeness[number] = total
        if total > most:
            most, best_way = total, peak_way
    return best_way
