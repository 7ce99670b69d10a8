"""What a target looked like, and where on an image something looks like it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box

GreyImage = npt.NDArray[np.uint8]

PATCH_SIDE_MIN = 4
PATCH_SIDE_MAX = 64
"""Exemplars are kept at most this large (pixels): more detail costs time and finds nothing more."""
CONTEXT = 4.0
"""Width and height of an exemplar's surroundings in those of its box: what OpenCV's trackers look at."""


@dataclass(frozen=True, slots=True)
class Exemplar:
    """A remembered target.

    Attributes:
        patch: its box's pixels, uint8, shape (rows, columns), 4 to 64 pixels a side.
        context: the pixels around it as well, uint8, with the box in the middle.
        size: width and height of its box on the sensor (pixels).
        scale: pixels of the patch for one of the sensor.
    """

    patch: GreyImage
    context: GreyImage
    size: tuple[float, float]
    scale: float

    @classmethod
    def cut(cls, image: GreyImage, box: Box) -> Exemplar:
        """The exemplar of a box whose centre lies on the image."""
        scale = min(1.0, PATCH_SIDE_MAX / max(box.w, box.h))
        columns, rows = (max(PATCH_SIDE_MIN, round(side * scale)) for side in (box.w, box.h))
        context_size = round(CONTEXT * columns), round(CONTEXT * rows)
        window, (left, top) = cut_window(image, box.scaled(CONTEXT + 1), scale)
        column, row = (box.center[0] - left) * scale, (box.center[1] - top) * scale
        patch = crop(window, column, row, (columns, rows))
        return cls(patch, crop(window, column, row, context_size), (box.w, box.h), scale)

    @property
    def context_box(self) -> tuple[int, int, int, int]:
        """x, y, w, h of the target in `context`."""
        rows, columns = self.patch.shape
        return (self.context.shape[1] - columns) // 2, (self.context.shape[0] - rows) // 2, columns, rows


def cut_window(image: GreyImage, box: Box, scale: float) -> tuple[GreyImage, tuple[int, int]]:
    """The part of an image in a box, `scale` (at most 1) times its size, and its column and row on the image."""
    height, width = image.shape
    left, top = max(0, int(box.x)), max(0, int(box.y))
    right, bottom = min(width, int(np.ceil(box.x + box.w))), min(height, int(np.ceil(box.y + box.h)))
    window = image[top : max(bottom, top + 1), left : max(right, left + 1)]
    if scale < 1:
        size = max(1, round(window.shape[1] * scale)), max(1, round(window.shape[0] * scale))
        window = np.asarray(cv2.resize(window, size, interpolation=cv2.INTER_AREA), np.uint8)
    return window, (left, top)


def crop(image: GreyImage, column: float, row: float, size: tuple[int, int]) -> GreyImage:
    """`size` (columns, rows) pixels around a point, between pixels where need be; the border's pixels go on."""
    # A point's coordinates count from the corner of the first pixel, OpenCV's from its middle.
    return np.asarray(cv2.getRectSubPix(image, size, (column - 0.5, row - 0.5)), np.uint8)


def correlation(patch: GreyImage, other: GreyImage, texture_min: float) -> float:
    """Zero-mean normalised correlation of two patches of one shape, -1 to 1; 0 if either has too little texture.

    Args:
        patch: uint8, shape (rows, columns).
        other: uint8, the same shape.
        texture_min: smallest standard deviation that counts as texture (grey levels).
    """
    a, b = patch.astype(np.float64), other.astype(np.float64)
    deviations = float(a.std()), float(b.std())
    if min(deviations) < texture_min:
        return 0.0
    return float(((a - a.mean()) * (b - b.mean())).mean() / (deviations[0] * deviations[1]))


def correlation_map(window: GreyImage, patch: GreyImage, texture_min: float) -> npt.NDArray[np.float32]:
    """`correlation` of a patch with every place of a window, float32, shape (places down, places across).

    Empty if the patch does not fit into the window.
    """
    rows, columns = patch.shape
    if window.shape[0] < rows or window.shape[1] < columns:
        return np.empty((0, 0), np.float32)
    scores = cv2.matchTemplate(window, patch, cv2.TM_CCOEFF_NORMED)
    # Without texture OpenCV's score is 0 / 0 and may read as a perfect match.
    pixels = window.astype(np.float32)
    size, anchor = (columns, rows), (0, 0)
    mean = cv2.boxFilter(pixels, cv2.CV_32F, size, anchor=anchor)
    variance = cv2.sqrBoxFilter(pixels, cv2.CV_32F, size, anchor=anchor) - mean * mean
    textured = variance[: scores.shape[0], : scores.shape[1]] >= texture_min**2
    return np.where(textured & np.isfinite(scores), scores, np.float32(0))
