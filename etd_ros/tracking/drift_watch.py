"""Watches on intensity images whether a target that is followed surely has drifted: it is seen elsewhere, as it looked
at first."""

from __future__ import annotations

import math

from etd_ros.boxes import Box
from etd_ros.recovery.interface import Found, RecoveryTracker
from etd_ros.tracking.searched_image import SearchedImage
from etd_ros.tracking.target import FrameData
from etd_ros.tracking.turns import Turns

FIRST_IMAGES = 4
"""So many images show what a target looks like at first."""
ANSWER_NS, ANSWER_MAX_NS = 15_000_000, 100_000_000
"""What is seen elsewhere counts so long after its image: the search has its time, and the target is still near."""
ELSEWHERE_IOU = 0.2
"""What is seen elsewhere overlaps the box by less."""


class DriftWatch:
    """One target's.

    Args:
        tracker: what recovery's tracker gives for this (`RecoveryTracker.watch`); None: nothing is seen.
        wait_s: inf: an answer is waited for, so that results do not depend on the machine; else it counts if it is
            there.
        turns: of all targets.

    Attributes:
        knows_first: whether it is known what the target looked like at first.
    """

    def __init__(self, tracker: RecoveryTracker | None, wait_s: float, turns: Turns) -> None:
        self._tracker = tracker
        self._wait_s = wait_s if math.isinf(wait_s) else 0.0
        self._turns = turns
        self._last_turn: int | None = None
        self._first_images = 0
        self._searched: SearchedImage | None = None

    @property
    def knows_first(self) -> bool:
        return self._first_images == FIRST_IMAGES

    def remember(self, image: FrameData, box: Box) -> None:
        """The target is at a box; what it looks like counts while it is new."""
        if self._tracker is not None and not self.knows_first:
            self._first_images += 1
            self._tracker.remember(image, box)

    def lose(self) -> None:
        """The target is lost: what was asked before that does not count."""
        self._searched = None
        if not self.knows_first:
            # What is found may be something else: it is not what the target looked like at first.
            self._tracker = None

    def time_went_back(self) -> None:
        """The stream starts again: what was asked before that does not count."""
        self._searched = None

    def elsewhere(self, stamp_ns: int, image: FrameData | None, box: Box) -> Found | None:
        """Where the target is if the last image that was searched round its box shows it elsewhere, surely; have this
        one searched if it is this target's turn."""
        if self._tracker is None or not self.knows_first:
            return None
        searched = self._searched
        if searched is not None:
            age_ns = stamp_ns - searched.stamp_ns
            if age_ns < ANSWER_NS or not searched.is_over(self._wait_s):
                return None
            self._searched = None
            found = searched.answer()
            # Its own box is that of its image: what is fast has moved on since.
            if found is not None and age_ns <= ANSWER_MAX_NS and found.box.iou(searched.box) < ELSEWHERE_IOU:
                return found
        turn = None if image is None else self._turns.take(stamp_ns, self._last_turn)
        if image is not None and turn is not None:
            self._last_turn = turn
            self._searched = SearchedImage(self._tracker, stamp_ns, image, box)
        return None
