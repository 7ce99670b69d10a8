"""How long frames may last: what the tracking asks of the conversion, although that is some frames ahead."""

from __future__ import annotations

import math
import threading
from collections import deque

FRAMES_LATER = 2
"""What is asked for after a frame holds for the frame so many after the next one: as many may be made meanwhile."""


class LongestFrames:
    """Hands the longest duration of frames from the thread that tracks to the thread that converts.

    Each frame's limit is the one that was asked for after the same earlier frame, however the threads take turns: they
    change nothing in the result. Until anything was asked for, and for a new stream, frames have no limit.

    Each side counts frames: the tracking calls `ask` once after each, the conversion `next_s` once after each.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._asked_s = deque([math.inf] * FRAMES_LATER)
        self._of_last_stream = 0
        self._is_closed = False

    def open(self) -> None:
        """Begin, or begin again where frames on their way were dropped; nobody waits."""
        with self._changed:
            self._asked_s = deque([math.inf] * FRAMES_LATER)
            self._of_last_stream = 0
            self._is_closed = False

    def close(self) -> None:
        """Tracking ends: the conversion waits for it no longer."""
        with self._changed:
            self._is_closed = True
            self._changed.notify()

    def ask(self, duration_s: float) -> None:
        """A frame has been tracked: those to come should last at most so long (s); inf: no matter how long."""
        with self._changed:
            self._asked_s.append(duration_s)
            self._changed.notify()

    def next_s(self) -> float:
        """A frame has been handed on: how long the next one may last (s). Waits for the tracking where that is more
        than FRAMES_LATER frames behind."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_closed or self._asked_s)
            if self._is_closed:
                return math.inf
            asked_s = self._asked_s.popleft()
            if self._of_last_stream == 0:
                return asked_s
            self._of_last_stream -= 1
            return math.inf

    def start_stream(self) -> None:
        """The conversion starts a new stream: of this, what has been asked for so far says nothing."""
        with self._changed:
            self._of_last_stream = FRAMES_LATER
