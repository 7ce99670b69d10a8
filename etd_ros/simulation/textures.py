"""Procedural textures: intensities that look like surfaces, from a random generator and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

Texture = npt.NDArray[np.float64]
"""Intensity, float64, shape (h, w), within [DARK, BRIGHT]."""

DARK, BRIGHT = 0.15, 1.0
BLOBS = 7


def smooth_noise(rng: np.random.Generator, height: int, width: int, *, grain: float = 3.0) -> Texture:
    """Cloudy patches of about `grain` pixels over larger ones, as on stone or wallpaper."""
    coarse = gaussian_filter(rng.standard_normal((height, width)), 3 * grain, mode="wrap")
    fine = gaussian_filter(rng.standard_normal((height, width)), grain, mode="wrap")
    return _stretched(coarse / coarse.std() + fine / fine.std())


def stripes(rng: np.random.Generator, height: int, width: int, *, period: float = 9.0) -> Texture:
    """Soft stripes in a random direction."""
    angle = rng.uniform(0, np.pi)
    y, x = np.mgrid[0:height, 0:width]
    wave = np.sin(2 * np.pi * (x * np.cos(angle) + y * np.sin(angle)) / period)
    return _stretched(np.tanh(3 * wave) + 0.2 * (smooth_noise(rng, height, width) - 0.5))


def blobs(rng: np.random.Generator, height: int, width: int) -> Texture:
    """Round spots, bright and dark, on grey."""
    y, x = np.mgrid[0:height, 0:width]
    surface = np.zeros((height, width))
    for sign in np.where(np.arange(BLOBS) % 2, 1.0, -1.0):
        row, column = rng.uniform(0, height), rng.uniform(0, width)
        radius = rng.uniform(0.12, 0.22) * min(height, width)
        surface += sign / (1 + np.exp(np.hypot(x - column, y - row) - radius))
    return _stretched(surface)


def checks(rng: np.random.Generator, height: int, width: int, *, cell: int = 8) -> Texture:
    """Squares of random brightness, as on a quilt."""
    values = rng.uniform(-1, 1, (height // cell + 2, width // cell + 2))
    surface = np.kron(values, np.ones((cell, cell)))[:height, :width]
    return _stretched(gaussian_filter(surface, 0.7))


TEXTURES: dict[str, Callable[..., Any]] = {
    "smooth_noise": smooth_noise,
    "stripes": stripes,
    "blobs": blobs,
    "checks": checks,
}


def _stretched(surface: npt.NDArray[np.float64]) -> Texture:
    low, high = np.percentile(surface, (1, 99))
    return np.asarray(DARK + (BRIGHT - DARK) * np.clip((surface - low) / (high - low), 0, 1), np.float64)
