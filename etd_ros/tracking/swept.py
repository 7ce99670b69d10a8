"""Whether what goes on where a target is said to stand says that it does not: what stands there makes no events, and
nothing moves through it."""

from __future__ import annotations

from etd_ros.boxes import Box
from etd_ros.tracking.growth import count_of
from etd_ros.tracking.other_targets import OtherBoxes
from etd_ros.tracking.surface import TimeSurface, Window

LOOK_S, SPAN_S = 0.01, 0.05
"""It is looked so often, at the events of so long a time."""
SWEPT_S, GIVEN_UP_S = 0.15, 1.0
"""Edges that move through the box and round it for so much longer than not say that it is not seen there, or that
something passes before it; what passes has passed after the second time."""
INNER, OUTER = 1.1, 1.6
"""Width and height, in those of the box, of the ring that is looked at."""
EVENTS_MIN, SIDE_EVENTS_MIN = 15, 8
"""Fewer events in the box, or on one of its sides, are taken for noise."""
SIDES_MIN = 2
"""What moves through the box is on so many of its sides, at least."""


class Swept:
    """What goes on where a target is said to stand.

    Args:
        box: of the target there (pixels).
        stamp_ns: from when on (ns).
        others: the boxes of other targets near it: what is in them is known.

    Attributes:
        is_swept: whether edges move through the box now.
    """

    def __init__(self, box: Box, stamp_ns: int, others: OtherBoxes) -> None:
        self._box, self._others = box, others
        self._looked_ns = stamp_ns
        self._busy_s = self._swept_s = 0.0
        self.is_swept = False

    def take(self, surface: TimeSurface) -> bool:
        """Take the newest frame, which the surface holds; whether the target is not to be believed there any more."""
        since_s = (surface.stamp_ns - self._looked_ns) * 1e-9
        if since_s < LOOK_S:
            return False
        self._looked_ns = surface.stamp_ns
        since_s = min(since_s, SPAN_S)
        change_s = since_s if self._is_busy(surface) else -since_s
        self._busy_s = min(max(self._busy_s + change_s, 0.0), 2 * SWEPT_S)
        self.is_swept = self._busy_s >= SWEPT_S
        self._swept_s = self._swept_s + since_s if self.is_swept else 0.0
        return self._swept_s >= GIVEN_UP_S

    def _is_busy(self, surface: TimeSurface) -> bool:
        if not self._shows_edges(surface, surface.window(self._box, 0.0), EVENTS_MIN):
            return False
        sides = _sides(surface, self._box)
        return sum(self._shows_edges(surface, side, SIDE_EVENTS_MIN) for side in sides) >= SIDES_MIN

    def _shows_edges(self, surface: TimeSurface, window: Window, events_min: int) -> bool:
        is_quiet = count_of(surface, window, SPAN_S, self._others) < events_min
        return not is_quiet and not surface.shows_noise(window, SPAN_S)


def _sides(surface: TimeSurface, box: Box) -> tuple[Window, Window, Window, Window]:
    """What lies above, below, left of and right of a box, as far as it is on the sensor."""
    top, bottom, left, right = surface.window(box.scaled(OUTER), 0.0)
    inner_top, inner_bottom, inner_left, inner_right = surface.window(box.scaled(INNER), 0.0)
    return (
        (top, inner_top, left, right),
        (inner_bottom, bottom, left, right),
        (inner_top, inner_bottom, left, inner_left),
        (inner_top, inner_bottom, inner_right, right),
    )
