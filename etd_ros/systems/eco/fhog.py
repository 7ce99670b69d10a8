"""Histograms of oriented gradients, 31 channels a cell (Felzenszwalb et al., PAMI 2010, Section 6)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

ORIENTATIONS = 9
"""Directions without a sign; there are twice as many with it."""
CHANNELS = 3 * ORIENTATIONS + 4
"""18 directions with a sign, 9 without, and 4 gradient energies, one for each way of normalising."""
CLIP = 0.2
EPSILON = 1e-4
"""Keeps cells without gradients from being divided by zero."""
TEXTURE_SCALE = 0.2357
"""About 1 / sqrt(18), so that the energies are as large as the other channels."""

_COSINES = np.cos(np.arange(ORIENTATIONS) * np.pi / ORIENTATIONS).astype(np.float32)
_SINES = np.sin(np.arange(ORIENTATIONS) * np.pi / ORIENTATIONS).astype(np.float32)


def fhog(patch: npt.NDArray[np.uint8], cell: int) -> npt.NDArray[np.float32]:
    """Oriented gradients of a grey patch.

    A gradient votes with its magnitude for the nearest of 18 directions, bilinearly for the four nearest cells. Each
    cell is normalised by the energy of the four blocks of 2 x 2 cells that hold it (at the border, where a block lacks
    cells, its own count again), and clipped at 0.2.

    Args:
        patch: uint8, shape (height, width). What is left over by the last whole cell is not used.
        cell: side of a cell (pixels).

    Returns:
        float32, shape (31, height // cell, width // cell): directions with a sign, without, energies.
    """
    rows, columns = patch.shape[0] // cell, patch.shape[1] // cell
    histogram = np.zeros((rows, columns, 2 * ORIENTATIONS), np.float32)
    _vote(patch, cell, _COSINES, _SINES, histogram)
    channels = np.empty((CHANNELS, rows, columns), np.float32)
    _normalise(histogram, channels)
    return channels


@njit(cache=True, nogil=True)
def _vote(
    patch: npt.NDArray[np.uint8],
    cell: int,
    cosines: npt.NDArray[np.float32],
    sines: npt.NDArray[np.float32],
    histogram: npt.NDArray[np.float32],
) -> None:
    """Add each pixel's gradient to the histograms, shape (rows, columns, 18)."""
    rows, columns, directions = histogram.shape
    half = directions // 2
    height, width = rows * cell, columns * cell
    for y in range(height):
        above, below = max(y - 1, 0), min(y + 1, height - 1)
        row = (y + 0.5) / cell - 0.5
        first_row = int(np.floor(row))
        lower = np.float32(row - first_row)
        for x in range(width):
            dx = np.float32(patch[y, min(x + 1, width - 1)]) - np.float32(patch[y, max(x - 1, 0)])
            dy = np.float32(patch[below, x]) - np.float32(patch[above, x])
            if dx == 0 and dy == 0:
                continue
            best, direction = np.float32(0), 0
            for k in range(half):
                along = dx * cosines[k] + dy * sines[k]
                if along > best:
                    best, direction = along, k
                elif -along > best:
                    best, direction = -along, k + half
            magnitude = np.sqrt(dx * dx + dy * dy)
            column = (x + 0.5) / cell - 0.5
            first_column = int(np.floor(column))
            right = np.float32(column - first_column)
            for i in range(2):
                if not 0 <= first_row + i < rows:
                    continue
                share = magnitude * (lower if i else 1 - lower)
                if first_column >= 0:
                    histogram[first_row + i, first_column, direction] += share * (1 - right)
                if first_column + 1 < columns:
                    histogram[first_row + i, first_column + 1, direction] += share * right


@njit(cache=True, nogil=True)
def _normalise(histogram: npt.NDArray[np.float32], channels: npt.NDArray[np.float32]) -> None:
    """Histograms, shape (rows, columns, 18), as normalised channels, shape (31, rows, columns)."""
    rows, columns, directions = histogram.shape
    half = directions // 2
    energy = np.zeros((rows, columns), np.float32)
    for r in range(rows):
        for c in range(columns):
            for k in range(half):
                both = histogram[r, c, k] + histogram[r, c, k + half]
                energy[r, c] += both * both
    factors = np.empty(4, np.float32)
    for r in range(rows):
        for c in range(columns):
            for block in range(4):
                other_row = min(max(r + 2 * (block // 2) - 1, 0), rows - 1)
                other_column = min(max(c + 2 * (block % 2) - 1, 0), columns - 1)
                total = energy[r, c] + energy[other_row, c] + energy[r, other_column] + energy[other_row, other_column]
                factors[block] = np.float32(1) / np.sqrt(total + np.float32(EPSILON))
                channels[3 * half + block, r, c] = 0
            for k in range(directions):
                clipped_sum = np.float32(0)
                for block in range(4):
                    clipped = min(histogram[r, c, k] * factors[block], np.float32(CLIP))
                    clipped_sum += clipped
                    channels[3 * half + block, r, c] += np.float32(TEXTURE_SCALE) * clipped
                channels[k, r, c] = np.float32(0.5) * clipped_sum
            for k in range(half):
                both = histogram[r, c, k] + histogram[r, c, k + half]
                clipped_sum = np.float32(0)
                for block in range(4):
                    clipped_sum += min(both * factors[block], np.float32(CLIP))
                channels[directions + k, r, c] = np.float32(0.5) * clipped_sum
