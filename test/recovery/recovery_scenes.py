"""Pictures for the tests of recovery: a textured sprite on an even ground."""

from __future__ import annotations

import cv2
import numpy as np

from etd_ros.boxes import Box

WIDTH, HEIGHT = 240, 180


def texture(seed: int, width: int, height: int) -> np.ndarray:
    """Soft stripes and spots over the whole grey range, uint8, shape (height, width)."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(height, width)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), min(width, height) / 10)
    return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def picture(*sprites: tuple[np.ndarray, Box], width: int = WIDTH, height: int = HEIGHT, seed: int = 0) -> np.ndarray:
    """Sprites at boxes that lie on the image, on an even, slightly noisy ground."""
    image = np.full((height, width), 128, np.uint8)
    for sprite, box in sprites:
        left, top, columns, rows = (round(side) for side in box)
        image[top : top + rows, left : left + columns] = cv2.resize(sprite, (columns, rows))
    noise = np.random.default_rng(seed).normal(0, 3, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)
