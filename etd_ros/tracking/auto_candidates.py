"""What may become a target by itself: something that was seen to move, look after look."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from etd_ros.boxes import Box
from etd_ros.tracking.clusters import Sighting

STEADY_IOU = 0.6
"""A candidate's box is steady if it fits the one before it, moved on, at least so well."""
WAY_LOOKS = 16
"""Whether a candidate goes anywhere is told from so many looks at most: what turns back goes somewhere in between."""
WAY_ERRORS = 3.0
"""It does if its velocity is so many times its standard error: what flickers is seen now here, now there."""
BOX_ERROR_SHARE = 0.015
"""Boxes are off by this share of their longer side at least, also where a few of them happen to lie on a line."""


@dataclass(slots=True)
class Candidate:
    """Something that may become a target, or that a target is on.

    Attributes:
        sighting: the last one of it.
        stamp_ns: when that was (ns).
        first_ns: when it was seen first (ns).
        start: where its middle was then (pixels).
        looks: how often it was seen.
        fit: IoU of its last box with the one before it, moved on.
        is_taken: whether a target is on it.
        inside: the targets that lie in it as its parts do, and the times (ns) of the looks in a row in which they did.
    """

    sighting: Sighting
    stamp_ns: int
    first_ns: int
    start: tuple[float, float]
    looks: int = 1
    fit: float = 0.0
    is_taken: bool = False
    inside: dict[str, tuple[int, ...]] = field(default_factory=dict)
    _way: deque[tuple[float, float, float]] = field(default_factory=lambda: deque(maxlen=WAY_LOOKS))

    def __post_init__(self) -> None:
        self._way.append((0.0, *self.start))

    def fits(self, sighting: Sighting, stamp_ns: int) -> float:
        """IoU of a sighting's box with where the candidate has got to, with the mean of both velocities."""
        half_s = (stamp_ns - self.stamp_ns) * 0.5e-9
        box, (vx, vy) = self.sighting.box, np.add(self.sighting.velocity, sighting.velocity)
        return Box(box.x + vx * half_s, box.y + vy * half_s, box.w, box.h).iou(sighting.box)

    def see(self, sighting: Sighting, stamp_ns: int) -> None:
        """Go on to the next sighting of it."""
        self.fit = self.fits(sighting, stamp_ns)
        self.sighting, self.stamp_ns = sighting, stamp_ns
        self.looks += 1
        self._way.append(((stamp_ns - self.first_ns) * 1e-9, *sighting.box.center))

    def hold(self, names: Collection[str]) -> None:
        """Note the targets that lie in it now."""
        self.inside = {name: (*self.inside.get(name, ()), self.stamp_ns) for name in names}

    @property
    def is_steady(self) -> bool:
        """Whether its box is where it has to be after the one before it."""
        return self.fit >= STEADY_IOU

    @property
    def moved_px(self) -> float:
        """How far it is from where it was seen first."""
        x, y = self.sighting.box.center
        return float(np.hypot(x - self.start[0], y - self.start[1]))

    @property
    def is_on_its_way(self) -> bool:
        """Whether it goes somewhere: a straight line through its places says so, as surely as they lie on it."""
        way = np.array(self._way)
        times_s, places = way[:, 0] - way[:, 0].mean(), way[:, 1:] - way[:, 1:].mean(axis=0)
        squares = float(times_s @ times_s)
        if squares == 0:
            return False
        velocity = times_s @ places / squares
        strayed = max(0.0, float((places**2).sum() - (velocity**2).sum() * squares)) / 2
        box_error_px = BOX_ERROR_SHARE * max(self.sighting.box.w, self.sighting.box.h)
        variance = (strayed + 2 * box_error_px**2) / len(way)
        return float(np.hypot(*velocity)) >= WAY_ERRORS * math.sqrt(variance / squares)
