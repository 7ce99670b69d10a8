"""Pixels that follow the light late: a photoreceptor's bandwidth is finite, and falls with the light (Hu et al. 2021,
v2e). Things that are fast lose contrast, and trail events behind them."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from etd_ros.simulation.motion import FloatArray
from etd_ros.simulation.rendering import TILE, Tiles, copy_tiles

DARKEST_SHARE = 0.1
"""Of the bandwidth that the brightest pixels have: the darkest ones have no less."""
SETTLED = 1e-3
"""A pixel this near to the light's logarithm has arrived."""


class Photoreceptors:
    """A first-order low pass on each pixel's log intensity.

    Args:
        light: log intensity at first, at which the pixels have arrived; float64, shape (height, width).
        bandwidth_hz: of a pixel at intensity 1.

    Attributes:
        before, after: what the pixels make of it at the last two times, like `light`.
        changed: squares of TILE pixels in which these may differ, bool, shape (rows, columns).
    """

    def __init__(self, light: FloatArray, bandwidth_hz: float) -> None:
        self.before, self.after = light.copy(), light.copy()
        height, width = light.shape
        self.changed: Tiles = np.zeros((-(-height // TILE), -(-width // TILE)), np.bool_)
        self._rate_hz = 2 * math.pi * bandwidth_hz

    def advance(self, light_before: FloatArray, light_after: FloatArray, changed: Tiles, duration_s: float) -> None:
        """Follow the light for a time (s), in which its logarithm goes evenly from one value to the other; these differ
        in the squares in `changed` alone."""
        copy_tiles(self.after, self.before, self.changed)
        self.changed |= changed
        _follow(self.before, self.after, light_before, light_after, self.changed, self._rate_hz * duration_s)


@njit(cache=True, nogil=True)
def _follow(before: FloatArray, after: FloatArray, light_before: FloatArray, light_after: FloatArray, changed: Tiles,
            reach: float) -> None:  # fmt: skip
    """Move each pixel of the changed squares on by as many time constants as `reach` times its intensity, where
    the light changes evenly. A square in which all had arrived, at a light that stays, has not changed."""
    height, width = before.shape
    for tile_row in range(changed.shape[0]):
        for tile in range(changed.shape[1]):
            if not changed[tile_row, tile]:
                continue
            farthest = 0.0
            for row in range(tile_row * TILE, min(height, (tile_row + 1) * TILE)):
                for column in range(tile * TILE, min(width, (tile + 1) * TILE)):
                    way = light_before[row, column] - before[row, column]
                    change = light_after[row, column] - light_before[row, column]
                    farthest = max(farthest, abs(way), abs(way + change))
                    halfway = (light_before[row, column] + light_after[row, column]) / 2
                    constants = reach * min(max(math.exp(halfway), DARKEST_SHARE), 1.0)
                    # Behind an even change a pixel is late by a time constant in the end.
                    lag = change / constants
                    way_left = lag + (way - lag) * math.exp(-constants)
                    after[row, column] = light_after[row, column] - way_left
            changed[tile_row, tile] = farthest > SETTLED
