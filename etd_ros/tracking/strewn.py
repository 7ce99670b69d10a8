"""Whether events are strewn as noise is: those of edges lie side by side."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

EXCESS_MAX = 0.25
"""Of the pixels that would be alone by chance, less than this share have a neighbour that fired as well."""
RATE_MAX_HZ, SHARE_MAX = 1.5, 0.16
"""Noise makes fewer events a pixel and second (of 240x180 pixels 65,000). And where more than this share of the pixels
fire, too many have a neighbour by chance for that to tell."""


@njit(cache=True, nogil=True)
def are_strewn(times: npt.NDArray[np.int64], now_ns: int, duration_s: float, top: int, bottom: int, left: int,
               right: int) -> bool:  # fmt: skip
    """Whether the pixels of a window that fired in a time until `now_ns` are none, or few that have hardly more
    neighbours among them than by chance.

    Args:
        times: of each pixel's last events (ns), int64, shape (height, width, 2).
        now_ns: until when events count (ns).
        duration_s: for how long (s).
        top: first row.
        bottom: row after the last.
        left: first column.
        right: column after the last.
    """
    oldest_ns = now_ns - int(duration_s * 1e9)
    fired = beside = 0
    for row in range(top, bottom):
        for column in range(left, right):
            if max(times[row, column, 0], times[row, column, 1]) <= oldest_ns:
                continue
            fired += 1
            beside += _has_neighbour(times, oldest_ns, row, column, top, bottom, left, right)
    share = fired / max(1, (bottom - top) * (right - left))
    by_chance = 1.0 - (1.0 - share) ** 8
    return (
        share < min(SHARE_MAX, RATE_MAX_HZ * duration_s)
        and beside <= (by_chance + EXCESS_MAX * (1.0 - by_chance)) * fired
    )


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
