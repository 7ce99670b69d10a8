"""Moving objects before a still camera: clusters of neighbouring events that move alike."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.tracking.discovery_kernels import AGE, Float32Array, Int32Array, X, Y, label_cells
from etd_ros.tracking.recent_events import CELL_PX, RecentEvents

CELL_EVENTS_MIN, EVENTS_MIN = 2, 25
"""Fewer events are no cell of a cluster, and no object."""
CLUSTERS_MAX = 64
"""Only so many clusters are looked at, those with the most events: rain is not a crowd."""
TRIM = 0.01
"""Share of the events that a box leaves out on each side: stragglers."""
SLOPE_PX = 32.0
"""A velocity is taken from the events of so much motion."""
BOX_MOTION_PX = 8.0
"""A box is drawn round the events of so much motion, moved on to now."""
BOX_EVENTS_MIN = 40
NEW_SHARE = 0.35
"""Least share of the events that are of the newer half of their time."""
GAP_PX, GAP_SHARE = 6.0, 0.5
"""Parts of an object may lie so far apart: pixels, or this share of the smaller part's longer side."""
SPEED_TOLERANCE = 0.25
UNCERTAINTIES = 2.0
ERROR_MAX_PX_S = 100.0
"""Parts move alike if their velocities differ by less than this share of the faster and so many standard errors, which
count up to a limit: what is too faint to have a velocity would join everything."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """Something that moves, at the time of the newest events.

    Attributes:
        box: where it is (pixels).
        velocity: x, y (pixels/s).
        velocity_error: standard error of both (pixels/s).
    """

    box: Box
    velocity: tuple[float, float]
    velocity_error: float


class Clusters:
    """Finds clusters of recent events.

    Parts of one object (a plain thing has events at its front and at its back only) are joined if they lie near one
    another and move alike. A part's velocity is the slope of its events' places over their times: unlike the flow of a
    few pixels it does not depend on which way the part's edges run.

    Args:
        events: where the events come from.
    """

    def __init__(self, events: RecentEvents) -> None:
        self._events = events
        self._labels: Int32Array = np.zeros_like(events.counts)
        self._stack = np.zeros((events.counts.size, 2), np.int32)

    def find(self, points: Float32Array) -> list[Sighting]:
        """What moves.

        Args:
            points: from the last call of `RecentEvents.points`.
        """
        number = label_cells(self._events.counts, CELL_EVENTS_MIN, self._labels, self._stack)
        cells = points[:, [Y, X]].astype(np.int32) // CELL_PX
        of_point = self._labels[cells[:, 0], cells[:, 1]]
        numbers = np.bincount(of_point, minlength=number + 1)
        order, ends = np.argsort(of_point, kind="stable"), np.cumsum(numbers)
        large = 1 + np.argsort(-numbers[1:], kind="stable")[:CLUSTERS_MAX]
        parts = [
            _Part(points[order[ends[label - 1] : ends[label]]])
            for label in sorted(large)
            if numbers[label] >= EVENTS_MIN
        ]
        return [Sighting(part.box, part.velocity, part.velocity_error) for part in _joined(parts) if part.is_there]


class _Part:
    """A cluster, or several that move alike.

    Attributes:
        points: its events.
        velocity, velocity_error: x, y, and a standard error of both (pixels/s).
        box: where it is now (pixels).
    """

    def __init__(self, points: Float32Array) -> None:
        self.points = points
        self.velocity, self.velocity_error = _slope(points)
        # What is fast may have turned by now: its newest motion counts.
        newest = points[points[:, AGE] * self.speed_px_s <= SLOPE_PX]
        if EVENTS_MIN <= len(newest) < len(points):
            self.velocity, self.velocity_error = _slope(newest)
        self.box = tight_box(points, self.velocity)

    @property
    def speed_px_s(self) -> float:
        return float(np.hypot(*self.velocity))

    @property
    def is_there(self) -> bool:
        """Whether events still come: what has just gone behind something has old ones only."""
        ages = self.points[:, AGE]
        return bool((ages < ages.max() / 2).mean() >= NEW_SHARE)

    def with_part(self, other: _Part) -> _Part:
        return _Part(np.concatenate([self.points, other.points]))

    def belongs_to(self, other: _Part) -> bool:
        """Whether both are parts of one object."""
        a, b = self.box, other.box
        gap_x = max(a.x, b.x) - min(a.x + a.w, b.x + b.w)
        gap_y = max(a.y, b.y) - min(a.y + a.h, b.y + b.h)
        smaller = min(max(a.w, a.h), max(b.w, b.h))
        if max(gap_x, gap_y) >= max(GAP_PX, GAP_SHARE * smaller):
            return False
        difference = np.hypot(self.velocity[0] - other.velocity[0], self.velocity[1] - other.velocity[1])
        error = np.hypot(self.velocity_error, other.velocity_error)
        faster = max(self.speed_px_s, other.speed_px_s)
        return bool(difference < min(UNCERTAINTIES * error, ERROR_MAX_PX_S) + SPEED_TOLERANCE * faster)


def _slope(points: Float32Array) -> tuple[tuple[float, float], float]:
    """How fast places change with time (pixels/s), and the standard error."""
    ages = points[:, AGE] - points[:, AGE].mean()
    places = points[:, :AGE] - points[:, :AGE].mean(axis=0)
    squares = max(float(ages @ ages), 1e-9)
    # Ages count backwards.
    slope = -(ages @ places) / squares
    rest = max(0.0, float((places**2).sum() - (slope**2).sum() * squares))
    return (float(slope[0]), float(slope[1])), float(np.sqrt(rest / (squares * len(points))))


def _joined(parts: list[_Part]) -> list[_Part]:
    """The parts, those of one object made one."""
    parts = list(parts)
    pair = next(_pairs(parts), None)
    while pair is not None:
        i, j = pair
        parts[i] = parts[i].with_part(parts.pop(j))
        pair = next(_pairs(parts), None)
    return parts


def _pairs(parts: list[_Part]) -> Iterator[tuple[int, int]]:
    for i, part in enumerate(parts):
        for j in range(i + 1, len(parts)):
            if part.belongs_to(parts[j]):
                yield i, j


def tight_box(points: Float32Array, velocity: tuple[float, float]) -> Box:
    """The box (pixels) round points, moved on to now with a velocity (pixels/s); the newest of them tell the most."""
    ages = points[:, AGE]
    oldest_s = BOX_MOTION_PX / max(float(np.hypot(*velocity)), 1e-3)
    if len(points) > BOX_EVENTS_MIN:
        oldest_s = max(oldest_s, float(np.partition(ages, BOX_EVENTS_MIN)[BOX_EVENTS_MIN]))
        points = points[ages <= oldest_s]
    x = points[:, X] + velocity[0] * points[:, AGE]
    y = points[:, Y] + velocity[1] * points[:, AGE]
    return box_round(x, y, TRIM)


def box_round(x: npt.NDArray[np.float32], y: npt.NDArray[np.float32], trim: float) -> Box:
    """The box (pixels) round pixels with these middles, but for a share of them on each side."""
    (left, top), (right, bottom) = _quantiles(x, y, trim), _quantiles(x, y, 1 - trim)
    return Box(left - 0.5, top - 0.5, right - left + 1, bottom - top + 1)


def _quantiles(x: npt.NDArray[np.float32], y: npt.NDArray[np.float32], share: float) -> tuple[float, float]:
    rank = round(share * (len(x) - 1))
    return float(np.partition(x, rank)[rank]), float(np.partition(y, rank)[rank])
