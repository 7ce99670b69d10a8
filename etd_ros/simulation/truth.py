"""What is true of a scene: exact boxes, and when a target cannot be seen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from etd_ros.boxes import Box
from etd_ros.simulation.motion import FloatArray
from etd_ros.simulation.rendering import Layers, sprite_cover
from etd_ros.simulation.scene import Scene, box_of

HIDDEN_SHARE = 0.25
"""A target of which less can be seen is occluded."""
SAMPLE_S = 0.005
"""Distance of the times at which scenes are looked at for absences."""


@dataclass(frozen=True, slots=True)
class Shares:
    """Shares of a sprite's area at some times, 0 to 1.

    Attributes:
        on_sensor: the share that lies on the sensor, float64, shape (n,).
        visible: the share that also is not hidden by sprites in front of it, shape (n,).
    """

    on_sensor: FloatArray
    visible: FloatArray


class Absence(str, Enum):
    """Why a target cannot be seen."""

    OCCLUDED = "occluded"
    """It is on the sensor, but less than a quarter of it can be seen."""
    LEFT = "left"
    """Nothing of it is on the sensor."""


@dataclass(frozen=True, slots=True)
class AbsentTime:
    """A time for which a target cannot be seen: from start_s to end_s (s since the start of the scene)."""

    start_s: float
    end_s: float
    reason: Absence


def visible_shares(scene: Scene, name: str, times_s: Sequence[float] | FloatArray) -> Shares:
    """How much of a sprite can be seen at times (s, shape (n,)).

    Raises:
        SimulationError: there is no such sprite.
    """
    index, layers = scene.index_of(name), Layers(scene)
    area = float(scene.sprites[index].opacity.sum())
    sums = np.empty((len(times_s), 2))
    for number, placements in enumerate(scene.placements(times_s)):
        covers = sprite_cover(layers, placements, index, scene.height, scene.width)
        sums[number] = np.array(covers) / (area * placements[1 + index, 2] ** 2)
    return Shares(sums[:, 0], sums[:, 1])


def true_boxes(
    scene: Scene, name: str, times_s: Sequence[float] | FloatArray, *, visible_min: float = 0.5
) -> Iterator[tuple[float, Box]]:
    """(time, exact box) of a target at those of the times (s, shape (n,)) at which so much of it can be seen.

    Raises:
        SimulationError: there is no such sprite.
    """
    index = scene.index_of(name)
    visible = visible_shares(scene, name, times_s).visible
    for time_s, share, placements in zip(times_s, visible, scene.placements(times_s), strict=True):
        if share >= visible_min:
            yield float(time_s), box_of(scene.sprites[index], placements[1 + index])


def absent_times(scene: Scene, name: str) -> list[AbsentTime]:
    """The times for which a target is occluded or has left, to 5 ms, in order.

    Raises:
        SimulationError: there is no such sprite.
    """
    times = np.arange(0, scene.duration_s + SAMPLE_S / 2, SAMPLE_S)
    shares = visible_shares(scene, name, times)
    left = shares.on_sensor <= 0
    # A target that is half beyond the border and not hidden is leaving, not occluded.
    occluded = (shares.on_sensor >= HIDDEN_SHARE) & (shares.visible < HIDDEN_SHARE)
    found = [
        AbsentTime(float(times[first]), float(times[min(end, len(times) - 1)]), reason)
        for reason, is_absent in ((Absence.LEFT, left), (Absence.OCCLUDED, occluded))
        for first, end in _runs(is_absent)
    ]
    return sorted(found, key=lambda absence: absence.start_s)


def _runs(is_absent: np.ndarray) -> list[tuple[int, int]]:
    """(first, end) of each run of true values."""
    steps = np.diff(np.concatenate([[0], is_absent.astype(np.int8), [0]]))
    return list(zip(np.flatnonzero(steps > 0).tolist(), np.flatnonzero(steps < 0).tolist(), strict=True))
