"""Photographs that lie in scikit-image's wheel, as textures; nothing is downloaded, and the package is not imported."""

from __future__ import annotations

import importlib.util
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from etd_ros.simulation.motion import SimulationError
from etd_ros.simulation.textures import BRIGHT, DARK, Texture

PACKAGE = "skimage"
NAMES = (
    "astronaut.png", "brick.png", "camera.png", "chelsea.png", "clock_motion.png", "coffee.png", "coins.png",
    "grass.png", "gravel.png", "hubble_deep_field.jpg", "ihc.png", "motorcycle_left.png", "motorcycle_right.png",
    "page.png", "retina.jpg", "rocket.jpg", "text.png",
)  # fmt: skip
BLUR_PX = 0.6
"""Of the texture: things that shrink by a third must not shimmer."""


def photograph(rng: np.random.Generator, height: int, width: int) -> Texture:
    """A random part of a random photograph, mirrored at random.

    Args:
        rng: chooses.
        height: of the texture (pixels).
        width: of the texture (pixels).

    Returns:
        Intensities, float64, shape (height, width), within [DARK, BRIGHT].

    Raises:
        SimulationError: scikit-image is not installed, or its wheel holds none of the photographs.
    """
    image = _read(str(rng.choice(installed())))
    rows, columns = image.shape
    # As much of the photograph as fits, or less; large textures enlarge it.
    largest = min(rows / height, columns / width)
    zoom = max(min(largest, 1.0), largest * rng.uniform(0.4, 1.0))
    cut_rows, cut_columns = max(2, int(height * zoom)), max(2, int(width * zoom))
    top, left = int(rng.integers(rows - cut_rows + 1)), int(rng.integers(columns - cut_columns + 1))
    cut = image[top : top + cut_rows, left : left + cut_columns]
    scaled = cv2.resize(cut, (width, height), interpolation=cv2.INTER_AREA if zoom > 1 else cv2.INTER_LINEAR)
    if rng.uniform() < 0.5:
        scaled = scaled[:, ::-1]
    blurred = cv2.GaussianBlur(np.ascontiguousarray(scaled), (0, 0), BLUR_PX)
    return np.asarray(DARK + (BRIGHT - DARK) * np.clip(blurred, 0, 1), np.float64)


def installed() -> tuple[str, ...]:
    """Paths of the photographs, in order of their names.

    Raises:
        SimulationError: there is none.
    """
    found = importlib.util.find_spec(PACKAGE)
    folders = [] if found is None else list(found.submodule_search_locations or ())
    paths = [path for folder in folders for name in NAMES if (path := Path(folder, "data", name)).is_file()]
    if not paths:
        msg = "photographs need scikit-image's wheel: pip install scikit-image, or choose another background"
        raise SimulationError(msg)
    return tuple(map(str, paths))


@lru_cache(maxsize=len(NAMES))
def _read(path: str) -> Texture:
    image = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
    if image is None:
        msg = f"{path}: is no picture that can be read: install scikit-image again"
        raise SimulationError(msg)
    low, high = np.percentile(image, (1, 99))
    return np.asarray(np.clip((image - low) / max(high - low, 1.0), 0, 1), np.float64)
