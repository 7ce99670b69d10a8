"""Targets that started by themselves and whose boxes no longer fit what is seen to move there.

What walks swings its arms and legs: its contours change all the time, and a box that follows them swells or drifts.
What is seen of it, look after look, tells better where it is.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from etd_ros.boxes import Box
from etd_ros.tracking.auto_candidates import Candidate
from etd_ros.tracking.discovery import shared
from etd_ros.tracking.own_targets import OwnTarget

MISFIT_IOU = 0.5
"""A box is off where it fits what is seen there by less."""
STEADY_IOU = 0.6
"""What is seen there is one thing if it fits what was seen before by so much."""
OFF_LOOKS_MIN, OFF_MIN_S = 4, 0.15
"""It has been off in so many looks in a row, over so long: what is hidden in part is so for a moment only."""
SEEN_SHARED = 0.5
"""What is seen belongs to the box that shares this part of the smaller of both."""
BESIDE_SHARED = 0.3
"""Where another target shares this part of the smaller box, it cannot be told whose that is which is seen."""


class Realigned:
    """For how long the boxes of own targets have been off.

    Args:
        width, height: sensor size (pixels).
    """

    def __init__(self, width: int, height: int) -> None:
        self._width, self._height = width, height
        self._off_ns: dict[str, tuple[int, ...]] = {}
        self._seen: dict[str, Box] = {}

    def forget(self) -> None:
        """Start a new stream."""
        self._off_ns, self._seen = {}, {}

    def take(
        self, stamp_ns: int, candidates: Iterable[Candidate], own: Sequence[OwnTarget], others: Collection[Box]
    ) -> list[tuple[str, Box]]:
        """The own targets that are to go on from another box, and those boxes (pixels).

        Args:
            stamp_ns: of the look (ns).
            candidates: what it has seen.
            own: the targets that started by themselves, as far as they are tracked.
            others: the boxes (pixels) of the targets that started otherwise.
        """
        sightings = [candidate.sighting.box for candidate in candidates]
        found: list[tuple[str, Box]] = []
        off_ns: dict[str, tuple[int, ...]] = {}
        seen_now: dict[str, Box] = {}
        for target in own:
            beside = [*others, *(other.box for other in own if other is not target)]
            seen = _around([box for box in sightings if shared(box, target.box) > SEEN_SHARED])
            if seen is None or any(shared(box, seen) > BESIDE_SHARED for box in beside):
                continue
            before = self._seen.get(target.name)
            is_steady = before is not None and before.iou(seen) >= STEADY_IOU
            seen_now[target.name] = seen
            # What leaves is moved on beyond the border, where no target can start.
            if target.box.iou(seen) >= MISFIT_IOU or not self._holds_middle(seen):
                continue
            looks_ns = (*(self._off_ns.get(target.name, ()) if is_steady else ()), stamp_ns)
            if len(looks_ns) >= OFF_LOOKS_MIN and stamp_ns - looks_ns[0] >= OFF_MIN_S * 1e9:
                found.append((target.name, seen))
            else:
                off_ns[target.name] = looks_ns
        self._off_ns, self._seen = off_ns, seen_now
        return found

    def _holds_middle(self, box: Box) -> bool:
        x, y = box.center
        return 0 <= x < self._width and 0 <= y < self._height


def _around(boxes: Sequence[Box]) -> Box | None:
    """The box round boxes (pixels); None where there are none."""
    if not boxes:
        return None
    left, top = min(box.x for box in boxes), min(box.y for box in boxes)
    right, bottom = max(box.x + box.w for box in boxes), max(box.y + box.h for box in boxes)
    return Box(left, top, right - left, bottom - top)
