"""Clicked points: the object round a point becomes a target."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from etd_ros.boxes import Box
from etd_ros.tracking.auto_targets import is_same
from etd_ros.tracking.clusters import Sighting
from etd_ros.tracking.discovery import Discovery
from etd_ros.tracking.errors import TrackingError
from etd_ros.tracking.pointed_object import LOOKS, PointedObject
from etd_ros.tracking.target import TargetReport

REACH_PX = 8.0
"""A click may miss the box of what moves before a still picture by this."""
EXPECTED_IOU_MIN, SURE_IOU = 0.4, 0.7
"""A box is an answer if its IoU with the object is expected to be so much,
and one at once, which waits for no other look, from the second figure on."""
CLICK_ON = "click on what moves, or what the camera moves past"
MOVED_MAX_NS = 50_000_000
"""Looks come at least so often (ns): a click is not older than this when it is looked at first."""


@dataclass(frozen=True, slots=True)
class Click:
    """A point that somebody clicked.

    Attributes:
        name: of the target to be.
        x, y: the point (pixels).
        stamp_ns: from the first frame at or after this time on (ns); 0 means from the next frame on.
    """

    name: str
    x: float
    y: float
    stamp_ns: int = 0

    def check(self, width: int, height: int) -> None:
        """Refuse a click beside the sensor.

        Raises:
            TrackingError: the point does not lie on a width x height sensor, or the stamp is negative.
        """
        if not (0 <= self.x < width and 0 <= self.y < height):
            msg = f"click {self} lies off the {width}x{height} sensor: give pixels from its top-left corner"
            raise TrackingError(msg)
        if self.stamp_ns < 0:
            msg = f"click {self} is at {self.stamp_ns} ns: a stamp is 0 (the next frame) or above"
            raise TrackingError(msg)

    def __str__(self) -> str:
        return f"{self.name!r} at ({self.x:g}, {self.y:g})"

    def in_vain(self) -> str:
        """What there is to say where the recording ends before anything is found."""
        return f"click {self}: nothing is found there before the recording ends, and nothing starts: {CLICK_ON}"

    def distance(self, box: Box) -> float:
        """How far the point is from a box (pixels), 0 inside."""
        beside_x = max(box.x - self.x, self.x - box.x - box.w, 0.0)
        beside_y = max(box.y - self.y, self.y - box.y - box.h, 0.0)
        return float(np.hypot(beside_x, beside_y))


@dataclass(slots=True)
class _Waiting:
    """A click without an answer.

    Attributes:
        click: the click.
        since_ns: when it was looked at first (ns).
        pointed: what was found round it.
    """

    click: Click
    since_ns: int
    pointed: PointedObject


class Clicks:
    """The clicks that wait for their objects.

    Before a still picture an object is at the click if something moves there, where the picture moves, anywhere; its
    box is told by its contours, and by what was found to move there.

    Args:
        discovery: what finds what moves.
    """

    def __init__(self, discovery: Discovery) -> None:
        self._discovery = discovery
        self._clicks: dict[str, Click] = {}
        self._looked_at: dict[str, _Waiting] = {}

    @property
    def waiting(self) -> Sequence[Click]:
        """The clicks without an answer."""
        return tuple(self._clicks.values())

    def add(self, click: Click) -> None:
        """Wait for what is at a click; one of the same name is forgotten."""
        self.forget(click.name)
        self._clicks[click.name] = click

    def forget(self, name: str) -> None:
        """Do not wait for this one any more, if it waits."""
        self._clicks.pop(name, None)
        self._looked_at.pop(name, None)

    def are_due(self, stamp_ns: int) -> bool:
        """Whether any click holds at a time (ns)."""
        return any(click.stamp_ns <= stamp_ns for click in self._clicks.values())

    def take(self, stamp_ns: int, reports: Iterable[TargetReport]) -> tuple[list[tuple[str, Box]], list[str]]:
        """Answer the clicks for which the discovery's last look has something, or that have waited in vain.

        Args:
            stamp_ns: the time of the look (ns).
            reports: the targets that there are.

        Returns:
            Names and boxes (pixels) of the targets to start; what is to be said of the other clicks.
        """
        tracked = {report.name: report.box for report in reports if report.box is not None}
        starts: list[tuple[str, Box]] = []
        notices: list[str] = []
        for click in self.waiting:
            if click.stamp_ns > stamp_ns:
                continue
            waiting = self._look_at(click, stamp_ns)
            owner = next((name for name, box in tracked.items() if click.distance(box) == 0), None)
            box = self._found(waiting) if owner is None else None
            if box is not None:
                owner = next((name for name, other in tracked.items() if is_same(other, box)), None)
            waited_s = (stamp_ns - waiting.since_ns) * 1e-9
            if owner is not None:
                notices.append(f"click {click} is on target {owner!r}, which is tracked already")
            elif box is not None:
                starts.append((click.name, box))
                tracked[click.name] = box
            elif waited_s >= self._discovery.config.click_wait_s:
                what = "no object stands out" if waiting.pointed.looks else "nothing has moved"
                notices.append(f"click {click}: {what} there for {waited_s:.1f} s: {CLICK_ON}")
            else:
                continue
            self.forget(click.name)
        return starts, notices

    def _look_at(self, click: Click, stamp_ns: int) -> _Waiting:
        """What is known of a click, which is nothing yet at its first look or after time went back."""
        waiting = self._looked_at.get(click.name)
        if waiting is None or stamp_ns < waiting.since_ns:
            clicked_ns = max(click.stamp_ns, stamp_ns - MOVED_MAX_NS) if click.stamp_ns else stamp_ns
            waiting = _Waiting(click, stamp_ns, PointedObject(click.x, click.y, clicked_ns))
            self._looked_at[click.name] = waiting
        return waiting

    def _found(self, waiting: _Waiting) -> Box | None:
        """The box (pixels) of the object at a click, if the looks so far tell."""
        discovery, click = self._discovery, waiting.click
        moving = _at(click, discovery.sightings, 0.0 if discovery.camera_moves else REACH_PX)
        if moving is None and not discovery.picture_moves:
            return None
        pointed = waiting.pointed
        is_near_events = discovery.camera_moves or _at(click, discovery.clusters, REACH_PX) is not None
        if pointed.looks == 0 and not is_near_events:
            # The camera may stand still: what is far from all events is no object.
            return None
        pointed.look(discovery)
        if pointed.looks == 0:
            return moving
        box, expected_iou = pointed.best()
        if expected_iou >= (EXPECTED_IOU_MIN if pointed.looks == LOOKS else SURE_IOU):
            return box
        return moving if pointed.looks == LOOKS else None


def _at(click: Click, sightings: Iterable[Sighting], reach_px: float) -> Box | None:
    """The box of the nearest sighting, the smallest of those round the point."""
    near = [(click.distance(s.box), s.box.w * s.box.h, i, s.box) for i, s in enumerate(sightings)]
    near = [item for item in near if item[0] <= reach_px]
    return min(near)[-1] if near else None
