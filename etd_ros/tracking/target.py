"""One target's state machine.

::

            frame at or after          no candidate, or       recovering_max_s
            the start stamp            its IoU below mu       is over
      IDLE -----------------> TRACKING -------------> RECOVERING -----------> LOST
        ^                         ^                       |                     |
        |                         +-----------------------+---------------------+
        |                           found by the recovery tracker
        +---- from any state, if time goes back before the start stamp

Without a recovery tracker a failure leads to LOST at once, and there the target stays until it is started again.
A target that stands still while others move gets no events, so no candidate: that is a failure too, as printed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box, iou
from etd_ros.detection import EdgeBoxes, Proposals, admissibility
from etd_ros.parameters import Parameters, parameter
from etd_ros.recovery.interface import RecoveryTracker

FrameData = npt.NDArray[np.uint8]
RecoveryFactory = Callable[[], RecoveryTracker]


class TargetState(str, Enum):
    """Where a target stands."""

    IDLE = "idle"
    """Its start stamp is still to come."""
    TRACKING = "tracking"
    """Its box is known."""
    RECOVERING = "recovering"
    """Its tracking failed a short while ago; every image is searched for it."""
    LOST = "lost"
    """It was not found for long, so images are searched now and then, or (no recovery) not at all."""


LOOP_FRAME_NS = 100_000_000
"""The first frame of a recording that loops ends so long after its beginning at most."""


def starts_again(start_stamp_ns: int, stamp_ns: int) -> bool:
    """Whether a target that started at a stamp of its own (ns; 0: "now") does so again where time has gone back to a
    frame of another (ns): its start is still to come, or would have been within that frame."""
    return start_stamp_ns > 0 and stamp_ns < start_stamp_ns + LOOP_FRAME_NS


@dataclass(frozen=True, slots=True)
class TrackerConfig(Parameters):
    """Parameters of tracking; the first two are the paper's."""

    proposal_score_min: float = parameter(
        0.7,
        "Proposals of a lower area and aspect score are no candidates (lambda). Higher forbids larger changes of size.",
        low=0.0,
        high=1.0,
    )
    failure_iou: float = parameter(
        0.3,
        "A best candidate overlapping the last box less is a failure (mu). Higher fails earlier.",
        low=0.0,
        high=1.0,
    )
    recovering_max_s: float = parameter(
        2.0, "How long every image is searched for a target after a failure (s); then it is lost.", low=0.0, high=3600.0
    )
    lost_search_interval: int = parameter(
        10,
        "etd: a lost target is searched on every so many-th frame, and on each while the last search saw what may be "
        "it. Lower finds it sooner and costs more.",
        low=1,
        high=10_000,
    )


@dataclass(frozen=True, slots=True)
class Search:
    """Where a target was looked for on a frame, and what it was chosen from.

    Attributes:
        region: the search region (pixels).
        candidates: the admissible proposals, best first; none where the target was not tracked.
    """

    region: Box
    candidates: Proposals


@dataclass(frozen=True, slots=True)
class TargetReport:
    """A target after a frame.

    Attributes:
        name: its name.
        state: where it stands.
        box: its box (pixels), while TRACKING; else None.
        score: how sure the box is, 0 to 1. `etd`: IoU with its box on the frame before; `etd-plus`: confidence of the
            last look, 1 before the first, less the longer nothing is seen there, and 0 while it is held where it
            vanished or stopped at once. What the recovery tracker gave if that found it on this frame; 0 while there is
            no box.
        search: how it was looked for; only where that was asked for, and the target has started.
    """

    name: str
    state: TargetState
    box: Box | None
    score: float
    search: Search | None = field(default=None, compare=False)


