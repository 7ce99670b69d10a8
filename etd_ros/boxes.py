"""Boxes (x, y, w, h): float pixels, top-left corner. One box is a `Box`, many are an (n, 4) array."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from etd_ros.errors import EtdError

BoxArray = npt.NDArray[np.float64]
"""Boxes as rows x, y, w, h; float64, shape (n, 4), pixels."""


SIDE_MIN_PX = 2.0
"""Shortest side of a box that a target starts at: of what is thinner no edge can be told from the one across."""

NUMBER_MAX_PX = 1e6
"""Farther away, or larger, nothing that a sensor sees can be; sums and products of such numbers stay finite."""


class BoxError(EtdError):
    """A box that no object on this sensor can have."""


class OffSensorError(BoxError):
    """A box that would do, on another sensor."""


class Box(NamedTuple):
    """Axis-aligned box (pixels): top-left corner, width, height."""

    x: float
    y: float
    w: float
    h: float

    @property
    def center(self) -> tuple[float, float]:
        """(column, row) of the middle (pixels)."""
        return self.x + self.w / 2, self.y + self.h / 2

    def scaled(self, factor: float) -> Box:
        """A box with the same centre and `factor` times the width and height."""
        return Box(
            self.x - (factor - 1) * self.w / 2, self.y - (factor - 1) * self.h / 2, self.w * factor, self.h * factor
        )

    def at_least(self, side_px: float) -> Box:
        """The box, its shorter sides made so long (pixels) round the same middle."""
        if self.w >= side_px and self.h >= side_px:
            return self
        (x, y), w, h = self.center, max(self.w, side_px), max(self.h, side_px)
        return Box(x - w / 2, y - h / 2, w, h)

    def iou(self, other: Box) -> float:
        """Intersection over union of two boxes."""
        return float(iou(np.array([self], np.float64), other)[0])

    def check(self, width: int, height: int, name: str = "box") -> None:
        """Refuse a box that cannot hold an object of a width x height sensor.

        Raises:
            BoxError: not finite, beyond a million pixels, or no area.
            OffSensorError: not one pixel on the sensor.
        """
        self._check_area(name)
        if self.x >= width or self.y >= height or self.x + self.w <= 0 or self.y + self.h <= 0:
            msg = f"{self._text(name)} lies off the {width}x{height} sensor: give pixels from its top-left corner"
            raise OffSensorError(msg)

    def check_not_all(self, width: int, height: int, name: str = "box") -> None:
        """Refuse a box whose every side lies on the border of a width x height sensor or beyond: none could be seen.

        Raises:
            BoxError: it is one.
        """
        if self.x <= 0 and self.y <= 0 and self.x + self.w >= width and self.y + self.h >= height:
            msg = f"{self._text(name)} covers the whole {width}x{height} sensor: give the box of an object on it"
            raise BoxError(msg)

    def check_start(self, name: str = "box") -> None:
        """Refuse a box that no target can start at, on whatever sensor.

        Raises:
            BoxError: not finite, beyond a million pixels, no area, or a side below SIDE_MIN_PX.
        """
        self._check_area(name)
        if self.w < SIDE_MIN_PX or self.h < SIDE_MIN_PX:
            msg = (
                f"{self._text(name)} is too small to be followed: "
                f"width and height must be {SIDE_MIN_PX:g} pixels or more"
            )
            raise BoxError(msg)

    def _check_area(self, name: str) -> None:
        if not all(map(math.isfinite, self)):
            msg = f"{self._text(name)} is not finite: give four numbers in pixels"
            raise BoxError(msg)
        if max(map(abs, self)) > NUMBER_MAX_PX:
            msg = f"{self._text(name)} is impossible: give numbers up to {NUMBER_MAX_PX:g} pixels"
            raise BoxError(msg)
        if self.w <= 0 or self.h <= 0:
            msg = f"{self._text(name)} has no area: width and height must be above 0"
            raise BoxError(msg)

    def _text(self, name: str) -> str:
        return f"{name} (x {self.x:g}, y {self.y:g}, w {self.w:g}, h {self.h:g})"


def iou(boxes: BoxArray, box: Box) -> npt.NDArray[np.float64]:
    """Intersection over union of each row with `box`, shape (n,)."""
    return ious(boxes, np.array([box], np.float64))[:, 0]


def ious(boxes: BoxArray, others: BoxArray) -> npt.NDArray[np.float64]:
    """Intersection over union of each row with each row of the others, shape (n, m)."""
    shared = shared_areas(boxes, others)
    areas, other_areas = (rows[:, 2] * rows[:, 3] for rows in (boxes, others))
    return np.asarray(shared / (areas[:, None] + other_areas - shared), np.float64)


def shared_areas(boxes: BoxArray, others: BoxArray) -> npt.NDArray[np.float64]:
    """The area that each row has in common with each row of the others (pixels^2), shape (n, m)."""
    across, down = np.maximum(shared_sides(boxes, others), 0.0)
    return np.asarray(across * down, np.float64)


def shared_sides(boxes: BoxArray, others: BoxArray) -> npt.NDArray[np.float64]:
    """How far each row reaches into each row of the others along x and along y (pixels), below 0 by the gap between
    them, shape (2, n, m): each direction lies by itself in memory, which is twice as fast for many boxes."""
    columns, other_columns = np.ascontiguousarray(boxes.T)[:4, :, None], np.ascontiguousarray(others.T)[:4, None]
    near, other_near = columns[:2], other_columns[:2]
    far, other_far = near + columns[2:], other_near + other_columns[2:]
    return np.asarray(np.minimum(far, other_far) - np.maximum(near, other_near), np.float64)
