"""Whether events are strewn as noise is: those of edges lie side by side."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

EXCESS_MAX = 0.25
"""Of the pixels that would be alone by chance, less than this share have a neighbour that fired as well."""
BY_CHANCE_MAX = 0.75
"""Where more have one by chance, that cannot be told."""


@njit(cache=True, nogil=True)
def are_strewn(times: npt.NDArray[np.int64], oldest_ns: int, top: int, bottom: int, left: int, right: int) -> bool:
    """Whether the pixels of a window that fired after `oldest_ns` are few, and have hardly more neighbours among them
    than by chance.

    Args:
        times: of each pixel's last events (ns), int64, shape (height, width, 2).
        oldest_ns: when events begin to count (ns).
        top: first row.
        bottom: row after the last.
        left: first column.
        right: column after the last.
    """
    fired = beside = 0
    for row in range(top, bottom):
        for column in range(left, right):
            if max(times[row, column, 0], times[row, column, 1]) <= oldest_ns:
                continue
            fired += 1
            beside += _has_neighbour(times, oldest_ns, row, column, top, bottom, left, right)
    if fired == 0:
        return False
    by_chance = 1.0 - (1.0 - fired / ((bottom - top) * (right - left))) ** 8
    return by_chance < BY_CHANCE_MAX and beside < (by_chance + EXCESS_MAX * (1.0 - by_chance)) * fired


@njit(cache=True, nogil=True)
def _has_neighbour(times: npt.NDArray[np.int64], oldest_ns: int, row: int, column: int, top: int, bottom: int,
                   left: int, right: int) -> bool:  # fmt: skip
    for beside_row in range(max(top, row - 1), min(bottom, row + 2)):
        for beside_column in range(max(left, column - 1), min(right, column + 2)):
            is_itself = beside_row == row and beside_column == column
            newest_ns = max(times[beside_row, beside_column, 0], times[beside_row, beside_column, 1])
            if not is_itself and newest_ns > oldest_ns:
                return True
    return False
