"""A target's box on its model: where it lies on it, and how it turns and grows with it."""

from __future__ import annotations

import math

import numpy as np

from etd_ros.boxes import Box
from etd_ros.tracking.contour_kernels import Float64Array
from etd_ros.tracking.shape import turned_reaches

Pose = tuple[float, float, float, float]
"""Of a model: x, y of its middle (pixels), scale, angle (rad)."""

ROUNDNESS = 1.7
"""p of the turned box: w^p = (a cos)^p + (b sin)^p is that of an ellipse with 2, of a rectangle with 1; things are
something between. That is taken where their shape is not known."""
OFFSET_MAX, RATIO_MAX = 0.3, 1.4
"""A box lies no farther from the model's middle than this part of its size, and is so many times as wide or high at
most: beyond, the model is of something else."""


class ModelBox:
    """The box that a target had at its start, as the model moves on, and what has been put right of it since.

    Args:
        width: of the box at scale 1 (pixels).
        height: the same.
    """

    def __init__(self, width: float, height: float) -> None:
        self.size_px = width, height
        self._offset = np.zeros(2)
        self._growth = np.zeros(2)
        self._placed_for: tuple[float, float] | None = None
        self._box: Box | None = None
        self._box_for: Pose = 0.0, 0.0, 0.0, 0.0
        self._reach: Float64Array | None = None

    def take_shape(self, reach: Float64Array | None) -> None:
        """Know how far what is in the box reaches in each direction, as `reach_of` says, if it does."""
        self._reach = reach
        self._placed_for = self._box = None

    def of(self, pose: Pose) -> Box:
        """The box, if the model's middle, scale and angle are those of a pose."""
        if self._box is None or self._box_for != pose:
            self._box, self._box_for = self.at(pose[0], pose[1], pose), pose
        return self._box

    def at(self, x: float, y: float, pose: Pose, times: float = 1.0) -> Box:
        """The box, or `times` as wide and high a one round its middle, if the model's middle is there (pixels) and its
        scale and angle are those of a pose."""
        (right_x, below_x), (right_y, below_y), (width, height) = self._placed_at(pose)
        x, y = x + right_x - below_x - width / 2, y + right_y + below_y - height / 2
        if times == 1:
            return Box(x, y, width, height)
        more = times - 1
        return Box(x - more * width / 2, y - more * height / 2, width * times, height * times)

    def size(self, pose: Pose) -> tuple[float, float]:
        """Its width and height (pixels) with the scale and angle of a pose."""
        return self._placed_at(pose)[2]

    def _placed_at(self, pose: Pose) -> tuple[tuple[float, float], ...]:
        """What `_place` says of a pose: asked for many times between two looks, which alone change it."""
        if self._placed_for != pose[2:]:
            _, _, scale, angle = pose
            self._placed_for = scale, angle
            self._placed = self._place(scale, angle)
        return self._placed

    def _place(self, scale: float, angle_rad: float) -> tuple[tuple[float, float], ...]:
        """How far the box's middle is from the model's along x and along y, by what it is off to the right and below on
        the model, each for itself; and its width and height (pixels)."""
        wider, higher = np.exp(self._growth).tolist()
        across, down = self.size_px[0] * scale, self.size_px[1] * scale
        cos, sin = math.cos(angle_rad), math.sin(angle_rad)
        right, below = (self._offset * (across, down)).tolist()
        (width, height), (beside_x, beside_y) = self._outline(across * wider, down * higher, angle_rad)
        return (cos * right + beside_x, sin * below), (sin * right + beside_y, cos * below), (width, height)

    def size_at_first(self, pose: Pose) -> tuple[float, float]:
        """Width and height (pixels) without what was put right."""
        _, _, scale, angle = pose
        return self._outline(self.size_px[0] * scale, self.size_px[1] * scale, angle)[0]

    def correct(self, right: float, below: float, wider: float, higher: float, pose: Pose) -> None:
        """Move the box on the model by so many pixels of the sensor, and make it so much wider and higher there
        (logarithms)."""
        _, _, scale, angle = pose
        cos, sin = math.cos(angle), math.sin(angle)
        across, down = (cos * right + sin * below) / scale, (cos * below - sin * right) / scale
        self._offset += np.divide((across, down), self.size_px)
        self._growth += cos**2 * wider + sin**2 * higher, cos**2 * higher + sin**2 * wider
        np.clip(self._offset, -OFFSET_MAX, OFFSET_MAX, out=self._offset)
        np.clip(self._growth, -math.log(RATIO_MAX), math.log(RATIO_MAX), out=self._growth)
        self._placed_for = self._box = None

    def reset(self) -> None:
        """Lie on the model as at the start."""
        self._offset[:] = self._growth[:] = 0
        self._placed_for = self._box = None

    def _outline(self, across: float, down: float, angle_rad: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """How wide and high the thing in the box is when turned, and how far the middle of that is to the right of and
        below its own (pixels)."""
        if angle_rad == 0:
            return (across, down), (0.0, 0.0)
        if self._reach is not None:
            left, right, up, below = turned_reaches(self._reach, across, down, angle_rad)
            return (left + right, up + below), ((right - left) / 2, (below - up) / 2)
        cos, sin = abs(math.cos(angle_rad)), abs(math.sin(angle_rad))
        width = ((across * cos) ** ROUNDNESS + (down * sin) ** ROUNDNESS) ** (1 / ROUNDNESS)
        height = ((across * sin) ** ROUNDNESS + (down * cos) ** ROUNDNESS) ** (1 / ROUNDNESS)
        return (width, height), (0.0, 0.0)
