"""An intensity image that recovery searches in a thread, beside the frames to come."""

from __future__ import annotations

import math
import time
from concurrent.futures import ThreadPoolExecutor, wait

from etd_ros.boxes import Box
from etd_ros.recovery.interface import Found, RecoveryTracker
from etd_ros.tracking.target import FrameData

_SEARCHES = ThreadPoolExecutor(max_workers=1, thread_name_prefix="recovery")


class SearchedImage:
    """One image; all are searched one after another, by the one thread.

    Args:
        tracker: searches it.
        stamp_ns: its time (ns).
        image: uint8, shape (height, width); may be reused.
        box: round which the target is looked for (pixels).
    """

    def __init__(self, tracker: RecoveryTracker, stamp_ns: int, image: FrameData, box: Box) -> None:
        self.stamp_ns = stamp_ns
        self.box = box
        self._answer = _SEARCHES.submit(tracker.search, image.copy(), box)
        self._asked_s = time.monotonic()

    def is_over(self, wait_s: float) -> bool:
        """Whether the search is over; waits until it has taken so long (s), inf: until it is over."""
        left_s = wait_s - (time.monotonic() - self._asked_s)
        wait([self._answer], max(0.0, left_s) if math.isfinite(left_s) else None)
        return self._answer.done()

    def answer(self) -> Found | None:
        """What was found; waits for it. Errors of the search are raised here."""
        return self._answer.result()
