"""Mean-shift clustering (Comaniciu and Meer 2002) of event packets, as in Barranco et al. 2018."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]

STOP_SHARE = 1e-3
"""A mean that moves less than this share of the bandwidth has arrived."""
MERGE_SHARE = 0.5
"""Modes closer together than this share of the bandwidth are one cluster."""
STEPS_MAX = 300
"""A mean that has not arrived by then is taken as it is: without a bound rounding could keep it moving."""
FEATURES = 3
_ROWS = 16


def mean_shift(features: FloatArray, bandwidth: float) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Modes of the density of points, and which of them each point belongs to.

    From the first point that none has passed by, a mean moves to the weighted mean of the points within the bandwidth,
    exp(-d^2 / (2 bandwidth^2)), until it has arrived; points within the bandwidth of its way count as passed by and
    vote for its mode. A mode close to an earlier one becomes one with it, in the middle between both. A point belongs
    to the mode that it has voted for most often.

    Args:
        features: float64, shape (n, 3), n at least 1; the first two from 0 to below 1.
        bandwidth: of the kernel, in the features' units, above 0.

    Returns:
        (modes, float64, shape (m, 3); the index of each point's mode, int64, shape (n,)).
    """
    cells = max(1, int(1 / bandwidth))
    columns, rows = (np.minimum((features[:, axis] * cells).astype(np.int64), cells - 1) for axis in (0, 1))
    cell = rows * cells + columns
    order = np.argsort(cell, kind="stable")
    first = np.searchsorted(cell[order], np.arange(cells * cells + 1))
    modes, labels = _modes(features[order], np.argsort(order), first, cells, bandwidth)
    by_point = np.empty(len(features), np.int64)
    by_point[order] = labels
    return modes, by_point


@njit(cache=True, nogil=True)
def _modes(points: Any, starts: Any, first: Any, cells: int, bandwidth: float) -> Any:
    """Modes and labels of points that are sorted by cells at least as wide as the bandwidth.

    Args:
        points: float64, shape (n, 3).
        starts: the points in the order in which means start from them, int64, shape (n,).
        first: where each cell's points begin, and their end, int64, shape (cells^2 + 1,).
        cells: number of cells in a row.
        bandwidth: of the kernel.
    """
    count = len(points)
    is_passed = np.zeros(count, np.bool_)
    votes = np.zeros((_ROWS, count), np.int32)
    modes = np.empty((_ROWS, FEATURES))
    found = 0
    mean, moved = np.empty(FEATURES), np.empty(FEATURES)
    of_way = np.zeros(count, np.int32)
    stop = (STOP_SHARE * bandwidth) ** 2
    merge = (MERGE_SHARE * bandwidth) ** 2
    for start in starts:
        if is_passed[start]:
            continue
        of_way[:] = 0
        mean[:] = points[start]
        for _ in range(STEPS_MAX):
            _move(points, first, cells, bandwidth, mean, moved, of_way)
            shift = 0.0
            for axis in range(FEATURES):
                shift += (moved[axis] - mean[axis]) ** 2
                mean[axis] = moved[axis]
            if shift < stop:
                break
        mode = 0
        while mode < found:
            distance = 0.0
            for axis in range(FEATURES):
                distance += (modes[mode, axis] - mean[axis]) ** 2
            if distance < merge:
                break
            mode += 1
        if mode < found:
            for axis in range(FEATURES):
                modes[mode, axis] = (modes[mode, axis] + mean[axis]) / 2
        else:
            if found == len(modes):
                votes = np.concatenate((votes, np.zeros_like(votes)))
                modes = np.concatenate((modes, np.empty_like(modes)))
            modes[mode] = mean
            found += 1
        for point in range(count):
            votes[mode, point] += of_way[point]
            is_passed[point] |= of_way[point] > 0
    labels = np.zeros(count, np.int64)
    for point in range(count):
        for mode in range(1, found):
            if votes[mode, point] > votes[labels[point], point]:
                labels[point] = mode
    return modes[:found], labels


@njit(cache=True, nogil=True)
def _move(points: Any, first: Any, cells: int, bandwidth: float, mean: Any, moved: Any, of_way: Any) -> None:
    """One step of a mean to `moved`, counting the points in its reach in `of_way`."""
    reach = bandwidth * bandwidth
    scale = -0.5 / reach
    column, row = int(mean[0] * cells), int(mean[1] * cells)
    total = x = y = age = 0.0
    for near_row in range(max(0, row - 1), min(cells, row + 2)):
        begin = first[near_row * cells + max(0, column - 1)]
        end = first[near_row * cells + min(cells - 1, column + 1) + 1]
        for point in range(begin, end):
            dx, dy = points[point, 0] - mean[0], points[point, 1] - mean[1]
            da = points[point, 2] - mean[2]
            distance = dx * dx + dy * dy + da * da
            if distance <= reach:
                weight = np.exp(scale * distance)
                total += weight
                x += weight * dx
                y += weight * dy
                age += weight * da
                of_way[point] += 1
    moved[0], moved[1], moved[2] = mean[0] + x / total, mean[1] + y / total, mean[2] + age / total
