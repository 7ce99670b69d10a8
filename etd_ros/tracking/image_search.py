"""Has recovery look for one lost target on the intensity images, beside the frames to come; and, while it is followed,
for whether it is elsewhere."""

from __future__ import annotations

import math
import time
from concurrent.futures import Future, ThreadPoolExecutor, wait

from etd_ros.boxes import Box
from etd_ros.recovery.interface import Found, RecoveryTracker
from etd_ros.tracking.target import FrameData, TargetState

REMEMBER_NS = 25_000_000
SEARCH_NS = {TargetState.RECOVERING: 25_000_000, TargetState.LOST: 175_000_000}
"""After this time the next image is remembered or searched: with one image in 50 ms each of them, or every fourth. An
answer counts from the next search on. What may be the target is looked at again as soon as while it is recovering:
several images have to agree on where it is, and it moves."""
FIRST_IMAGES = 4
"""So many images show what a target looks like at first."""
ANSWER_NS, ANSWER_MAX_NS = 15_000_000, 100_000_000
"""What is seen elsewhere counts so long after its image: the search has its time, and the target is still near."""
ELSEWHERE_IOU = 0.2
"""What is seen elsewhere overlaps the box by less."""
WATCH_NS = 490_000_000
"""From one look for what has drifted to the next, of whichever target: with one image in 50 ms every tenth. That is a
fiftieth of a core, which a node on two of them can spare."""
_SEARCHES = ThreadPoolExecutor(max_workers=1, thread_name_prefix="recovery")


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


class ImageSearch:
    """One target's recovery tracker; nothing is remembered or found where there is none.

    Args:
        recovery: the target's own.
        wait_s: how long after the search of an image began its answer is waited for (s), inf: always.
        turns: of all targets, in being looked for elsewhere; None: this one is alone.

    Attributes:
        knows_first: whether it is known what the target looked like at first.
    """

    def __init__(self, recovery: RecoveryTracker | None, wait_s: float, turns: Turns | None = None) -> None:
        self._recovery = recovery
        self._watch = recovery.watch() if recovery is not None else None
        self._wait_s = wait_s
        self._turns = turns or Turns()
        self._last_turn: int | None = None
        self._is_watching = False
        self._first_images = 0
        self._box: Box
        self._answer: Future[Found | None] | None = None
        self._asked_s = 0.0
        self._counts = False
        self._searched_ns = 0
        self._remembered_ns: int | None = None

    @property
    def knows_first(self) -> bool:
        return self._first_images == FIRST_IMAGES

    def begin(self, stamp_ns: int) -> None:
        """The target is lost from now on (ns)."""
        if not self.knows_first:
            # What is found may be something else: it is not what the target looked like at first.
            self._watch = None
        self._searched_ns = stamp_ns
        self._counts = self._is_watching = False

    def time_went_back(self, stamp_ns: int) -> None:
        """The stream starts again at `stamp_ns` (ns)."""
        self._searched_ns = stamp_ns
        self._is_watching = False
        if self._remembered_ns is not None:
            self._remembered_ns = stamp_ns

    def found(self, stamp_ns: int, image: FrameData | None, state: TargetState, last_box: Box) -> Found | None:
        """Have this image (uint8, shape (height, width)) searched if it is time; the answer to the one before."""
        since_ns = stamp_ns - self._searched_ns
        is_soon = since_ns < SEARCH_NS[TargetState.RECOVERING]
        if self._recovery is None or image is None or is_soon or self._is_searching():
            return None
        if since_ns < SEARCH_NS[state] and not self._recovery.has_lead:
            return None
        answer = self._answer.result() if self._answer is not None and self._counts else None
        self._searched_ns = stamp_ns
        self._answer, self._counts, self._is_watching = None, True, False
        if answer is None:
            self._ask(self._recovery, image, last_box)
        return answer

    def remember(self, stamp_ns: int, image: FrameData | None, box: Box, *, is_sure: bool) -> None:
        """Have an image remembered on which the target is at a box, if it is time: the first one in any case."""
        is_first = self._remembered_ns is None
        is_due = self._remembered_ns is None or stamp_ns - self._remembered_ns >= REMEMBER_NS
        if self._recovery is None or image is None or not is_due:
            return
        # The watch is another tracker, and learns nothing any more.
        if not self._is_watching:
            if self._is_searching():
                return
            self._drop_answer()
        if is_sure or is_first:
            self._remembered_ns = stamp_ns
            self._recovery.remember(image, box)
            if self._watch is not None and not self.knows_first:
                self._first_images += 1
                self._watch.remember(image, box)

    def elsewhere(self, stamp_ns: int, image: FrameData | None, box: Box) -> Found | None:
        """Where the target is if the last image that was searched round its box shows it elsewhere, surely; have this
        one searched if it is this target's turn."""
        if self._watch is None or not self.knows_first:
            return None
        age_ns = stamp_ns - self._searched_ns
        if self._is_watching and age_ns >= ANSWER_NS and self._has_watched():
            found = self._drop_answer()
            # Its own box is that of its image: what is fast has moved on since.
            if found is not None and age_ns <= ANSWER_MAX_NS and found.box.iou(self._box) < ELSEWHERE_IOU:
                return found
        if image is None or (self._answer is not None and not self._has_watched()):
            return None
        turn = self._turns.take(stamp_ns, self._last_turn)
        if turn is not None:
            self._drop_answer()
            self._last_turn, self._searched_ns, self._is_watching, self._box = turn, stamp_ns, True, box
            self._ask(self._watch, image, box)
        return None

    def forget_lately(self) -> None:
        """What was remembered last was not the target."""
        if self._recovery is not None:
            self._recovery.forget_lately()

    def _ask(self, tracker: RecoveryTracker, image: FrameData, box: Box) -> None:
        self._answer = _SEARCHES.submit(tracker.search, image.copy(), box)
        self._asked_s = time.monotonic()

    def _drop_answer(self) -> Found | None:
        """What the last search found; errors of it are raised here."""
        answer, self._answer, self._is_watching = self._answer, None, False
        return answer.result() if answer is not None else None

    def _has_watched(self) -> bool:
        """Whether the last search is over; who follows a target does not wait for it, but where results must not depend
        on the machine."""
        if math.isinf(self._wait_s):
            return not self._is_searching()
        return self._answer is None or self._answer.done()

    def _is_searching(self) -> bool:
        """Whether an image is still searched; waits for that as long as is allowed."""
        if self._answer is None:
            return False
        left_s = self._wait_s - (time.monotonic() - self._asked_s)
        wait([self._answer], max(0.0, left_s) if math.isfinite(left_s) else None)
        return not self._answer.done()
