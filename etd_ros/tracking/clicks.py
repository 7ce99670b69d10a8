"""Clicked points: the moving object round a point becomes a target."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from etd_ros.boxes import Box
from etd_ros.tracking.auto_targets import is_same
from etd_ros.tracking.clusters import Sighting
from etd_ros.tracking.discovery import Discovery
from etd_ros.tracking.errors import TrackingError
from etd_ros.tracking.target import TargetReport

REACH_PX = 8.0
"""A click may miss an object's box by this."""


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

    def distance(self, box: Box) -> float:
        """How far the point is from a box (pixels), 0 inside."""
        beside_x = max(box.x - self.x, self.x - box.x - box.w, 0.0)
        beside_y = max(box.y - self.y, self.y - box.y - box.h, 0.0)
        return float(np.hypot(beside_x, beside_y))


class Clicks:
    """The clicks that wait for their objects.

    Args:
        discovery: what finds what moves.
    """

    def __init__(self, discovery: Discovery) -> None:
        self._discovery = discovery
        self._waiting: dict[str, Click] = {}
        self._since_ns: dict[str, int] = {}

    @property
    def waiting(self) -> Sequence[Click]:
        """The clicks without an answer."""
        return tuple(self._waiting.values())

    def add(self, click: Click) -> None:
        """Wait for what moves at a click; one of the same name is forgotten."""
        self.forget(click.name)
        self._waiting[click.name] = click

    def forget(self, name: str) -> None:
        """Do not wait for this one any more, if it waits."""
        self._waiting.pop(name, None)
        self._since_ns.pop(name, None)

    def are_due(self, stamp_ns: int) -> bool:
        """Whether any click holds at a time (ns)."""
        return any(click.stamp_ns <= stamp_ns for click in self._waiting.values())

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
            waited_s = (stamp_ns - self._since_ns.setdefault(click.name, stamp_ns)) * 1e-9
            owner = next((name for name, box in tracked.items() if click.distance(box) == 0), None)
            sighting = _at(click, self._discovery.sightings)
            if owner is None and sighting is not None:
                owner = next((name for name, box in tracked.items() if is_same(box, sighting.box)), None)
            if owner is not None:
                notices.append(f"click {click} is on target {owner!r}, which is tracked already")
            elif sighting is not None:
                starts.append((click.name, sighting.box))
                tracked[click.name] = sighting.box
            elif waited_s >= self._discovery.config.click_wait_s:
                notices.append(f"click {click}: nothing has moved there for {waited_s:.1f} s: click on a moving object")
            else:
                continue
            self.forget(click.name)
        return starts, notices


def _at(click: Click, sightings: Iterable[Sighting]) -> Sighting | None:
    """The nearest sighting, the smallest of those round the point."""
    near = [(click.distance(s.box), s.box.w * s.box.h, i, s) for i, s in enumerate(sightings)]
    near = [item for item in near if item[0] <= REACH_PX]
    return min(near)[-1] if near else None
