"""Watches the place where the motion of a lost target would have brought it by now."""

from __future__ import annotations

import math

from etd_ros.tracking.contours import Contours
from etd_ros.tracking.look import Look
from etd_ros.tracking.surface import TimeSurface
from etd_ros.tracking.usual_looks import EVENTS_MIN, UsualLooks

KNOWN_MIN = 0.5
"""A direction of motion of which less is known counts like this: one that is quite unknown would make anything sure."""
SEARCH_NS, CONFIRM_NS = 15_000_000, 6_000_000
"""How often a lost target is looked for, and how soon again once it may be found: a search of the largest region takes
as long as several frames, and many targets may be lost at once."""
AGREEING_LOOKS, AGREEING_NS = 4, 30_000_000
"""Looks that agree for so long, and are so many, count for more than one sure look."""
CONFIDENCE_HERE = 0.4
"""From where on looks that agree with where the target should be are of it: half of it may still be covered."""
RADIUS_PX, NEXT_RADIUS_PX, DRIFT_PX = 6.0, 2.0, 2.0
"""How far from the expected place it is looked for, from the last look, and how far looks that agree may drift off."""


def confidence_if_turned(confidence: float, contours: Contours, look: Look) -> float:
    """How sure a look for a lost target is if it has turned since: of another direction of motion the model may know
    few edges."""
    return confidence / min(1.0, max(KNOWN_MIN, contours.known_along(look.direction)))


class ExpectedPlace:
    """Looks that follow one another at the expected place.

    What comes out from behind something is seen in part at first: no look is sure by itself, but several that move on
    as the target did are of nothing else.
    """

    def __init__(self, contours: Contours, surface: TimeSurface, usual: UsualLooks, stamp_ns: int) -> None:
        self._contours = contours
        self._surface = surface
        self._usual = usual
        self._looked_ns = stamp_ns
        self._first_ns = 0
        self._offsets: list[tuple[float, float]] = []

    def wait(self) -> None:
        """Frames were missing: what has come since is too little for a look."""
        self._looked_ns = self._surface.stamp_ns

    def next_ns(self, patience: float) -> int:
        """When it is looked for next (ns); `patience` as for `found`."""
        return self._looked_ns + round(CONFIRM_NS if self._offsets else patience * SEARCH_NS)

    def found(self, patience: float) -> Look | None:
        """The last of so many looks that agree, if there are; the body's pose and velocity are the expected ones.
        `patience` as for `ContourSearch.found`."""
        stamp_ns = self._surface.stamp_ns
        if stamp_ns < self.next_ns(patience):
            return None
        self._looked_ns = stamp_ns
        x, y = self._contours.body.pose[:2]
        off_x, off_y = self._offsets[-1] if self._offsets else (0.0, 0.0)
        radius_px = NEXT_RADIUS_PX if self._offsets else RADIUS_PX
        look = self._contours.look_at(self._surface, x + off_x, y + off_y, radius_px)
        if not self._agrees(look, look.x - x, look.y - y):
            self._offsets = []
            return None
        if not self._offsets:
            self._first_ns = stamp_ns
        self._offsets.append((look.x - x, look.y - y))
        is_long = len(self._offsets) >= AGREEING_LOOKS and stamp_ns - self._first_ns >= AGREEING_NS
        return look if is_long else None

    def _agrees(self, look: Look, off_x: float, off_y: float) -> bool:
        if look.events < EVENTS_MIN or not self._surface.holds(look.x, look.y):
            return False
        confidence = self._usual.confidence_of_lost(look)
        if confidence_if_turned(confidence, self._contours, look) < CONFIDENCE_HERE:
            return False
        first_x, first_y = self._offsets[0] if self._offsets else (off_x, off_y)
        return math.hypot(off_x - first_x, off_y - first_y) <= DRIFT_PX