class Target:
    """One tracked target.

    Args:
        name: its name.
        box: where it is at `stamp_ns` (pixels).
        stamp_ns: from the first frame at or after this time on it is tracked (ns); 0 means from the next frame on.
        config: parameters.
        detector: makes the proposals; may be shared.
        recovery_factory: makes this target's own recovery tracker; None: no recovery.
    """

    def __init__(
        self,
        name: str,
        box: Box,
        stamp_ns: int,
        config: TrackerConfig,
        detector: EdgeBoxes,
        recovery_factory: RecoveryFactory | None,
    ) -> None:
        self.name = name
        self.start_box = box
        self.start_stamp_ns = stamp_ns
        self._config = config
        self._detector = detector
        self._recovery_factory = recovery_factory
        self._candidates = Proposals.none()
        self._state = TargetState.IDLE
        self._last_box = box
        self._recovery = recovery_factory() if recovery_factory else None
        self._failed_at_ns = 0
        self._frames_since_search = 0

    @property
    def state(self) -> TargetState:
        """Where the target stands."""
        return self._state

    @property
    def last_box(self) -> Box:
        """O_{i-1}: where the target was seen last (pixels)."""
        return self._last_box

    @property
    def search_region(self) -> Box:
        """Where it is looked for on the next frame (pixels)."""
        return self._last_box.scaled(self._detector.config.search_scale)

    @property
    def longest_frame_s(self) -> float:
        """How long the next frames may last (s): how fast it moves is not known."""
        return math.inf

    @property
    def candidates(self) -> Proposals:
        """The admissible proposals on the last frame; none where the target was not tracked."""
        return self._candidates

    def update(self, stamp_ns: int, frame_data: FrameData, image: FrameData | None) -> TargetReport:
        """Take the next frame and the intensity image of the same stamp, if there is one.

        Args:
            stamp_ns: T_i (ns).
            frame_data: uint8, shape (height, width, 2).
            image: uint8, shape (height, width), or None: nothing is searched or remembered on this frame.
        """
        self._candidates = Proposals.none()
        starts = self._state is TargetState.IDLE
        if starts:
            if stamp_ns < self.start_stamp_ns:
                return self._report(0.0)
            self._state = TargetState.TRACKING
            self._remember(image)
        if self._state is TargetState.TRACKING:
            overlap = self._track(frame_data)
            if overlap is not None:
                if not starts:
                    self._remember(image)
                return self._report(overlap)
            self._fail(stamp_ns)
        return self._report(self._recover(stamp_ns, image))

    def waiting(self) -> Target:
        """Another that waits for the same start."""
        return Target(
            self.name, self.start_box, self.start_stamp_ns, self._config, self._detector, self._recovery_factory
        )

    def time_went_back(self, stamp_ns: int) -> None:
        """The stream starts again with a frame of this stamp (ns): go on."""
        self._failed_at_ns = stamp_ns

    def _track(self, frame_data: FrameData) -> float | None:
        """Move to the candidate with the largest IoU with the last box; that IoU, or None for a failure."""
        score_min = self._config.proposal_score_min
        proposals = self._detector.propose(frame_data, self._last_box, admissibility_min=score_min)
        is_admissible = admissibility(proposals.boxes, self._last_box) > score_min
        self._candidates = Proposals(proposals.boxes[is_admissible], proposals.scores[is_admissible])
        candidates = self._candidates.boxes
        if len(candidates) == 0:
            return None
        overlaps = iou(candidates, self._last_box)
        best = int(np.argmax(overlaps))
        if overlaps[best] < self._config.failure_iou:
            return None
        self._last_box = Box(*candidates[best].tolist())
        return float(overlaps[best])

    def _fail(self, stamp_ns: int) -> None:
        self._state = TargetState.RECOVERING if self._recovery else TargetState.LOST
        self._failed_at_ns = stamp_ns

    def _recover(self, stamp_ns: int, image: FrameData | None) -> float:
        """Search the image if it is time to; the recovery tracker's score, 0 while not found."""
        if (
            self._state is TargetState.RECOVERING
            and stamp_ns - self._failed_at_ns > self._config.recovering_max_s * 1e9
        ):
            self._state = TargetState.LOST
            self._frames_since_search = 0
        if self._state is TargetState.LOST:
            self._frames_since_search += 1
            is_confirming = self._recovery is not None and self._recovery.has_lead
            if self._frames_since_search < self._config.lost_search_interval and not is_confirming:
                return 0.0
        if self._recovery is None or image is None:
            return 0.0
        self._frames_since_search = 0
        found = self._recovery.search(image, self._last_box)
        if found is None:
            return 0.0
        self._state = TargetState.TRACKING
        self._last_box = found.box
        return found.score

    def _remember(self, image: FrameData | None) -> None:
        if self._recovery is not None and image is not None:
            self._recovery.remember(image, self._last_box)

    def _report(self, score: float) -> TargetReport:
        box = self._last_box if self._state is TargetState.TRACKING else None
        return TargetReport(self.name, self._state, box, score)
