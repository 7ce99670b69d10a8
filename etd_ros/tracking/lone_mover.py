"""What moves alone near the place where a fast target was seen surely. A ball that bounces off something is soon
elsewhere than where looks ask for it, and its model may know none of the edges that make events on its new way: but
where nothing else moves, its events tell where it is."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from etd_ros.boxes import Box
from etd_ros.tracking.body import Standing, Velocity, pair, sizes_per_s
from etd_ros.tracking.contour_kernels import Float32Array
from etd_ros.tracking.contours import Contours
from etd_ros.tracking.doubts import Doubts
from etd_ros.tracking.look_pace import FAST_SIZES_PER_S
from etd_ros.tracking.surface import TimeSurface, Window

RECENT_S, LASTS_S = 0.05, 0.15
"""What was seen surely longer ago is not looked for, nor longer than this after that."""
REACH_PX, REACH_SHARE, REACH_MAX_PX = 3.0, 1.2, 80.0
"""It has moved from there by no more than at so many times its speed, and this besides."""
SPANS_PX, SPAN_MIN_S, SPAN_MAX_S = (2.0, 4.0, 6.0), 0.001, 0.015
EVENTS_MIN = 25
"""The events of so much motion tell where it is: of the least that brings enough of them."""
ROUNDS = 3
BOX_MARGIN = 1.15
SHARE_MIN = 0.75
"""A box of its size holds so much of the events, beyond what it would hold of evenly strewn ones."""
EXTENT_MIN = 0.5
OUTERMOST = 0.02
"""They reach over so much of the box, but for the outermost ones."""
FINDS, FINDS_S = 3, 0.004
STRAYS_PX = 1.5
SPEED_SHARES = 0.1, 1.5
"""So many finds over this time are on one way, at a speed that is not all another one."""
TURNED_COS = 0.3
"""What is found strays where rims do not show: looks see what turns by less."""


class TurnedOff(NamedTuple):
    """A fast target where it moves alone, and another way than before: its box (pixels) and velocity."""

    box: Box
    velocity: Velocity


class LoneMover:
    """Looks for one target while its looks fail, if it was fast.

    Args:
        contours: the target's.
        surface: what the sensor sees.
        doubts: about the target.
    """

    def __init__(self, contours: Contours, surface: TimeSurface, doubts: Doubts) -> None:
        self._body, self._others = contours.body, contours.own.others
        self._surface, self._doubts = surface, doubts
        self._before: Standing | None = None
        self._box = contours.body.box
        self._speed_px_s, self._until_ns = 0.0, 0
        self._way: list[tuple[float, float, float]] = []

    @property
    def is_looking(self) -> bool:
        """Whether it is looked for now."""
        return self._before is not None and self._surface.stamp_ns < self._until_ns

    def stop(self) -> None:
        """Look for it no longer."""
        self._before = None

    def found(self, *, is_doubted: bool) -> TurnedOff | None:
        """Where the target is, once frames that followed one another have shown it there, if it has turned.

        Args:
            is_doubted: whether its looks fail. It is looked for from then on until it is seen surely.
        """
        sure, stamp_ns = self._doubts.sure, self._surface.stamp_ns
        if self._before is not None and sure is not None and sure.stamp_ns > self._before.stamp_ns:
            self._before = None
        if self._before is None:
            if not is_doubted:
                return None
            self._begin(self._doubts.seen_surely)
        if self._before is None or not self.is_looking:
            return None
        since_s = (stamp_ns - self._before.stamp_ns) * 1e-9
        place = self._place(since_s)
        if place is None:
            self._way = []
            return None
        self._way.append((since_s, *place))
        if not is_doubted or len(self._way) < FINDS or since_s - self._way[0][0] < FINDS_S:
            return None
        velocity = self._velocity()
        if velocity is None or not _has_turned(velocity, self._before.velocity):
            return None
        width, height = self._box.w, self._box.h
        return TurnedOff(Box(place[0] - width / 2, place[1] - height / 2, width, height), velocity)

    def _begin(self, before: Standing) -> None:
        """Look for the target from where it stood before."""
        self._before = before
        self._box = self._body.box_at(*before.pose[:2])
        self._speed_px_s = math.hypot(*before.velocity)
        self._way = []
        is_recent = self._surface.stamp_ns - before.stamp_ns < RECENT_S * 1e9
        is_fast = sizes_per_s(before.velocity, self._box.w, self._box.h) > FAST_SIZES_PER_S
        lasts_s = LASTS_S if is_recent and is_fast else 0.0
        self._until_ns = before.stamp_ns + round(lasts_s * 1e9)

    def _place(self, since_s: float) -> tuple[float, float] | None:
        """The middle (pixels) of what moves round the place where it was so long ago (s), if that is one thing of its
        size."""
        reach_px = min(REACH_MAX_PX, REACH_PX + REACH_SHARE * self._speed_px_s * since_s)
        window = self._surface.window(self._box.scaled(BOX_MARGIN), reach_px)
        self._surface.keep_too(window)
        points = self._events(window)
        if len(points) < EVENTS_MIN:
            return None
        places = points[:, :2].astype(np.float64)
        size_px = np.array([self._box.w, self._box.h])
        middle = np.median(places, axis=0)
        for _ in range(ROUNDS):
            within = places[(np.abs(places - middle) <= BOX_MARGIN / 2 * size_px).all(1)]
            if len(within) < EVENTS_MIN:
                return None
            low, high = np.quantile(within, (OUTERMOST, 1 - OUTERMOST), axis=0)
            middle = (low + high) / 2
        top, bottom, left, right = window
        by_chance = min(1.0, BOX_MARGIN**2 * self._box.w * self._box.h / ((bottom - top) * (right - left)))
        share = (len(within) / len(places) - by_chance) / max(1 - by_chance, 1e-9)
        if share < SHARE_MIN or (high - low < EXTENT_MIN * size_px).any():
            return None
        return float(middle[0]), float(middle[1])

    def _events(self, window: Window) -> Float32Array:
        """The newest events of a window, but for those of other targets, as points."""
        points, count = np.empty((0, 4), np.float32), 0
        for span_px in SPANS_PX:
            if count < EVENTS_MIN:
                span_s = min(max(span_px / self._speed_px_s, SPAN_MIN_S), SPAN_MAX_S)
                points, count = self._surface.points(window, span_s)
                count = self._others.leave_out(points, count, self._surface.stamp_ns)
        return points[:count]

    def _velocity(self) -> Velocity | None:
        """The velocity of the last finds, if they are on one way."""
        way = np.array([seen for seen in self._way if seen[0] >= self._way[-1][0] - 2 * FINDS_S])
        times_s = way[:, 0] - way[-1, 0]
        velocity, last = np.linalg.lstsq(np.stack([times_s, np.ones(len(way))], 1), way[:, 1:], rcond=None)[0]
        strays_px = float(np.abs(way[:, 1:] - (times_s[:, None] * velocity + last)).max())
        slowest, fastest = SPEED_SHARES
        share = math.hypot(*velocity.tolist()) / self._speed_px_s
        return pair(velocity) if strays_px <= STRAYS_PX and slowest <= share <= fastest else None


def _has_turned(velocity: Velocity, before: Velocity) -> bool:
    """Whether a velocity has another direction than it had."""
    lengths = math.hypot(*velocity) * math.hypot(*before)
    return velocity[0] * before[0] + velocity[1] * before[1] < TURNED_COS * lengths
