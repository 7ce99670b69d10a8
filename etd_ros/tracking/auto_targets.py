"""Targets that start by themselves: what is seen to move for a while is proposed, and what is gone is dropped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from etd_ros.boxes import Box
from etd_ros.tracking.auto_candidates import Candidate
from etd_ros.tracking.discovery import Discovery, shared
from etd_ros.tracking.own_targets import OwnTarget
from etd_ros.tracking.parts import Whole, wholes
from etd_ros.tracking.realigned import Realigned
from etd_ros.tracking.target import TargetReport, TargetState

UNSEEN_S = 0.13
"""A candidate that was not seen for longer is forgotten."""
LOOKS_MIN = 3
MOVED_MIN_PX = 2.0
"""A candidate moves by this before it is one: what flickers stays where it is."""
MATCH_IOU = 0.3
BORDER_PX, BORDER_SEEN_S = 2.0, 0.2
"""A candidate at the sensor's border is still coming in: it is started later."""
SAME_SHARED, SAME_IOU = 0.5, 0.3
"""What overlaps a target by this share of the smaller box is that target."""
TWIN_IOU = 0.7
"""Two targets that overlap so much have become one."""


class AutoTargets:
    """Decides which of the things that move become targets.

    Args:
        discovery: what finds them.
        width, height: sensor size (pixels).
    """

    def __init__(self, discovery: Discovery, width: int, height: int) -> None:
        self._discovery = discovery
        self._width, self._height = width, height
        self._candidates: list[Candidate] = []
        self._realigned = Realigned(width, height)

    def forget(self) -> None:
        """Start a new stream."""
        self._candidates.clear()
        self._realigned.forget()

    def take(self) -> None:
        """Take what the discovery's last look has found."""
        stamp_ns = self._discovery.stamp_ns
        unseen = list(self._discovery.sightings)
        for candidate in sorted(self._candidates, key=lambda candidate: -candidate.looks):
            if not unseen:
                break
            overlaps = [candidate.fits(sighting, stamp_ns) for sighting in unseen]
            best = int(np.argmax(overlaps))
            if overlaps[best] >= MATCH_IOU:
                candidate.see(unseen.pop(best), stamp_ns)
        self._candidates = [c for c in self._candidates if stamp_ns - c.stamp_ns <= UNSEEN_S * 1e9]
        self._candidates += [Candidate(s, stamp_ns, stamp_ns, s.box.center) for s in unseen]

    def ready(self, taken: Iterable[Box], room: int) -> list[Box]:
        """The boxes (pixels) of the candidates that become targets now.

        Args:
            taken: where the targets are that there are already.
            room: how many more there may be.
        """
        boxes: list[Box] = list(taken)
        started: list[Box] = []
        kept: list[Candidate] = []
        for candidate in sorted(self._candidates, key=lambda candidate: candidate.first_ns):
            box = candidate.sighting.box
            if any(is_same(box, other) for other in boxes):
                # The target may be on a part of it only, which later looks tell.
                candidate.is_taken = True
                kept.append(candidate)
                continue
            if candidate.is_taken:
                # The target has left it, or is gone: what is seen here is looked at afresh.
                continue
            if len(started) < room and self._is_sure(candidate):
                started.append(box)
                boxes.append(box)
            else:
                kept.append(candidate)
        self._candidates = kept
        return started

    def wholes(self, own: Sequence[OwnTarget], others: Sequence[Box]) -> list[Whole]:
        """What targets that started by themselves have turned out to be parts of.

        Args:
            own: those targets, as far as they are tracked, in the order of their start.
            others: the boxes (pixels) of the targets that started otherwise.
        """
        return wholes(self._seen_now(), own, others)

    def realigned(self, own: Sequence[OwnTarget], others: Sequence[Box]) -> list[tuple[str, Box]]:
        """The targets that started by themselves, of these, that are to go on from another box, and those boxes
        (pixels)."""
        return self._realigned.take(self._discovery.stamp_ns, self._seen_now(), own, others)

    def _seen_now(self) -> list[Candidate]:
        return [candidate for candidate in self._candidates if candidate.stamp_ns == self._discovery.stamp_ns]

    def _is_sure(self, candidate: Candidate) -> bool:
        seen_s = (candidate.stamp_ns - candidate.first_ns) * 1e-9
        is_seen_now = candidate.stamp_ns == self._discovery.stamp_ns
        is_seen = is_seen_now and candidate.looks >= LOOKS_MIN and seen_s >= self._discovery.config.seen_s
        is_in = seen_s >= BORDER_SEEN_S or not self._is_at_border(candidate.sighting.box)
        moves = candidate.moved_px >= MOVED_MIN_PX and candidate.is_on_its_way
        return is_seen and is_in and candidate.is_steady and moves

    def _is_at_border(self, box: Box) -> bool:
        beyond_right = box.x + box.w >= self._width - BORDER_PX
        return min(box.x, box.y) <= BORDER_PX or beyond_right or box.y + box.h >= self._height - BORDER_PX


class Absences:
    """For how long each target has not been seen."""

    def __init__(self) -> None:
        self._since_ns: dict[str, int] = {}

    def absent_s(self, report: TargetReport, stamp_ns: int) -> float:
        """Take a target's report on a frame (ns); for how long it has not been seen (s): it is not tracked, or held at
        a score of 0 where it vanished or stopped at once."""
        name = report.name
        is_seen = report.state is TargetState.TRACKING and report.score > 0
        if is_seen or stamp_ns < self._since_ns.get(name, stamp_ns):
            self._since_ns.pop(name, None)
            return 0.0
        return (stamp_ns - self._since_ns.setdefault(name, stamp_ns)) * 1e-9

    def forget(self, name: str) -> None:
        """The target is no more."""
        self._since_ns.pop(name, None)


def are_twins(box: Box, other: Box) -> bool:
    """Whether two targets' boxes are on one object."""
    return box.iou(other) > TWIN_IOU


def is_same(box: Box, other: Box) -> bool:
    """Whether two boxes are of one object."""
    return shared(box, other) > SAME_SHARED or box.iou(other) > SAME_IOU
