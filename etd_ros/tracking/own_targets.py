"""How the targets that started by themselves have moved since, look by look."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from etd_ros.boxes import Box
from etd_ros.tracking.target import TargetReport, TargetState

VELOCITY_NS = 100_000_000
"""A velocity is taken from the looks of so long (ns)."""
LOOKS_MAX = 60
"""So many are kept: more than there are while a target may still turn out to be a part."""


@dataclass(frozen=True, slots=True)
class OwnTarget:
    """A target that started by itself and is tracked.

    Attributes:
        name: its name.
        box: where it is (pixels).
        age_s: how long ago it started (s).
        way: where its middle was (pixels) at the times of the looks (ns), the newest last.
    """

    name: str
    box: Box
    age_s: float
    way: Mapping[int, tuple[float, float]]

    @property
    def velocity(self) -> tuple[float, float]:
        """Lately, x and y (pixels/s); 0 at its first look."""
        stamps = list(self.way)
        since_ns = next(stamp for stamp in stamps if stamps[-1] - stamp <= VELOCITY_NS)
        (x, y), (before_x, before_y) = self.way[stamps[-1]], self.way[since_ns]
        elapsed_s = max(stamps[-1] - since_ns, 1) * 1e-9
        return (x - before_x) / elapsed_s, (y - before_y) / elapsed_s

    def strayed_px(self, other: OwnTarget) -> float:
        """How much the distance of both has changed while both were there."""
        apart = [np.subtract(self.way[stamp], other.way[stamp]) for stamp in self.way.keys() & other.way.keys()]
        return float(np.hypot(*np.ptp(apart, axis=0))) if apart else 0.0


class OwnTargets:
    """Keeps the ways of the targets that started by themselves."""

    def __init__(self) -> None:
        self._first_ns: dict[str, int] = {}
        self._ways: dict[str, dict[int, tuple[float, float]]] = {}

    def take(self, stamp_ns: int, reports: Iterable[TargetReport]) -> list[OwnTarget]:
        """Take their reports at the time of a look (ns).

        Returns:
            Those that are tracked, in the order of their start.
        """
        own = []
        for report in reports:
            first_ns = self._first_ns.setdefault(report.name, stamp_ns)
            if report.box is None or report.state is not TargetState.TRACKING:
                continue
            way = self._ways.setdefault(report.name, {})
            way[stamp_ns] = report.box.center
            if len(way) > LOOKS_MAX:
                del way[next(iter(way))]
            own.append(OwnTarget(report.name, report.box, (stamp_ns - first_ns) * 1e-9, way))
        return own

    def begin_again(self, name: str) -> None:
        """The target goes on from another box: where its middle was says nothing any more."""
        self._ways.pop(name, None)

    def forget(self, name: str) -> None:
        """The target is no more."""
        self._first_ns.pop(name, None)
        self._ways.pop(name, None)
