"""Intensity channels: a soft histogram of each cell's grey levels."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit


def membership(bins: int) -> npt.NDArray[np.float32]:
    """How much each grey level belongs to each bin, less the mean over the bins; float32, shape (256, bins).

    Bins are evenly spaced triangles that sum to 1 at every level (linear B-splines, the simplest channel
    representation of Granlund 2000). Without their mean a uniform picture gives no constant in all channels at once.
    """
    levels = np.arange(256)[:, None] * (bins - 1) / 255
    triangles = np.clip(1 - np.abs(levels - np.arange(bins)), 0, None)
    return np.asarray(triangles - 1 / bins, np.float32)


def intensity_channels(
    patch: npt.NDArray[np.uint8], cells: int, table: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """Mean membership over each of cells x cells equal parts of a square grey patch.

    Args:
        patch: uint8, shape (side, side); the side need not be a multiple of `cells`: pixels between two parts count
            for each with the share that lies in it.
        cells: parts along a side.
        table: see `membership`.

    Returns:
        float32, shape (bins, cells, cells).
    """
    channels = np.zeros((table.shape[1], cells, cells), np.float32)
    _average(patch, table, channels)
    return channels


@njit(cache=True, nogil=True)
def _average(patch: npt.NDArray[np.uint8], table: npt.NDArray[np.float32], channels: npt.NDArray[np.float32]) -> None:
    bins, cells, _ = channels.shape
    side = patch.shape[0]
    step = side / cells
    sums = np.empty(bins, np.float32)
    for r in range(cells):
        top, bottom = r * step, (r + 1) * step
        for c in range(cells):
            left, right = c * step, (c + 1) * step
            sums[:] = 0
            for y in range(int(top), min(int(np.ceil(bottom)), side)):
                height = min(y + 1.0, bottom) - max(float(y), top)
                for x in range(int(left), min(int(np.ceil(right)), side)):
                    area = np.float32(height * (min(x + 1.0, right) - max(float(x), left)))
                    level = patch[y, x]
                    for k in range(bins):
                        sums[k] += area * table[level, k]
            for k in range(bins):
                channels[k, r, c] = sums[k] / np.float32(step * step)
