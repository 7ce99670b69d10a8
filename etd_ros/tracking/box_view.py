"""What the box network sees: the newest events round a box, what the target usually looks like, and what it looked like
at first, in its box of then."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from etd_ros.boxes import Box
from etd_ros.tracking.box_view_kernels import draw_events, move_picture
from etd_ros.tracking.contour_kernels import Float32Array, Float64Array

CELLS, USUAL_SPAN = 32, 2.0
"""Cells of the grid's side, and the grid's width and height in those of the box, whatever its size."""
FIRST_CELLS, FIRST_SPAN = 24, 1.5
"""The same of what the target looked like at first: cells of the same size."""
CHANNELS, NUMBERS = 11, 8
EVENT_CHANNELS = 6
SPEED_MIN_PX_S = 5.0
"""Slower motion has no direction that can be told from noise."""
GROWTH_MAX_PER_S = 3.0
SIZE_USUAL_PX = 40.0


@dataclass(frozen=True, slots=True)
class BoxView:
    """What is seen round a box at a time.

    Attributes:
        target: whose box it is.
        stamp_ns: when (ns).
        points: as `TimeSurface.points` returns them, float32, shape (n, 4).
        span_s: the age of the oldest (s).
        box: the target's (pixels).
        velocity: x, y (pixels/s), float64, shape (2,).
        usual: what the target usually looks like, as `draw_model` draws it, twice as wide and high as the box, float32,
            shape (3, CELLS, CELLS).
        first: what it looked like at first, in its box of then, shape (3, FIRST_CELLS, FIRST_CELLS).
        sensor: width and height (pixels).
        age_s: since the target's start (s).
        growing_per_s: how fast it grows (1/s).
    """

    target: str
    stamp_ns: int
    points: Float32Array
    span_s: float
    box: Box
    velocity: Float64Array
    usual: Float32Array
    first: Float32Array
    sensor: tuple[int, int]
    age_s: float
    growing_per_s: float

    def drawn(self, box: Box, velocity: Float64Array) -> tuple[Float32Array, Float32Array]:
        """What the network takes, if the target's box and velocity are these: maps, shape (CHANNELS, CELLS, CELLS), and
        numbers, shape (NUMBERS,), both float32."""
        maps: Float32Array = np.zeros((CHANNELS, CELLS, CELLS), np.float32)
        (x, y), (right, down) = box.center, velocity.tolist()
        placed = np.array([x, y, box.w, box.h])
        inside = draw_events(self.points, len(self.points), placed, velocity, self.span_s, maps[:EVENT_CHANNELS])
        speed = math.hypot(right, down)
        along = (right / speed, down / speed) if speed > SPEED_MIN_PX_S else (0.0, 0.0)
        usual, first = maps[EVENT_CHANNELS : EVENT_CHANNELS + 2], maps[EVENT_CHANNELS + 2 : EVENT_CHANNELS + 4]
        usual[:] = _expected(self._usual_round(box), along)
        border = (CELLS - FIRST_CELLS) // 2
        first[:, border:-border, border:-border] = _expected(self.first, along)
        steps = (np.arange(CELLS) + 0.5) / CELLS * 2 - 1
        columns, rows = x + steps * box.w, y + steps * box.h
        width, height = self.sensor
        maps[-1] = ((columns >= 0) & (columns < width)) & ((rows >= 0) & (rows < height))[:, None]
        size_px = math.sqrt(box.w * box.h)
        growing = min(max(self.growing_per_s / GROWTH_MAX_PER_S, -1.0), 1.0)
        numbers = (
            math.log(size_px / SIZE_USUAL_PX), math.log(max(speed, 1.0) / size_px), *along, min(self.age_s, 1.0),
            math.log(box.w / box.h), math.log1p(inside) / 5 - 1, growing,
        )  # fmt: skip
        return maps, np.array(numbers, np.float32)

    def _usual_round(self, box: Box) -> Float32Array:
        """What the target usually looks like, round another box."""
        if box == self.box:
            return self.usual
        (x, y), (from_x, from_y) = box.center, self.box.center
        right, below = (x - from_x) / self.box.w * CELLS / 2, (y - from_y) / self.box.h * CELLS / 2
        moved = np.empty_like(self.usual)
        move_picture(self.usual, right, below, box.w / self.box.w, box.h / self.box.h, moved)
        return moved


def _expected(known: Float32Array, along: tuple[float, float]) -> Float32Array:
    """Which polarity motion along a direction makes, and where events are; shape (2, cells, cells)."""
    return np.stack([along[0] * known[0] + along[1] * known[1], known[2]])
