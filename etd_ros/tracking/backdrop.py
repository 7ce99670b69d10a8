"""What moves as one round a target: what lies behind it, before a camera that moves.

Where that moves otherwise than the target, its events are left out of looks and of what they teach: a model that learns
them is drawn along. Where both move nearly alike they cannot be told apart in the time of a look.
"""

from __future__ import annotations

import math

import numpy as np

from etd_ros.tracking.backdrop_kernels import keep_own, ring_shift
from etd_ros.tracking.body import Velocity
from etd_ros.tracking.contour_drawing import room_for_parts
from etd_ros.tracking.contour_kernels import AGE, Float32Array, Float64Array
from etd_ros.tracking.surface import NEVER_NS, TimeSurface, Window

CELL = 1.5
"""Cells of its grid in those of the model."""
BOX_MARGIN = 1.1
"""Width and height in those of the box of what is left out of the ring round the target."""
PARTS = 3
"""The time of a look is taken in so many parts, whose events have to agree."""
MOTION_PX, SPAN_S = 4.0, (0.006, 0.04)
"""Its velocity is told from the events of so much motion, within these times."""
ALIKE_MIN = 0.5
"""The older and the newer half of them are so much alike where the ring moves as one."""
EVENTS_MIN, SIDE_SHARE_MIN = 40, 0.05
"""Fewer events in the ring tell nothing, and what moves as one has so many of them on three sides at least:
what passes it, or reaches out of its box, lies on one or two."""
START_FITS = 3
"""A start's events are looked at so many times, each time from what was found before."""
NEAR_CELLS, FAR_CELLS = 2, 5
"""How far the newer half is looked for where the velocity is known, and where it is not."""
SPEED_MAX_PX_S = 2000.0
SETTLED_PX = 0.75
"""The velocity is believed once a look finds the newer half no farther from where it should be: what falls together by
chance, as along an edge, lies elsewhere each time."""
APART_PX = 2.5
"""By so much more or otherwise it has to move in the time of a look than the target does."""
OWN_MIN, OWN_SHARE_MIN = 12, 0.25
"""Where fewer events, or a smaller share, would be left as the target's, all are kept: the target moves otherwise
than was believed, perhaps as what is round it."""
AGAIN_S, SELDOM_S = 0.01, 0.08
"""How old its velocity may be where it is in doubt, or apart from the target's as that is now, and where not."""


class Backdrop:
    """The velocity of what moves as one round a target.

    Args:
        size_px: width and height of the target's box (pixels).
        cell_px: pixels of a model's cell.
        margin: width and height of the model in those of the box.
        margin_px: how far round the model events are known (pixels).

    Attributes:
        velocity: as far as it is known.
        is_known: whether what is round the target seems to move as one.
        is_settled: whether the last look has found it near where it should have been.
    """

    def __init__(self, size_px: tuple[float, float], cell_px: float, margin: float, margin_px: float) -> None:
        self.forget()
        self._cell_px = CELL * cell_px
        columns, rows = (math.ceil((margin * side + 2 * margin_px) / self._cell_px) + 4 for side in size_px)
        down, across = np.ogrid[:rows, :columns]
        half_width, half_height = (BOX_MARGIN * side / self._cell_px / 2 for side in size_px)
        is_beside = np.abs(across - (columns - 1) / 2) > half_width
        is_below_or_above = np.abs(down - (rows - 1) / 2) > half_height
        self._ring = np.asarray(is_beside | is_below_or_above, np.float32)
        self._sides = np.zeros(4)
        self._halves = np.zeros((2, rows, columns), np.float32)
        self._room = np.zeros((rows, columns), np.float32)
        self._room_for_parts = room_for_parts(PARTS, rows, columns)

    def forget(self) -> None:
        """The target is elsewhere, or at another time."""
        self.velocity: Velocity = (0.0, 0.0)
        self.is_known = self.is_settled = False
        self._seen_ns = NEVER_NS

    @property
    def span_s(self) -> float:
        """Of how long a time it wants to see the events (s)."""
        shortest_s, longest_s = SPAN_S
        return min(max(MOTION_PX / max(math.hypot(*self.velocity), 1.0), shortest_s), longest_s)

    def is_due(self, stamp_ns: int, velocity: Velocity, span_s: float) -> bool:
        """Whether it is time (ns) to see how it moves: soon where it is in doubt, or can be told from a target of a
        velocity (pixels/s) in the time of a look (s)."""
        is_in_doubt = self.is_known and not self.is_settled
        wait_s = AGAIN_S if is_in_doubt or self._is_apart(velocity, span_s) else SELDOM_S
        # A stream that starts again is before the time at which it was seen.
        return not 0 <= stamp_ns - self._seen_ns < wait_s * 1e9

    def look(self, surface: TimeSurface, window: Window, pose: Float64Array) -> None:
        """See how it moves now, by the events of a window in which they are known, round where the target should be:
        upright, as the pose of `Body`."""
        seen_s = self.span_s
        self.see(*surface.points(window, seen_s), pose, seen_s)
        self._seen_ns = surface.stamp_ns

    def see(self, points: Float32Array, count: int, pose: Float64Array, span_s: float) -> None:
        """Tell the velocity from the events of a time (s), round the target's pose at its end."""
        reach = NEAR_CELLS if self.is_known else FAR_CELLS
        believed = np.array(self.velocity)
        right_px, down_px, alike = ring_shift(
            points, count, pose, self._cell_px, believed, span_s, self._ring, reach, self._halves, self._room,
            self._sides,
        )  # fmt: skip
        events = self._sides.sum()
        surrounds = events >= EVENTS_MIN and np.sort(self._sides)[1] >= SIDE_SHARE_MIN * events
        velocity = self.velocity[0] + right_px / (span_s / 2), self.velocity[1] + down_px / (span_s / 2)
        self.is_known = bool(surrounds and alike >= ALIKE_MIN and math.hypot(*velocity) <= SPEED_MAX_PX_S)
        self.is_settled = self.is_known and math.hypot(right_px, down_px) <= SETTLED_PX
        self.velocity = velocity if self.is_known else (0.0, 0.0)

    def see_start(self, events: Float32Array, pose: Float64Array, time_s: float) -> None:
        """Tell the velocity from the events of a start, whose ages count backwards from it, round the target's pose
        then, in a time since (s)."""
        points = events.copy()
        points[:, AGE] += np.float32(time_s)
        for _ in range(START_FITS):
            self.see(points, len(points), pose, time_s)

    def is_with(self, velocity: Velocity, span_s: float) -> bool:
        """Whether it moves as a target of a velocity (pixels/s) does, as far as a time (s) tells."""
        return self.is_settled and not self._is_apart(velocity, span_s)

    def _is_apart(self, velocity: Velocity, span_s: float) -> bool:
        """Whether it can be told from a target of a velocity (pixels/s) in a time (s)."""
        return self.is_settled and math.dist(self.velocity, velocity) * span_s >= APART_PX

    def keep_own(self, points: Float32Array, count: int, pose: Float64Array, velocity: Velocity, span_s: float) -> int:
        """Keep the points that are of a target with this pose and velocity (pixels/s), of a time (s), in place; how
        many they are."""
        if not self._is_apart(velocity, span_s):
            return count
        least = max(OWN_MIN, round(OWN_SHARE_MIN * count))
        own, behind = np.array(velocity), np.array(self.velocity)
        columns, room = self._ring.shape[1], self._room_for_parts
        return int(keep_own(points, count, pose, self._cell_px, own, behind, span_s, least, columns, room))
