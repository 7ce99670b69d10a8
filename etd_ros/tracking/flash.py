"""Frames of light that changes everywhere at once: they say nothing of where a target is."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

SHARE, PURITY = 0.03, 0.85
"""So large a share of the pixels fire in a flash, and so many of their events are of one polarity: edges that move fire
in fewer pixels of a frame, and in both."""
BLOCKS, BLOCKS_MIN, BLOCK_SHARE = 4, 8, 0.015
"""Of the parts of the sensor, as many across as down, so many brighten or darken, each with such a share of its pixels:
a lamp in the scene changes fewer."""
SAMPLES = 2048
"""About so many pixels are enough to tell."""


def is_flash(data: npt.NDArray[np.uint8]) -> bool:
    """Whether a frame, uint8, shape (height, width, 2), is of light that got brighter or darker all over the sensor."""
    height, width, _ = data.shape
    return bool(_is_flash(data, max(1, math.isqrt(height * width // SAMPLES))))


@njit(cache=True, nogil=True)
def _is_flash(data: npt.NDArray[np.uint8], stride: int) -> bool:
    """`is_flash` by the pixels that are `stride` apart."""
    height, width, _ = data.shape
    pixels = on = off = brighter = darker = 0
    for block in range(BLOCKS * BLOCKS):
        down, across = block // BLOCKS, block % BLOCKS
        block_pixels = block_on = block_off = 0
        for row in range(down * height // BLOCKS, (down + 1) * height // BLOCKS, stride):
            for column in range(across * width // BLOCKS, (across + 1) * width // BLOCKS, stride):
                block_pixels += 1
                block_on += data[row, column, 0] > 0
                block_off += data[row, column, 1] > 0
        pixels, on, off = pixels + block_pixels, on + block_on, off + block_off
        if block_on + block_off > BLOCK_SHARE * block_pixels:
            brighter += block_on > PURITY * (block_on + block_off)
            darker += block_off > PURITY * (block_on + block_off)
    is_pure = max(on, off) > PURITY * (on + off)
    return on + off > SHARE * pixels and is_pure and max(brighter, darker) >= BLOCKS_MIN
