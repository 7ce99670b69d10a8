"""Where things are at a time: smooth paths, and flickering light."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from etd_ros.errors import EtdError

FloatArray = npt.NDArray[np.float64]
SAMPLE_S = 0.01
"""Distance of the waypoints of a path that is given as a function."""


class SimulationError(EtdError):
    """A scene that cannot be simulated, or a simulated recording that cannot be written."""


class Pose(NamedTuple):
    """A centre (pixels), a size over that of the texture, and an angle (rad, clockwise as seen)."""

    x: float
    y: float
    scale: float
    angle: float


@dataclass(frozen=True, slots=True)
class Waypoint:
    """Where a sprite is at a time; of a camera's path, how far it has moved (see `Scene.view`).

    Attributes:
        time_s: seconds since the start of the scene.
        x, y: the centre (pixels).
        scale: its size over that of its texture.
        angle: how far it is turned (rad, clockwise as seen).
    """

    time_s: float
    x: float
    y: float
    scale: float = 1.0
    angle: float = 0.0


class Path:
    """A smooth way through waypoints: cubic splines in time; a single waypoint stands still."""

    def __init__(self, waypoints: Sequence[Waypoint]) -> None:
        """Raise SimulationError where there is no waypoint, or the times do not increase."""
        times = [waypoint.time_s for waypoint in waypoints]
        if not times or any(later <= earlier for earlier, later in itertools.pairwise(times)):
            msg = f"a path needs waypoints at increasing times, not {times}"
            raise SimulationError(msg)
        values = [(waypoint.x, waypoint.y, waypoint.scale, waypoint.angle) for waypoint in waypoints]
        self._values = np.array(values, np.float64)
        self._spline = CubicSpline(times, self._values) if len(times) > 1 else None
        self._first_s, self._last_s = times[0], times[-1]

    @classmethod
    def of(cls, pose: Callable[[FloatArray], Sequence[FloatArray | float]], duration_s: float) -> Path:
        """A path from a function of times (s, shape (n,)) that returns x, y and perhaps scale and angle."""
        times = np.arange(0, duration_s + 2 * SAMPLE_S, SAMPLE_S)
        columns = [np.broadcast_to(np.asarray(values, np.float64), times.shape) for values in pose(times)]
        rows = np.stack(columns, axis=1)
        return cls([Waypoint(time_s, *row) for time_s, row in zip(times.tolist(), rows.tolist(), strict=True)])

    def poses(self, times_s: FloatArray) -> FloatArray:
        """Rows x, y, scale, angle at times (s, shape (n,)), float64, shape (n, 4).

        Before the first and after the last waypoint it stays there.
        """
        if self._spline is None:
            return np.repeat(self._values[:1], len(times_s), axis=0)
        return np.asarray(self._spline(np.clip(times_s, self._first_s, self._last_s)), np.float64)

    def at(self, time_s: float) -> Pose:
        """Where it is at a time (s)."""
        return Pose(*self.poses(np.array([time_s]))[0].tolist())


@dataclass(frozen=True, slots=True)
class Flicker:
    """Light that goes up and down as that of a lamp on the mains.

    Attributes:
        rate_hz: how often a second.
        depth: how far from its mean, as a share of it; below 1.
    """

    rate_hz: float
    depth: float

    def __post_init__(self) -> None:
        if not (self.rate_hz > 0 and 0 <= self.depth < 1):
            msg = f"a flicker of {self.depth:g} at {self.rate_hz:g} Hz: give a rate above 0 and a depth in [0, 1)"
            raise SimulationError(msg)

    def at(self, times_s: FloatArray) -> FloatArray:
        """Light over its mean at times (s, shape (n,)), shape (n,)."""
        return 1 + self.depth * np.sin(2 * np.pi * self.rate_hz * times_s)
