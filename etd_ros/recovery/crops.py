"""Square crops of pictures at a network's scale, and boxes between crops and pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box

Picture = npt.NDArray[np.uint8]
"""Grey, shape (rows, columns), or BGR, shape (rows, columns, 3)."""
CONTEXT = 0.5
"""Share of (w + h) around a box that an exemplar shows (Bertinetto et al. 2016)."""


class Crop(NamedTuple):
    """A crop and where it comes from.

    Attributes:
        pixels: as many channels as the image has.
        left, top: its corner on the image (pixels).
        scale: pixels of the crop for one of the image.
    """

    pixels: Picture
    left: float
    top: float
    scale: float

    def on_image(self, x: float, y: float, w: float, h: float) -> Box:
        """A box given by its centre and size on the crop (pixels) as a box on the image."""
        width, height = w / self.scale, h / self.scale
        return Box(self.left + x / self.scale - width / 2, self.top + y / self.scale - height / 2, width, height)

    def of_box(self, box: Box) -> tuple[float, float, float, float]:
        """Centre and size on the crop (pixels) of a box on the image."""
        column, row = box.center
        return (
            (column - self.left) * self.scale,
            (row - self.top) * self.scale,
            box.w * self.scale,
            box.h * self.scale,
        )


def exemplar_extent(w: float, h: float) -> float:
    """Side of the square that an exemplar of a w x h box shows (pixels of the image)."""
    padding = CONTEXT * (w + h)
    return math.sqrt((w + padding) * (h + padding))


def cut(image: Picture, center: tuple[float, float], scale: float, size: tuple[int, int]) -> Crop:
    """`size` (columns, rows) pixels around a point of an image; beyond its border is its mean.

    Args:
        image: grey or BGR.
        center: column and row (pixels).
        scale: pixels of the crop for one of the image.
        size: columns and rows of the crop (pixels).
    """
    columns, rows = size
    left, top = center[0] - columns / scale / 2, center[1] - rows / scale / 2
    mean = cv2.mean(image)
    if scale < 1:
        # Taking the area's mean keeps the noise of what is made smaller down; only the part in view is touched.
        first_column, first_row = max(0, math.floor(left)), max(0, math.floor(top))
        last_column = min(image.shape[1], math.ceil(left + columns / scale) + 1)
        last_row = min(image.shape[0], math.ceil(top + rows / scale) + 1)
        if last_column > first_column and last_row > first_row:
            part = image[first_row:last_row, first_column:last_column]
            smaller = max(1, round(part.shape[1] * scale)), max(1, round(part.shape[0] * scale))
            image = np.asarray(cv2.resize(part, smaller, interpolation=cv2.INTER_AREA), np.uint8)
            ratio_x, ratio_y = smaller[0] / part.shape[1], smaller[1] / part.shape[0]
            matrix = _matrix(scale / ratio_x, scale / ratio_y, (left - first_column) * scale, (top - first_row) * scale)
            return Crop(_warped(image, matrix, size, mean), left, top, scale)
    matrix = _matrix(scale, scale, left * scale, top * scale)
    return Crop(_warped(image, matrix, size, mean), left, top, scale)


def _matrix(scale_x: float, scale_y: float, left: float, top: float) -> npt.NDArray[np.float64]:
    # Points count from the corner of the first pixel here, from its middle in OpenCV.
    return np.array([[scale_x, 0, scale_x / 2 - 0.5 - left], [0, scale_y, scale_y / 2 - 0.5 - top]], np.float64)


def _warped(image: Picture, matrix: npt.NDArray[np.float64], size: tuple[int, int], mean: Sequence[float]) -> Picture:
    border = [round(level) for level in mean]
    warped = cv2.warpAffine(
        image, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=border
    )
    return np.asarray(warped, np.uint8)
