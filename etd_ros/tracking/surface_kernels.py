"""Compiled parts of the time surface: a frame's event times are entered into it, and read back as points, as
`contour_kernels` describes them. Kernels that call each other share this file, or numba would miss changes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.tracking.contour_kernels import AGE, POLARITY, Float32Array, X, Y

BLOCK = 32
"""So many levels are looked at together: most of a frame's are 0."""


@njit(cache=True, nogil=True, forceinline=True)
def _any_in_block(levels: npt.NDArray[np.uint8], start: int) -> bool:
    """Whether one of the BLOCK levels from there on is above 0."""
    any_level = np.uint8(0)
    for step in range(BLOCK):
        any_level |= levels[np.uintp(start) + np.uintp(step)]
    return bool(any_level > 0)


@njit(cache=True, nogil=True, forceinline=True)
def _keep_row(times: npt.NDArray[np.int64], levels: npt.NDArray[np.uint8], start_ns: int, share: float, start: int,
              end: int) -> int:  # fmt: skip
    """Enter the event times of a part of a row; the number of its event pixels."""
    count = 0
    for first in range(start, end, BLOCK):
        if first + BLOCK <= end and not _any_in_block(levels, first):
            continue
        for at in range(np.uintp(first), np.uintp(min(first + BLOCK, end))):
            level = levels[at]
            if level > 0:
                count += 1
                times[at] = start_ns + np.int64(level * share)
    return count


@njit(cache=True, nogil=True)
def keep_times(times: npt.NDArray[np.int64], levels: npt.NDArray[np.uint8], start_ns: int, duration_ns: int, top: int,
               bottom: int, left: int, right: int) -> int:  # fmt: skip
    """Enter a frame's event times into the surface, both of shape (height, 2 width), in a window of pixels; the number
    of its event pixels there."""
    count = 0
    share = duration_ns / 255.0
    for row in range(top, bottom):
        count += _keep_row(times[row], levels[row], start_ns, share, 2 * left, 2 * right)
    return count


@njit(cache=True, nogil=True)
def keep_more_times(times: npt.NDArray[np.int64], levels: npt.NDArray[np.uint8], start_ns: int, duration_ns: int,
                    top: int, bottom: int, left: int, right: int, kept: npt.NDArray[np.int64]) -> None:  # fmt: skip
    """The same for windows of which many overlap: `kept` holds which columns of each row, first .. last - 1, have been
    entered so for this frame already, shape (height, 2)."""
    share = duration_ns / 255.0
    for row in range(top, bottom):
        first, last = kept[row]
        if right < first or last < left:
            # Too far apart for one piece.
            first = last = left
        if left < first:
            _keep_row(times[row], levels[row], start_ns, share, 2 * left, 2 * first)
        if last < right:
            _keep_row(times[row], levels[row], start_ns, share, 2 * last, 2 * right)
        kept[row, 0], kept[row, 1] = min(left, first), max(right, last)


@njit(cache=True, nogil=True, forceinline=True)
def _put(point: Float32Array, row: int, column: int, channel: int, age_s: float) -> None:
    """Make a point of an event pixel."""
    point[X] = column + 0.5
    point[Y] = row + 0.5
    point[AGE] = age_s
    point[POLARITY] = 1.0 if channel == 0 else -1.0


@njit(cache=True, nogil=True)
def kept_points(times: npt.NDArray[np.int64], now_ns: int, oldest_ns: int, top: int, bottom: int, left: int, right: int,
                points: Float32Array) -> int:  # fmt: skip
    """The surface's event pixels after `oldest_ns` in a window, as points; their number. More than fit are left out."""
    count = 0
    for row in range(top, bottom):
        for column in range(left, right):
            for channel in range(2):
                time_ns = times[row, column, channel]
                if time_ns > oldest_ns and count < len(points):
                    _put(points[count], row, column, channel, (now_ns - time_ns) * 1e-9)
                    count += 1
    return count


@njit(cache=True, nogil=True)
def kept_count(times: npt.NDArray[np.int64], now_ns: int, oldest_ns: int, top: int, bottom: int, left: int, right: int
               ) -> int:  # fmt: skip
    """How many event pixels of the surface, shape (height, 2 width), in a window of pixels are after `oldest_ns` and no
    later than now."""
    count = 0
    for row in range(top, bottom):
        for at in range(np.uintp(2 * left), np.uintp(2 * right)):
            # Without a branch, many times are compared at once.
            count += (times[row, at] > oldest_ns) & (times[row, at] <= now_ns)
    return count


@njit(cache=True, nogil=True)
def fired_count(levels: npt.NDArray[np.uint8], top: int, bottom: int, left: int, right: int) -> int:
    """How many of a frame's levels, shape (height, 2 width), are above 0 in a window of pixels."""
    count = 0
    for row in range(top, bottom):
        for at in range(np.uintp(2 * left), np.uintp(2 * right)):
            count += levels[row, at] > 0
    return count


@njit(cache=True, nogil=True)
def count_within(points: Float32Array, count: int, top: int, bottom: int, left: int, right: int) -> int:
    """How many of the first `count` points lie in a window."""
    within = 0
    for index in range(count):
        x, y = points[index, X], points[index, Y]
        within += left <= x < right and top <= y < bottom
    return within


@njit(cache=True, nogil=True)
def frame_points(data: npt.NDArray[np.uint8], duration_s: float, top: int, bottom: int, left: int, right: int,
                 points: Float32Array) -> int:  # fmt: skip
    """A frame's event pixels in a window, as points; their number. More than fit are left out."""
    count = 0
    for row in range(top, bottom):
        for column in range(left, right):
            for channel in range(2):
                level = data[row, column, channel]
                if level > 0 and count < len(points):
                    _put(points[count], row, column, channel, (1 - level / 255.0) * duration_s)
                    count += 1
    return count
