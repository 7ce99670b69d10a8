"""Whether one of two targets has been drawn along by the other: they met while passing, and move as one since.

Looks cannot tell: the model of what is hidden learns what hides it within a few of them, and they are sure again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from etd_ros.boxes import Box, shared_areas
from etd_ros.tracking.body import Standing, nearer
from etd_ros.tracking.contour_kernels import Float64Array
from etd_ros.tracking.contour_target import ContourTarget
from etd_ros.tracking.contours import Impression

CHECK_S, CHECK_MAX_S = 0.01, 0.05
"""Targets are compared so often; a longer time without frames counts as the second."""
CLEAR_SHARE, MET_SHARE = 0.1, 0.6
"""Targets whose boxes have less than the first of the smaller one in common are clear of each other; more than the
second, and they have met."""
PASSING_PX_S, ALIKE_SHARE = 20.0, 0.35
"""They were passing each other if they did so faster than this, and move as one where it is less than this share of
that."""
MET_S = 0.05
"""For so long they have to."""
SEEN_MIN, SEEN_SHARE = 0.7, 0.85
"""A target that can still be seen as it looked when it was clear, so surely, or nearly as well as the other one, has
not been drawn along."""
IMPRESSION_S = 0.05
"""What a target looks like is noted so often."""
VELOCITY_S = 0.05
"""Its velocity while it is clear is an average over this time."""
GIVE_UP_S = 1.0
"""What is found with the other again and again for so long moves with it now."""


@dataclass(slots=True)
class _Clear:
    """Where a target stood and what it looked like when it was clear of the others last, and since when it was followed
    then (ns); how long it has moved as one with another since, and when it was first taken to be drawn along (ns)."""

    standing: Standing
    impression: Impression
    impressed_ns: int
    followed_since_ns: int
    met_s: float = 0.0
    first_ns: int | None = None


class DrawnAlong:
    """Watches the targets of a tracker, and sends one that is drawn along back to where it was clear of the other."""

    def __init__(self) -> None:
        self._clear: dict[str, _Clear] = {}
        self._checked_ns = 0

    def forget(self, name: str) -> None:
        """A target of this name has stopped, or starts again."""
        self._clear.pop(name, None)

    def time_went_back(self, stamp_ns: int) -> None:
        """The stream starts again at `stamp_ns` (ns)."""
        self._clear.clear()
        self._checked_ns = stamp_ns

    def take(self, stamp_ns: int, targets: Sequence[ContourTarget]) -> None:
        """Compare the targets as they are after the frame of this stamp (ns), and have those go back that were drawn
        along."""
        elapsed_s = (stamp_ns - self._checked_ns) * 1e-9
        if elapsed_s < CHECK_S:
            return
        self._checked_ns = stamp_ns
        elapsed_s = min(elapsed_s, CHECK_MAX_S)
        followed = [target for target in targets if target.is_followed]
        for target in followed:
            clear = self._clear.get(target.name)
            if clear is not None and clear.followed_since_ns != target.followed_since_ns:
                self.forget(target.name)
        shares = _common_shares([target.last_box for target in followed])
        touching: set[str] = set()
        for first, second in np.argwhere(np.triu(shares >= CLEAR_SHARE, 1)).tolist():
            one, other = followed[first], followed[second]
            touching |= {one.name, other.name}
            if shares[first, second] > MET_SHARE and self._move_as_one(one, other):
                self._doubt(stamp_ns, (one, other), elapsed_s)
        for target in followed:
            if target.name not in touching and target.is_sure:
                self._note(stamp_ns, target, elapsed_s)

    def _move_as_one(self, one: ContourTarget, other: ContourTarget) -> bool:
        """Whether two that have met move as one though they were passing each other."""
        clear, other_clear = self._clear.get(one.name), self._clear.get(other.name)
        if clear is None or other_clear is None:
            return False
        passing_px_s = math.dist(clear.standing.velocity, other_clear.standing.velocity)
        now_px_s = math.dist(one.standing.velocity, other.standing.velocity)
        return passing_px_s > PASSING_PX_S and now_px_s <= ALIKE_SHARE * passing_px_s

    def _doubt(self, stamp_ns: int, pair: tuple[ContourTarget, ContourTarget], elapsed_s: float) -> None:
        """They have moved as one for this time more; the one that was drawn along goes back if that is long enough."""
        one, other = (self._clear[target.name] for target in pair)
        one.met_s += elapsed_s
        other.met_s += elapsed_s
        if min(one.met_s, other.met_s) <= MET_S:
            return
        one.met_s = other.met_s = 0.0
        drawn = self._drawn(*sorted(pair, key=self._changed_px_s))
        if drawn is not None:
            self._send_back(stamp_ns, drawn)

    def _changed_px_s(self, target: ContourTarget) -> float:
        """By how much it has changed its motion since it was clear."""
        return math.dist(self._clear[target.name].standing.velocity, target.standing.velocity)

    def _drawn(self, steady: ContourTarget, changed: ContourTarget) -> ContourTarget | None:
        """Of two, the second of which has changed its motion more, the one that is seen less as it looked when it was
        clear. Where both are seen, that tells nothing if they look alike: then it is the second, otherwise neither."""
        looked, other_looked = (self._clear[target.name].impression for target in (steady, changed))
        seen = steady.confidence_as(looked, steady.standing)
        other_seen = changed.confidence_as(other_looked, changed.standing)
        if min(seen, other_seen) < min(SEEN_MIN, SEEN_SHARE * max(seen, other_seen)):
            return steady if seen < other_seen else changed
        look_alike = steady.confidence_as(looked, changed.standing) >= SEEN_MIN
        return changed if look_alike else None

    def _send_back(self, stamp_ns: int, target: ContourTarget) -> None:
        """It is to be where it was clear, unless it has been sent there for long enough."""
        clear = self._clear[target.name]
        first_ns = stamp_ns if clear.first_ns is None else clear.first_ns
        if (stamp_ns - first_ns) * 1e-9 < GIVE_UP_S:
            clear.first_ns = first_ns
            target.go_back(stamp_ns, clear.standing, clear.impression)

    def _note(self, stamp_ns: int, target: ContourTarget, elapsed_s: float) -> None:
        """It is clear of the others."""
        now, clear = target.standing, self._clear.get(target.name)
        if clear is None:
            self._clear[target.name] = _Clear(now, target.impression, stamp_ns, target.followed_since_ns)
            return
        velocity = nearer(clear.standing.velocity, now.velocity, 1 - math.exp(-elapsed_s / VELOCITY_S))
        clear.standing = Standing(now.stamp_ns, now.pose, velocity)
        clear.met_s, clear.first_ns = 0.0, None
        if (stamp_ns - clear.impressed_ns) * 1e-9 > IMPRESSION_S:
            clear.impression, clear.impressed_ns = target.impression, stamp_ns


def _common_shares(boxes: Sequence[Box]) -> Float64Array:
    """The share of the smaller box of each two that lies in the other one, shape (boxes, boxes)."""
    rows = np.array(boxes, np.float64).reshape(-1, 4)
    areas = rows[:, 2] * rows[:, 3]
    return np.asarray(shared_areas(rows, rows) / np.minimum.outer(areas, areas), np.float64)
