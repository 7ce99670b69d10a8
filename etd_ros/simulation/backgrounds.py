"""What is behind the things: walls, clutter, tiles, photographs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.simulation.photographs import photograph
from etd_ros.simulation.textures import BRIGHT, DARK, Texture, checks, smooth_noise

SUBPIXEL_BITS = 3


def wall(rng: np.random.Generator, height: int, width: int) -> Texture:
    """Rough plaster, of low contrast and lit from one side."""
    fall = np.linspace(rng.uniform(0.7, 1.0), rng.uniform(0.7, 1.0), width)
    return _bounded((0.5 + rng.uniform(0.08, 0.2) * (smooth_noise(rng, height, width, grain=2.5) - 0.5)) * fall)


def cloudy(rng: np.random.Generator, height: int, width: int) -> Texture:
    """Patches of middling contrast."""
    return _bounded(
        0.3
        + rng.uniform(0.3, 0.6) * smooth_noise(rng, height, width, grain=min(height, width) * rng.uniform(0.015, 0.03))
    )


def clutter(rng: np.random.Generator, height: int, width: int) -> Texture:
    """Discs and boxes of all sizes and tones over each other (dead leaves), as a full shelf or a street."""
    image = np.full((height, width), 0.5)
    area, covered = height * width, 0.0
    smallest, largest = max(4.0, 0.025 * min(height, width)), 0.25 * min(height, width)
    while covered < 3 * area:
        # Sizes r with density r^-3 make pictures whose statistics do not depend on the scale.
        radius = 1 / np.sqrt(rng.uniform(1 / largest**2, 1 / smallest**2))
        x, y, tone = rng.uniform(0, width), rng.uniform(0, height), float(rng.uniform(DARK, BRIGHT))
        if rng.uniform() < 0.4:
            centre = (round(x * 2**SUBPIXEL_BITS), round(y * 2**SUBPIXEL_BITS))
            cv2.circle(image, centre, round(radius * 2**SUBPIXEL_BITS), tone, cv2.FILLED, cv2.LINE_8, SUBPIXEL_BITS)
        else:
            box = ((x, y), (2 * radius * rng.uniform(0.4, 1.0), 2 * radius), rng.uniform(0, 90))
            corners = np.rint(cv2.boxPoints(box) * 2**SUBPIXEL_BITS).astype(np.int32)
            cv2.fillPoly(image, [corners], tone, cv2.LINE_8, SUBPIXEL_BITS)
        covered += 3 * radius**2
    return _bounded(cv2.GaussianBlur(image, (0, 0), 0.8))


def tiles(rng: np.random.Generator, height: int, width: int) -> Texture:
    """Squares of random brightness."""
    surface = checks(rng, height, width, cell=round(min(height, width) * rng.uniform(0.07, 0.18)))
    return _bounded(0.25 + rng.uniform(0.3, 0.75) * surface)


def photo(rng: np.random.Generator, height: int, width: int) -> Texture:
    """A photograph of scikit-image's wheel.

    Raises:
        SimulationError: scikit-image is missing.
    """
    return photograph(rng, height, width)


BACKGROUNDS: dict[str, Callable[[np.random.Generator, int, int], Texture]] = {
    make.__name__: make for make in (wall, cloudy, clutter, tiles, photo)
}
"""Makes a background of a height and width (pixels), by name."""


def _bounded(surface: npt.NDArray[Any]) -> Texture:
    return np.asarray(np.clip(surface, DARK, BRIGHT), np.float64)
