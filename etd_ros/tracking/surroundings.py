"""What moves round a target's start box: where little else does, it is the target, even if it has left the box."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numba import njit

from etd_ros.boxes import Box
from etd_ros.tracking.contour_kernels import AGE, Float32Array, Float64Array, X, Y
from etd_ros.tracking.other_targets import OtherBoxes
from etd_ros.tracking.surface import TimeSurface, Window

SPAN, OLD_SPAN = 3.0, 5.0
"""Width and height of the surroundings in those of the box; of one that is old when its first frame comes."""
LATE_S, OLD_S = 0.05, 0.15
"""A box is late, or old, if so long after it nobody looked at its frames: what moves has left a part of it, or all."""
STEPS = 12
"""Velocities are tried in so many steps to each side, up to those that bring the box to the surroundings' border."""
BOX_MARGIN = 1.1
"""Width and height of what counts as the box in those of it."""
EVENTS_MIN, EVENTS_MAX = 25, 16_000
"""Fewer say nothing; where there are more, much moves, or something large that the box's own events tell of. A frame
that has more than a surface tells at once has more than these."""
SHARE_MAX, SHARE_MIN, MORE_MIN = 0.6, 0.8, 0.25
"""The box at the velocity believed so far holds no more than the first of the events beyond what evenly strewn ones
would be, at another velocity at least the second, and by so much more than there."""
LATE_SHARE_MAX, LATE_MORE_MIN = 0.95, 0.08
"""The same of a late one."""
BY_CHANCE_MAX = 0.5
"""A box that fills more of its surroundings than this, at the sensor's borders, holds most events wherever it is."""
COUNTED_MAX = 1000
"""Of more events every second, third, ... is counted: several hundred velocities are tried."""
BEST_SHARE = 0.9
"""All velocities at which it holds this part of what it holds at the best one are possible."""

FloatT = TypeVar("FloatT", float, Float64Array)
_NONE = np.empty((0, 2))


class Surroundings:
    """The events round a target's start box.

    Args:
        box: at the start (pixels).
        start_ns: the time of the start (ns).
        late_s: how long after it the first frame starts that is looked at (s), though there were others meanwhile.
    """

    def __init__(self, box: Box, start_ns: int, late_s: float = 0.0) -> None:
        self._box, self._start_ns = box, start_ns
        self._frames: list[Float32Array] = []
        self._count = 0
        self._by_chance = 1.0
        self._is_late = late_s > LATE_S
        self._span = OLD_SPAN if late_s > OLD_S else SPAN

    @property
    def step_px(self) -> float:
        """How far the places to which these velocities have brought the box lie apart (pixels)."""
        return (self._span - 1) / 2 / STEPS * max(self._box.w, self._box.h)

    @property
    def events(self) -> Float32Array:
        """Those so far, as points whose ages count backwards from the start, shape (n, 4)."""
        return np.concatenate([np.empty((0, 4), np.float32), *self._frames])

    def take(self, surface: TimeSurface, others: OtherBoxes) -> None:
        """Take the newest frame's events, but for those of other targets."""
        if self._count > EVENTS_MAX:
            return
        window = surface.window(self._box.scaled(self._span), 0.0)
        points, count = surface.newest(window)
        count = others.leave_out(points, count, surface.stamp_ns)
        if count == 0:
            return
        self._by_chance = _pixels(surface.window(self._box.scaled(BOX_MARGIN), 0.0)) / _pixels(window)
        kept = points[:count].copy()
        kept[:, AGE] -= np.float32((surface.stamp_ns - self._start_ns) * 1e-9)
        self._frames.append(kept)
        self._count += count
        if self._count > EVENTS_MAX:
            self._frames.clear()

    def velocities(self, believed: Float64Array, time_s: float) -> Float64Array:
        """Velocities (pixels/s) at which the box would hold nearly all events round it, if it does not at the one
        believed so far, shape (velocities, 2); none where it does, or where no velocity does.

        Args:
            believed: so far (pixels/s).
            time_s: since the start, or a little more (s).
        """
        if not EVENTS_MIN <= self._count <= EVENTS_MAX or self._by_chance > BY_CHANCE_MAX:
            return _NONE
        events = np.ascontiguousarray(self.events[:: 1 + self._count // COUNTED_MAX])
        box = np.array([*self._box.center, self._box.w, self._box.h])
        by_chance = self._by_chance
        now = _beyond_chance(_held(events, box, *believed.tolist()) / len(events), by_chance)
        share_max, more_min = (LATE_SHARE_MAX, LATE_MORE_MIN) if self._is_late else (SHARE_MAX, MORE_MIN)
        if now > share_max:
            return _NONE
        reach_px_s = (self._span - 1) / 2 * box[2:] / time_s
        shares = _beyond_chance(_held_at_steps(events, box, reach_px_s / STEPS) / len(events), by_chance)
        best = float(shares.max())
        if best < max(SHARE_MIN, now + more_min):
            return _NONE
        down, right = np.nonzero(shares >= BEST_SHARE * best)
        return np.asarray((np.stack([right, down], 1) / STEPS - 1) * reach_px_s)


def _pixels(window: Window) -> int:
    top, bottom, left, right = window
    return (bottom - top) * (right - left)


def _beyond_chance(share: FloatT, by_chance: float) -> FloatT:
    """A share of the events (one or many), less what evenly strewn ones would have of it, in parts of the rest."""
    return (share - by_chance) / (1 - by_chance)


@njit(cache=True, nogil=True)
def _held(events: Float32Array, box: Float64Array, right_px_s: float, down_px_s: float) -> int:
    """How many events a box holds that moves at a velocity from the start on; box: x, y of its middle, width and height
    (pixels)."""
    half_width_px, half_height_px = box[2] / 2 * BOX_MARGIN, box[3] / 2 * BOX_MARGIN
    count = 0
    for index in range(len(events)):
        since_s = -events[index, AGE]
        across_px = abs(events[index, X] - box[0] - right_px_s * since_s)
        down_px = abs(events[index, Y] - box[1] - down_px_s * since_s)
        count += across_px <= half_width_px and down_px <= half_height_px
    return count


@njit(cache=True, nogil=True)
def _held_at_steps(events: Float32Array, box: Float64Array, step_px_s: Float64Array) -> Float64Array:
    """The same at STEPS steps of the velocity to each side, shape (down, right).

    Whether an event lies between the box's sides depends on one part of the velocity only: so that is asked once a
    step of it, not once a velocity.
    """
    sides = 2 * STEPS + 1
    beside = np.empty((2, sides, len(events)), np.uint8)
    for axis in range(2):
        half_px = box[2 + axis] / 2 * BOX_MARGIN
        for number in range(sides):
            px_s = (number - STEPS) * step_px_s[axis]
            for index in range(len(events)):
                off_px = abs(events[index, axis] - box[axis] - px_s * -events[index, AGE])
                beside[axis, number, index] = off_px <= half_px
    held = np.empty((sides, sides))
    for down in range(sides):
        for right in range(sides):
            of_right, of_down = beside[0, right], beside[1, down]
            count = 0
            for index in range(len(events)):
                count += of_right[index] & of_down[index]
            held[down, right] = count
    return held
