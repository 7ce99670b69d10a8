"""Targets that start by themselves: what is seen to move for a while is proposed, and what is gone is dropped."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from etd_ros.boxes import Box
from etd_ros.tracking.clusters import Sighting
from etd_ros.tracking.discovery import Discovery, shared
from etd_ros.tracking.target import TargetReport, TargetState

UNSEEN_S = 0.13
"""A candidate that was not seen for longer is forgotten."""
LOOKS_MIN = 3
MOVED_MIN_PX = 2.0
"""A candidate moves by this before it is one: what flickers stays where it is."""
MATCH_IOU = 0.3
STEADY_IOU = 0.6
"""A candidate's box fits the one before it, moved on, at least so well when it is started."""
BORDER_PX, BORDER_SEEN_S = 2.0, 0.2
"""A candidate at the sensor's border is still coming in: it is started later."""
SAME_SHARED, SAME_IOU = 0.5, 0.3
"""What overlaps a target by this share of the smaller box is that target."""
TWIN_IOU = 0.7
"""Two targets that overlap so much have become one."""


@dataclass(slots=True)
class _Candidate:
    """Something that may become a target.

    Attributes:
        sighting: the last one of it.
        stamp_ns: when that was (ns).
        first_ns: when it was seen first (ns).
        start: where its middle was then (pixels).
        looks: how often it was seen.
        fit: IoU of its last box with the one before it, moved on.
    """

    sighting: Sighting
    stamp_ns: int
    first_ns: int
    start: tuple[float, float]
    looks: int = 1
    fit: float = 0.0

    def fits(self, sighting: Sighting, stamp_ns: int) -> float:
        """IoU of a sighting's box with where the candidate has got to, with the mean of both velocities."""
        half_s = (stamp_ns - self.stamp_ns) * 0.5e-9
        box, (vx, vy) = self.sighting.box, np.add(self.sighting.velocity, sighting.velocity)
        return Box(box.x + vx * half_s, box.y + vy * half_s, box.w, box.h).iou(sighting.box)

    def see(self, sighting: Sighting, stamp_ns: int) -> None:
        """Go on to the next sighting of it."""
        self.fit = self.fits(sighting, stamp_ns)
        self.sighting, self.stamp_ns = sighting, stamp_ns
        self.looks += 1

    @property
    def moved_px(self) -> float:
        """How far it is from where it was seen first."""
        x, y = self.sighting.box.center
        return float(np.hypot(x - self.start[0], y - self.start[1]))


class AutoTargets:
    """Decides which of the things that move become targets.

    Args:
        discovery: what finds them.
        width, height: sensor size (pixels).
    """

    def __init__(self, discovery: Discovery, width: int, height: int) -> None:
        self._discovery = discovery
        self._width, self._height = width, height
        self._candidates: list[_Candidate] = []

    def forget(self) -> None:
        """Start a new stream."""
        self._candidates.clear()

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
        self._candidates += [_Candidate(s, stamp_ns, stamp_ns, s.box.center) for s in unseen]

    def ready(self, taken: Iterable[Box], room: int) -> list[Box]:
        """The boxes (pixels) of the candidates that become targets now; they are candidates no more.

        Args:
            taken: where the targets are that there are already.
            room: how many more there may be.
        """
        boxes: list[Box] = list(taken)
        started: list[Box] = []
        kept: list[_Candidate] = []
        for candidate in sorted(self._candidates, key=lambda candidate: candidate.first_ns):
            box = candidate.sighting.box
            if any(is_same(box, other) for other in boxes):
                continue
            if len(started) < room and self._is_sure(candidate):
                started.append(box)
                boxes.append(box)
            else:
                kept.append(candidate)
        self._candidates = kept
        return started

    def _is_sure(self, candidate: _Candidate) -> bool:
        seen_s = (candidate.stamp_ns - candidate.first_ns) * 1e-9
        is_seen_now = candidate.stamp_ns == self._discovery.stamp_ns
        is_seen = is_seen_now and candidate.looks >= LOOKS_MIN and seen_s >= self._discovery.config.seen_s
        is_in = seen_s >= BORDER_SEEN_S or not self._is_at_border(candidate.sighting.box)
        return is_seen and is_in and candidate.fit >= STEADY_IOU and candidate.moved_px >= MOVED_MIN_PX

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
