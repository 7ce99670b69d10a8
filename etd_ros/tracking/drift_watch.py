"""Watches on intensity images whether a target that is followed surely has drifted: it is seen elsewhere, as it looked
at first."""

from __future__ import annotations

import math

from etd_ros.boxes import Box
from etd_ros.recovery.interface import Found, RecoveryTracker
from etd_ros.tracking.searched_image import SearchedImage
from etd_ros.tracking.target import FrameData

FIRST_IMAGES = 4
"""So many images show what a target looks like at first."""
ANSWER_NS, ANSWER_MAX_NS = 15_000_000, 100_000_000
"""What is seen elsewhere counts so long after its image: the search has its time, and the target is still near."""
ELSEWHERE_IOU = 0.2
"""What is seen elsewhere overlaps the box by less."""
WATCH_NS = 1_990_000_000
"""From one look for what has drifted to the next, of whichever target: with one image in 50 ms every fortieth. A node
does not wait for the search, but shares the interpreter's lock and the cores with it, and is slower by some
milliseconds meanwhile: seldom enough that less than one message in a hundred meets it."""


class Turns:
    """Which of the targets that are followed is looked for elsewhere: one at a time, all in turn, so that many cost no
    more than one."""

    def __init__(self) -> None:
        self._stamp_ns = 0
        self._given_ns: int | None = None
        self._given = self._asking = 0
        self._count = 1

    def take(self, stamp_ns: int, last: int | None) -> int | None:
        """The number of the turn if the image at `stamp_ns` (ns) is for the target that asks, else None.

        Args:
            stamp_ns: of the image.
            last: the number of the turn that this target had last, None before the first.
        """
        if stamp_ns != self._stamp_ns:
            self._stamp_ns = stamp_ns
            self._count, self._asking = max(1, self._asking), 0
        self._asking += 1
        is_too_soon = self._given_ns is not None and 0 <= stamp_ns - self._given_ns < WATCH_NS
        if is_too_soon or (last is not None and self._given + 1 - last < self._count):
            return None
        self._given_ns = stamp_ns
        self._given += 1
        return self._given


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
