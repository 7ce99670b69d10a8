"""What comes in over the border of the sensor over which a lost target has left: events where there were few."""

from __future__ import annotations

import math
from enum import Enum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.tracking.body import Body, Standing, Velocity
from etd_ros.tracking.contour_kernels import Float64Array
from etd_ros.tracking.surface import TimeSurface, Window
from etd_ros.tracking.usual_looks import EVENTS_MIN

PIECE_PX = 4
"""Events along the border are counted by pieces of this length."""
COUNTED_S = 0.015
"""The events of so much time are counted: from one search to the next."""
USUAL_S = 0.15
"""How many are usual at a piece is an average over this time: what stays there, or is always there, is not new."""
TIMES_USUAL = 2.0
"""So many times as many as usual, over the target's length along the border, are something that comes in."""
NEW_SHARE_MIN = 0.25
"""It has at least so much of what is new along the border: a camera that shakes brings new events everywhere."""
DEPTH_PX = 36.0
"""How far from the border they are counted, beyond half of the target: as far as it is looked for round a place."""
REACH_PX = 36.0
"""How far along the border it may be at once; with time, as much farther as it usually moves."""


class Side(Enum):
    """A border of the sensor: the axis across it (0: x, 1: y), and which way is outwards along that."""

    LEFT = (0, -1)
    RIGHT = (0, 1)
    TOP = (1, -1)
    BOTTOM = (1, 1)


def side_of(box: Box, width: int, height: int) -> Side:
    """The border of a sensor of this size (pixels) over which a box reaches farthest, or to which it is nearest."""
    inside_px = {
        Side.LEFT: box.x,
        Side.TOP: box.y,
        Side.RIGHT: width - box.x - box.w,
        Side.BOTTOM: height - box.y - box.h,
    }
    return min(inside_px, key=inside_px.__getitem__)


class Arrival(NamedTuple):
    """Where something comes in: a place on the border (pixels), and the velocity of a target that does so as fast as it
    usually moves (pixels/s)."""

    x: float
    y: float
    velocity: Velocity


class Arrivals:
    """Watches one border for one lost target.

    Args:
        surface: the events.
        side: the border.
        body: the target's.
        before: where it stood when it was seen last.
        usual_speed_px_s: how fast it usually moves.
    """

    def __init__(self, surface: TimeSurface, side: Side, body: Body, before: Standing, usual_speed_px_s: float) -> None:
        self._surface = surface
        self._across, self._outward = side.value
        self._along = 1 - self._across
        self._body = body
        self._before = before
        self._usual_speed_px_s = usual_speed_px_s
        size = surface.width, surface.height
        self._border = size[self._across] - 1.0 if self._outward > 0 else 0.0
        self._pieces = math.ceil(size[self._along] / PIECE_PX)
        self._usual: Float64Array | None = None
        self._counted_ns = surface.stamp_ns

    def keep(self) -> None:
        """Keep the surface up to date along the border."""
        self._surface.keep_too(self._window())

    def newest(self) -> Arrival | None:
        """Where the most events are beyond the usual ones, if that is something that comes in."""
        counts = self._counts()
        usual = self._learn_usual(counts)
        now, before = self._over_target(counts), self._over_target(usual)
        is_new = (now >= EVENTS_MIN) & (now > TIMES_USUAL * before) & self._is_in_reach()
        if not is_new.any():
            return None
        piece = int(np.argmax(np.where(is_new, now - before, 0.0)))
        new = np.maximum(counts - usual, 0.0)
        if self._over_target(new)[piece] < NEW_SHARE_MIN * new.sum():
            return None
        along, inwards = (piece + 0.5) * PIECE_PX, -self._outward * self._usual_speed_px_s
        if self._across == 0:
            return Arrival(self._border, along, (inwards, 0.0))
        return Arrival(along, self._border, (0.0, inwards))

    def _window(self) -> Window:
        """A strip inside the border."""
        box, surface = self._body.box, self._surface
        depth_px = (box.w, box.h)[self._across] / 2 + DEPTH_PX
        start = self._border + 1 - depth_px if self._outward > 0 else 0.0
        if self._across == 0:
            return surface.window(Box(start, 0.0, depth_px, surface.height), 0.0)
        return surface.window(Box(0.0, start, surface.width, depth_px), 0.0)

    def _counts(self) -> Float64Array:
        """The newest events of each piece."""
        points, count = self._surface.points(self._window(), COUNTED_S)
        pieces = (points[:count, self._along] / PIECE_PX).astype(np.int64)
        return np.bincount(pieces, minlength=self._pieces).astype(np.float64)

    def _learn_usual(self, counts: Float64Array) -> Float64Array:
        """Take counts into the usual ones; what was usual before them."""
        stamp_ns = self._surface.stamp_ns
        elapsed_s, self._counted_ns = (stamp_ns - self._counted_ns) * 1e-9, stamp_ns
        before = counts if self._usual is None else self._usual
        self._usual = before + (1 - math.exp(-elapsed_s / USUAL_S)) * (counts - before)
        return before

    def _over_target(self, counts: Float64Array) -> Float64Array:
        """For each piece the sum over as many round it as the target is long."""
        box = self._body.box
        length = round((box.w, box.h)[self._along] / PIECE_PX)
        return np.convolve(counts, np.ones(min(max(length, 1), len(counts))), "same")

    def _is_in_reach(self) -> npt.NDArray[np.bool_]:
        """For each piece, whether the target may have come so far along the border."""
        unseen_s = (self._surface.stamp_ns - self._before.stamp_ns) * 1e-9
        places = (np.arange(self._pieces) + 0.5) * PIECE_PX
        reach_px = REACH_PX + self._usual_speed_px_s * unseen_s
        return np.asarray(np.abs(places - self._before.pose[self._along]) < reach_px, np.bool_)
