"""Cars that follow one another, each tracked, and leave the sensor one after the other.

    python docs/platoon_measures.py [FIRST LAST]     # seeds, 0 and 12 if none are given; a minute on two cores

Four cars on a lane before a still camera, as fast as each other or nearly so, half a length to two apart; in every
other scene all look alike. Each line: which scenes, how many cars, AP / AR while nearly all of a car can be seen, how
many are said to be tracked after they have left, and the share of the time then in which they are.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from seeded_scenes import SeededScene, seeds_asked_for, tracked_all

from etd_ros.evaluation.scoring import SUCCESS_IOU, label_overlaps
from etd_ros.evaluation.suite import START_NS, of_each
from etd_ros.evaluation.truth import TimedBox
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite, true_boxes
from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.motion import FloatArray
from etd_ros.simulation.things import KINDS
from etd_ros.targets import TargetStart

WIDTH, HEIGHT = 346, 260
STREAM = 79
"""Beside the seed: no other list of scenes has these."""
CARS, BEHIND = 4, ("wall", "cloudy", "clutter", "tiles")
AFTER_S, GONE_S, STEP_S = 1.0, 0.2, 0.01
"""The scene goes on for so long after the last car; a car is gone so long after nothing of it can be seen."""
VISIBLE_MIN = 0.95


@dataclass(frozen=True)
class Platoon(SeededScene):
    """One scene."""

    @property
    def looks_alike(self) -> bool:
        """Whether all cars look alike."""
        return self.seed % 2 == 1

    def make(self) -> tuple[Scene, SensorConfig]:
        rng = np.random.default_rng([STREAM, self.seed])
        size_px, speed_px_s = int(rng.integers(36, 70)), rng.uniform(100, 260)
        behind = BACKGROUNDS[rng.choice(BEHIND)](rng, HEIGHT, WIDTH)
        row, side = rng.uniform(0.35, 0.65) * HEIGHT, rng.choice([-1, 1])
        gaps_px = size_px * rng.uniform(1.5, 3.0, CARS - 1)
        behind_px = np.concatenate([[0.0], np.cumsum(gaps_px)])
        speeds_px_s = speed_px_s * rng.uniform(0.97, 1.03, CARS)
        duration_s = (WIDTH + 2 * size_px + behind_px[-1]) / speed_px_s + AFTER_S
        looks = [KINDS["car"](rng, size_px) for _ in range(CARS)]

        def pose_of(number: int) -> Path:
            def pose(t: FloatArray) -> tuple[FloatArray, ...]:
                along_px = speeds_px_s[number] * t - behind_px[number] + 0.6 * size_px
                return WIDTH / 2 + side * (along_px - WIDTH / 2), np.full_like(t, row + 3 * (number % 2))

            return Path.of(pose, duration_s)

        cars = [Sprite(f"car_{n}", *looks[0 if self.looks_alike else n], pose_of(n)) for n in range(CARS)]
        config = SensorConfig(noise_rate_hz=rng.uniform(2e3, 1e4), step_s=0.002)
        return Scene(WIDTH, HEIGHT, duration_s, behind, tuple(cars)), config


class Followed(NamedTuple):
    """One car: its overlaps while it can be seen, and for how much of the time after it has left it is said to be
    tracked."""

    looks_alike: bool
    overlaps: list[float]
    tracked_when_gone: float


def followed(platoon: Platoon) -> list[Followed]:
    """The cars of a scene."""
    scene = platoon.scene()
    times_s = np.arange(0.02, scene.duration_s - STEP_S, STEP_S)
    truths = {
        name: [
            TimedBox(START_NS + round(time_s * 1e9), box)
            for time_s, box in true_boxes(scene, name, times_s, visible_min=VISIBLE_MIN)
        ]
        for name in scene.targets
    }
    rows = tracked_all(platoon, [TargetStart(name, truth[0].box, truth[0].stamp_ns) for name, truth in truths.items()])
    found = []
    for name, truth in truths.items():
        own = [row for row in rows if row.target == name]
        gone_s = max(time_s for time_s, _ in true_boxes(scene, name, times_s, visible_min=0.02)) + GONE_S
        later = [row for row in own if row.stamp_ns > START_NS + round(gone_s * 1e9)]
        wrongly = float(np.mean([row.box is not None for row in later])) if later else 0.0
        found.append(Followed(platoon.looks_alike, label_overlaps(own, truth[1:]), wrongly))
    return found


def _print(what: str, cars: Sequence[Followed]) -> None:
    ap = np.mean([np.mean(car.overlaps) for car in cars])
    ar = np.mean([np.mean(np.array(car.overlaps) >= SUCCESS_IOU) for car in cars])
    wrong = sum(car.tracked_when_gone > 0 for car in cars)
    share = np.mean([car.tracked_when_gone for car in cars])
    sys.stdout.write(f"{what:16s}{len(cars):4d}  {ap:.3f} / {ar:.3f}  {wrong}  {share:.3f}\n")


def main() -> None:
    """Print the lines."""
    platoons = [Platoon(seed) for seed in seeds_asked_for(0, 12)]
    cars = [car for of_scene in of_each(followed, platoons, jobs=2) for car in of_scene]
    for looks_alike, what in ((False, "all different"), (True, "all alike")):
        _print(what, [car for car in cars if car.looks_alike is looks_alike])


if __name__ == "__main__":
    main()
