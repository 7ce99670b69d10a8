"""Which events lie in the boxes of other targets: they are taken for those of the others.

Before a model is known, what passes before a target agrees with itself as well as the target does, and later a look at
both finds what moves both at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.boxes import Box, iou, shared_sides
from etd_ros.tracking.body import Velocity
from etd_ros.tracking.contour_kernels import AGE, Float32Array, Float64Array, X, Y

CHECK_S = 0.01
"""Targets are compared so often, and where one begins."""
FREE_MIN = 0.4
"""Where others leave less of a target's box free than this, all events there are taken for its own: too few would be
left, or one of the boxes has been drawn along to where the other is."""
SAME_IOU = 0.5
"""What is found where another target is, with boxes that overlap by more, is that one."""


class Place(NamedTuple):
    """Where a target is: its box (pixels) and velocity, and whether it has events. What stands has none:
    those in its box are of what passes, unless that stood as well."""

    box: Box
    velocity: Velocity
    has_events: bool


class Placed(Protocol):
    """What `OtherTargets` asks of a target."""

    def begins(self, stamp_ns: int) -> bool:
        """Whether it starts with the frame of this time (ns)."""

    @property
    def others(self) -> OtherBoxes:
        """The boxes of others near it; they are renewed."""

    def place(self, stamp_ns: int) -> Place | None:
        """Where it is at a time (ns), if that is known."""


_NONE = np.empty((0, 6))


class OtherBoxes:
    """The boxes of other targets near one.

    Attributes:
        free: the share of its own box that none of them reaches into, or less where they overlap there; 1 where they
            would leave too little.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """No others are known."""
        self.note(_NONE, 1.0, 0)
        self.note_followed(_NONE, 0)

    def note_followed(self, moving: Float64Array, stamp_ns: int) -> None:
        """Take the boxes of all targets that are followed surely at a time (ns), as those of `note`."""
        self._followed, self._followed_ns = moving, stamp_ns

    def note(self, moving: Float64Array, free: float, stamp_ns: int) -> None:
        """Take the boxes of others at a time (ns): x, y, width and height (pixels) and the velocity (pixels/s) of each,
        shape (boxes, 6), and the share of the own box that is free of them."""
        self._moving, self.free, self._stamp_ns = moving, free, stamp_ns

    @property
    def are_far(self) -> bool:
        """Whether none of them is near."""
        return len(self._moving) == 0

    @property
    def velocities(self) -> Float64Array:
        """How those near it move (pixels/s), shape (boxes, 2)."""
        return self._moving[:, 4:]

    def leave_out(self, points: Float32Array, count: int, stamp_ns: int) -> int:
        """Keep the points of a time (ns), in place, that lie in none of the others where these were then; how many they
        are."""
        if self.are_far:
            return count
        return int(keep_outside(points, count, self._moving, (stamp_ns - self._stamp_ns) * 1e-9))

    def has(self, box: Box, stamp_ns: int) -> bool:
        """Whether what is in a box (pixels) at a time (ns) is another target, which is followed surely: asked by one
        that is not."""
        if len(self._followed) == 0:
            return False
        boxes = self._followed[:, :4].copy()
        boxes[:, :2] += (stamp_ns - self._followed_ns) * 1e-9 * self._followed[:, 4:]
        return bool((iou(boxes, box) > SAME_IOU).any())


class OtherTargets:
    """Tells each target of a tracker where the others are."""

    def __init__(self) -> None:
        self._checked_ns = 0

    def take(self, stamp_ns: int, targets: Sequence[Placed]) -> None:
        """Look where the targets are at the time of a frame (ns), before they take it."""
        if len(targets) < 2:
            for target in targets:
                target.others.forget()
            return
        is_due = not 0 <= (stamp_ns - self._checked_ns) * 1e-9 < CHECK_S
        if not (is_due or any(target.begins(stamp_ns) for target in targets)):
            return
        self._checked_ns = stamp_ns
        known: list[Placed] = []
        places: list[Place] = []
        for target in targets:
            place = target.place(stamp_ns)
            if place is None:
                target.others.forget()
            else:
                known.append(target)
                places.append(place)
        if not known:
            return
        moving = np.array([(*place.box, *place.velocity) for place in places])
        has_events = np.array([place.has_events for place in places])
        _tell(known, moving, has_events, stamp_ns)
        followed = moving[has_events]
        for target in targets:
            target.others.note_followed(followed, stamp_ns)


def _tell(targets: Sequence[Placed], moving: Float64Array, has_events: npt.NDArray[np.bool_], stamp_ns: int) -> None:
    """Tell each target which of the others' boxes at a time (ns), as `keep_outside` has them, are nearer than its own
    is large, and how much of its own is free of them: what two of them have in common counts twice."""
    sizes, common = moving[:, 2:4], shared_sides(moving, moving)
    is_near = common.min(0) > -sizes.max(1)[:, None]
    np.fill_diagonal(is_near, val=False)
    is_near &= has_events | ~has_events[:, None]
    shared = np.where(is_near, np.maximum(common, 0.0).prod(0), 0.0)
    free = 1.0 - shared.sum(1) / sizes.prod(1)
    for target, are_near, free_share in zip(targets, is_near, free.tolist(), strict=True):
        if free_share >= FREE_MIN and are_near.any():
            target.others.note(moving[are_near], free_share, stamp_ns)
        else:
            target.others.forget()


@njit(cache=True, nogil=True)
def keep_outside(points: Float32Array, count: int, moving: Float64Array, since_s: float) -> int:
    """Keep the points that lie in no box as it moves, in place.

    Args:
        points: with ages (s), shape (n, 4).
        count: number of points.
        moving: x, y, width and height of each box (pixels) and its velocity, x and y (pixels/s), shape (boxes, 6).
        since_s: how long after the time of the boxes the ages are 0 (s).

    Returns:
        The number of points kept.
    """
    kept = 0
    for index in range(count):
        after_s = since_s - points[index, AGE]
        is_inside = False
        for number in range(len(moving)):
            across_px = points[index, X] - moving[number, 4] * after_s - moving[number, 0]
            down_px = points[index, Y] - moving[number, 5] * after_s - moving[number, 1]
            if 0 < across_px < moving[number, 2] and 0 < down_px < moving[number, 3]:
                is_inside = True
                break
        if not is_inside:
            points[kept] = points[index]
            kept += 1
    return kept
