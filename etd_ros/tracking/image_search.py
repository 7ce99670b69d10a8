"""Has recovery look for one lost target on the intensity images, beside the frames to come."""

from __future__ import annotations

from etd_ros.boxes import Box
from etd_ros.recovery.interface import Found, RecoveryTracker
from etd_ros.tracking.drift_watch import DriftWatch
from etd_ros.tracking.searched_image import SearchedImage
from etd_ros.tracking.target import FrameData, TargetState
from etd_ros.tracking.turns import Turns

REMEMBER_NS = SOON_NS = 25_000_000
"""After this time the next image is remembered, or what was found counts: with one image in 50 ms each. What may be the
target is looked at again as soon: several images have to agree on where it is, and it moves."""
IMAGES = {TargetState.RECOVERING: 1, TargetState.LOST: 4}
"""One in so many is searched, where few targets are lost."""


class ImageSearch:
    """One target's recovery tracker; nothing is remembered or found where there is none.

    Args:
        recovery: the target's own.
        wait_s: how long after the search of an image began its answer is waited for (s), inf: always.
        turns: of all targets, in being looked for; None: this one is alone.

    Attributes:
        watch: sees whether the target has drifted while it is followed.
    """

    def __init__(self, recovery: RecoveryTracker | None, wait_s: float, turns: Turns | None = None) -> None:
        self._recovery = recovery
        self._wait_s = wait_s
        self._turns = turns or Turns()
        self.watch = DriftWatch(recovery.watch() if recovery is not None else None, wait_s, self._turns)
        self._searched: SearchedImage | None = None
        self._counts = False
        self._searched_ns = 0
        self._remembered_ns: int | None = None

    def begin(self, stamp_ns: int) -> None:
        """The target is lost from now on (ns)."""
        self._searched_ns = stamp_ns
        self._counts = False
        self.watch.lose()

    def time_went_back(self, stamp_ns: int) -> None:
        """The stream starts again at `stamp_ns` (ns)."""
        self._searched_ns = stamp_ns
        self.watch.time_went_back()
        if self._remembered_ns is not None:
            self._remembered_ns = stamp_ns

    def found(self, stamp_ns: int, image: FrameData | None, state: TargetState, last_box: Box) -> Found | None:
        """Have this image (uint8, shape (height, width)) searched if it is time; the answer to the one before."""
        if self._recovery is None or image is None:
            return None
        wait_ns = self._turns.wait_ns(stamp_ns, IMAGES[state])
        since_ns = stamp_ns - self._searched_ns
        if since_ns < SOON_NS or self._is_searching():
            return None
        answer = self._searched.answer() if self._searched is not None and self._counts else None
        self._searched, self._counts = None, True
        if answer is not None:
            self._searched_ns = stamp_ns
        elif since_ns >= wait_ns or self._recovery.has_lead:
            self._searched_ns = stamp_ns
            if state is TargetState.LOST:
                self._recovery.look_wider()
            self._searched = SearchedImage(self._recovery, stamp_ns, image, last_box)
        return answer

    def remember(self, stamp_ns: int, image: FrameData | None, box: Box, *, is_sure: bool) -> None:
        """Have an image remembered on which the target is at a box, if it is time: the first one in any case."""
        is_first = self._remembered_ns is None
        is_due = self._remembered_ns is None or stamp_ns - self._remembered_ns >= REMEMBER_NS
        if self._recovery is None or image is None or not is_due or self._is_searching():
            return
        if self._searched is not None:
            self._searched.answer()
            self._searched = None
        if is_sure or is_first:
            self._remembered_ns = stamp_ns
            self._recovery.remember(image, box)
            self.watch.remember(image, box)

    def forget_lately(self) -> None:
        """What was remembered last was not the target."""
        if self._recovery is not None:
            self._recovery.forget_lately()

    def _is_searching(self) -> bool:
        """Whether an image is still searched; waits for that as long as is allowed."""
        return self._searched is not None and not self._searched.is_over(self._wait_s)
