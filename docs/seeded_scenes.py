"""What the lists of simulated scenes share that are measured here."""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from etd_ros.engine import FrameSource, track
from etd_ros.evaluation.scoring import SUCCESS_IOU
from etd_ros.evaluation.suite import START_NS
from etd_ros.evaluation.tracks import TrackRow
from etd_ros.events import Events, concatenate
from etd_ros.settings import Settings
from etd_ros.simulation import Scene, SensorConfig, simulate
from etd_ros.simulation import Sequence as Simulated
from etd_ros.stream import StreamGuard
from etd_ros.targets import TargetStart
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState


@dataclass(frozen=True)
class SeededScene(ABC):
    """A scene that its seed makes, as `evaluate` and `of_each` take sequences."""

    seed: int

    @property
    def name(self) -> str:
        return f"{type(self).__name__.lower()}-{self.seed}"

    def scene(self) -> Scene:
        return self._made[0]

    def events(self, scene: Scene, *, start_ns: int = 0) -> Iterator[Events]:
        return simulate(scene, seed=self.seed, start_ns=start_ns, config=self._made[1])

    @cached_property
    def _made(self) -> tuple[Scene, SensorConfig]:
        return self.make()

    @abstractmethod
    def make(self) -> tuple[Scene, SensorConfig]:
        """The scene, and the sensor that sees it."""


def tracked(seeded: SeededScene, start: TargetStart) -> list[TrackRow]:
    """What `etd-plus` says of a target of a scene that starts at START_NS, from the target's start on."""
    return tracked_all(seeded, [start])


def tracked_all(seeded: SeededScene | Simulated, starts: Sequence[TargetStart]) -> list[TrackRow]:
    """The same of several, frame by frame."""
    guard = StreamGuard()
    events = seeded.events(seeded.scene(), start_ns=START_NS)
    rows = []
    for step in track((batch for part in events for batch in guard.feed(part)), starts, threads=False):
        for report in step.reports:
            if report.state is not TargetState.IDLE:
                rows.append(TrackRow(step.frame.stamp_ns, report.name, report.box, report.score, report.state.value))
    return rows


def mean_overlap(seeded: SeededScene, starts_s: float, counts_s: float, late_s: float = 0.0) -> float:
    """The mean IoU of the boxes of a scene's "thing" after a time (s), on its fine frames; the target starts at
    `starts_s`, and is named so much later."""
    scene = seeded.scene()
    events = concatenate(list(seeded.events(scene, start_ns=START_NS)))
    tracker = MultiTracker(scene.width, scene.height, contours=ContourConfig())
    overlaps = []
    for frame in FrameSource("atsltd_fine", scene.width, scene.height, Settings()).frames(events):
        time_s = (frame.stamp_ns - START_NS) * 1e-9
        if time_s >= starts_s + late_s and not tracker.targets:
            tracker.start("thing", scene.box("thing", starts_s), START_NS + round(starts_s * 1e9))
        for report in tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns):
            if time_s > counts_s:
                overlaps.append(0.0 if report.box is None else report.box.iou(scene.box("thing", time_s)))
    return float(np.mean(overlaps))


def print_overlaps(found: dict[str, list[float]]) -> None:
    """Print a line for each kind of scene: the mean of its overlaps, and how many are a success."""
    for kind, overlaps in found.items():
        good = sum(overlap >= SUCCESS_IOU for overlap in overlaps)
        sys.stdout.write(f"{kind:40s} {np.mean(overlaps):.3f}  {good} of {len(overlaps)}\n")


def seeds_asked_for(first: int, last: int) -> range:
    """Those of the command line, or from the first to before the last if it names none."""
    return range(*map(int, sys.argv[1:3])) if len(sys.argv) > 2 else range(first, last)
