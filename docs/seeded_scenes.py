"""What the lists of simulated scenes share that are measured here."""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from etd_ros.engine import track
from etd_ros.evaluation.suite import START_NS
from etd_ros.evaluation.tracks import TrackRow
from etd_ros.events import Events
from etd_ros.simulation import Scene, SensorConfig, simulate
from etd_ros.stream import StreamGuard
from etd_ros.targets import TargetStart
from etd_ros.tracking import TargetState


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
    guard = StreamGuard()
    events = seeded.events(seeded.scene(), start_ns=START_NS)
    rows = []
    for step in track((batch for part in events for batch in guard.feed(part)), [start], threads=False):
        (report,) = step.reports
        if report.state is not TargetState.IDLE:
            rows.append(TrackRow(step.frame.stamp_ns, report.name, report.box, report.score, report.state.value))
    return rows


def seeds_asked_for(first: int, last: int) -> range:
    """Those of the command line, or from the first to before the last if it names none."""
    return range(*map(int, sys.argv[1:3])) if len(sys.argv) > 2 else range(first, last)
