"""A target that stands, and then sets off: another way than it came, its model knows none of the edges that make events
then, and neither looks nor a search find it. So it starts again, as it did from its first box."""

from __future__ import annotations

import math

from etd_ros.boxes import Box
from etd_ros.tracking.contours import Contours
from etd_ros.tracking.growth import RING_MAX, stands_alone
from etd_ros.tracking.start_up import StartUp
from etd_ros.tracking.surface import TimeSurface

KNOWN_MAX = 0.5
"""What moves in a direction of which more is known is found by its model, or is something else."""
AROUND_S = 0.1
"""What passes before a target comes from beside it, and was round its box within this time."""
CROWDED = 0.3
"""With so many times as many events round its box as in it, for each pixel, no start is worth its time."""


class SetOff:
    """What comes of a target where it stands.

    Args:
        known: its contours so far.
        box: where it stands (pixels).
        stamp_ns: from when on (ns).

    Attributes:
        contours: those that it has once it has set off.
        is_disturbed: whether something has moved there since that was not taken for it.
    """

    def __init__(self, known: Contours, box: Box, stamp_ns: int) -> None:
        self._known, self._box = known, box
        self.is_disturbed = False
        # Before that, what is round it may be what it left there as it came.
        self._settled_ns = stamp_ns + round(AROUND_S * 1e9)
        self._begin(stamp_ns)

    def _begin(self, stamp_ns: int) -> None:
        self.contours = self._known.anew(self._box, stamp_ns)
        self._start_up = StartUp(self.contours)

    def take(self, surface: TimeSurface) -> bool:
        """Take the newest frame, which the surface holds; whether the target has set off, so that its contours are
        known."""
        new_events = self.contours.keep(surface)
        if self._start_up.is_new and not self._is_alone(surface, CROWDED):
            # What passes there would not be taken for it.
            self._start_up.begin_again(surface.stamp_ns)
            self.is_disturbed = self.is_disturbed or surface.stamp_ns > self._settled_ns
            return False
        if not self._start_up.take(surface, new_events):
            return False
        if self._is_it(surface):
            return True
        self._begin(surface.stamp_ns)
        self.is_disturbed = True
        return False

    def _is_it(self, surface: TimeSurface) -> bool:
        """Whether what has moved away from there is the target: all of it began in its box, another way than it is
        known to look."""
        body = self.contours.body
        right, down = body.velocity
        if math.hypot(right, down) == 0 or self._known.known_along((right, down)) > KNOWN_MAX:
            return False
        return self._is_alone(surface, RING_MAX)

    def _is_alone(self, surface: TimeSurface, around_max: float) -> bool:
        """Whether there are few events round it, for each pixel at most so many times as many as in its box."""
        return stands_alone(surface, self.contours.body.box, AROUND_S, around_max, self.contours.own.others)
