"""When a look at a target is due, and the events of how much time it takes."""

from __future__ import annotations

import math

FAST_SIZES_PER_S = 8.0
"""What moves faster than this does not come to a halt at once."""
VERY_FAST_SIZES_PER_S = 20.0
"""What moves faster than this leaves its box within a frame, also where its looks fail."""
EVENTS_MIN = 25
"""Fewer new events than this are not worth a look."""
EVENTS_SHARE = 0.3
"""A look waits for this share of the events that a pixel of motion brings."""
WAIT_MIN_S, WAIT_MAX_S = 0.005, 0.03
WAIT_MIN_PX, WAIT_MAX_PX = 0.6, 1.5
"""A look waits for so much time or motion of the target's own, whatever ends the frames; its box moves on meanwhile.
After the longer ones it does not wait for events."""
WAIT_FAST_SIZES, WAIT_FAST_S = 0.045, 0.002
"""A look at what is fast waits for motion by this share of its size, too, or so long: more of them teach what covers
it."""
MOTION_SEEN_MIN_PX = 0.5
"""Events for each pixel of motion are counted as if there were at least so much of it."""
EVENTS_RATE = 0.05
"""A look renews what is known of their number by this share."""
EVENTS_WANTED, WINDOW_MAX_PX = 30.0, 8.0
"""A fast target that has fewer events than this in `window_px` of its motion is looked at with those of more, up to
this."""


class LookPace:
    """Of one target: it follows how many events a pixel of its motion brings.

    Args:
        window_px: the motion whose events a look takes (pixels).
        window_max_s: the longest time for that (s).
    """

    def __init__(self, window_px: float, window_max_s: float) -> None:
        self._window_px, self._window_max_s = window_px, window_max_s
        self.forget()

    def forget(self) -> None:
        """Nothing is known of its events."""
        self._events_per_px: float | None = None
        self._events_waiting = 0

    def wait_with(self, new_events: int) -> None:
        """There are so many more events that no look has taken."""
        self._events_waiting += new_events

    def is_due(
        self, elapsed_s: float, speed_px_s: float, sizes_per_s: float, *, is_sure: bool, patience: float = 1.0
    ) -> bool:
        """Whether it is time for a look, so long after the last one; the events for the next one count from then on.
        Looks that are not sure wait for more; sure ones at what is slow wait `patience` times as long."""
        if elapsed_s < WAIT_MIN_S and sizes_per_s > VERY_FAST_SIZES_PER_S and not is_sure:
            return False
        moved_px = speed_px_s * elapsed_s
        times = patience if is_sure and sizes_per_s < FAST_SIZES_PER_S else 1.0
        if moved_px < times * WAIT_MIN_PX and elapsed_s < times * WAIT_MIN_S:
            return False
        if elapsed_s < WAIT_FAST_S and FAST_SIZES_PER_S < sizes_per_s < WAIT_FAST_SIZES / elapsed_s:
            return False
        wanted = max(EVENTS_MIN, EVENTS_SHARE * (self._events_per_px or 0.0))
        if self._events_waiting < wanted and elapsed_s < WAIT_MAX_S and moved_px < WAIT_MAX_PX:
            return False
        self._events_waiting = 0
        return True

    def earliest_s(self, speed_px_s: float, sizes_per_s: float, patience: float) -> float:
        """How long after the last look (s), which was sure, none is due yet, however many events come."""
        times = patience if sizes_per_s < FAST_SIZES_PER_S else 1.0
        return times * min(WAIT_MIN_S, WAIT_MIN_PX / max(speed_px_s, 1e-9))

    def motion_s(self, speed_px_s: float, sizes_per_s: float) -> float:
        """The time of a window's motion (s), at most `window_max_s`."""
        window_px = self._window_px
        if self._events_per_px and sizes_per_s > FAST_SIZES_PER_S:
            window_px = max(window_px, min(WINDOW_MAX_PX, EVENTS_WANTED / self._events_per_px))
        return min(window_px / max(speed_px_s, 1e-3), self._window_max_s)

    def count(self, events: float, moved_px: float) -> None:
        """A look had so many events of so much motion (pixels)."""
        per_px = _per_px(events, moved_px)
        known = per_px if self._events_per_px is None else self._events_per_px
        self._events_per_px = known + EVENTS_RATE * (per_px - known)

    def want_more(self, events: float, moved_px: float) -> None:
        """A look had too few events, of so much motion (pixels)."""
        self._events_per_px = min(_per_px(events, moved_px), self._events_per_px or math.inf)


def _per_px(events: float, moved_px: float) -> float:
    return events / max(MOTION_SEEN_MIN_PX, moved_px)
