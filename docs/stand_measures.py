"""A car that comes to a halt, brakes before it does or stops at once, and is passed by another one while it stands.

    python docs/stand_measures.py [FIRST LAST]     # seeds, 0 and 10 if none are given; two minutes on two cores

Before a still camera; the other car is tracked by nobody, comes from either side, and hides most of the one that stands
for up to .25 s, or passes below it. Then nothing moves for two seconds. Each line: a kind, how many cars, AP / AR, how
many have an IoU of .5 at the end.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from seeded_scenes import SeededScene, seeds_asked_for, tracked

from etd_ros.evaluation.scoring import SUCCESS_IOU, label_overlaps
from etd_ros.evaluation.suite import START_NS, of_each
from etd_ros.evaluation.truth import TimedBox
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite, true_boxes
from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.motion import FloatArray
from etd_ros.simulation.things import KINDS
from etd_ros.targets import TargetStart

WIDTH, HEIGHT = 346, 260
STREAM = 78
"""Beside the seed: no other list of scenes has these."""
WAYS = "brakes", "brakes, passed beside", "stops at once"
BEHIND = "wall", "cloudy", "clutter", "tiles"
FIRST_S, STANDS_S, AFTER_S, STEP_S = 0.05, 0.6, 2.0, 0.01
VISIBLE_MIN = 0.95


@dataclass(frozen=True)
class Standing(SeededScene):
    """One scene.

    Attributes:
        way: one of WAYS.
    """

    way: str

    def make(self) -> tuple[Scene, SensorConfig]:
        rng = np.random.default_rng([STREAM, self.seed])
        size_px, speed_px_s = int(rng.integers(45, 90)), rng.uniform(90, 160)
        behind = BACKGROUNDS[rng.choice(BEHIND)](rng, HEIGHT, WIDTH)
        way_px, row = rng.uniform(0.4, 0.55) * WIDTH, HEIGHT / 2
        # At half of its speed on average, a way takes twice as long.
        even_px = 0.4 * speed_px_s if self.way.startswith("brakes") else way_px
        braking_s = 2 * (way_px - even_px) / speed_px_s
        even_s = even_px / speed_px_s

        def pose(t: FloatArray) -> tuple[FloatArray, ...]:
            left = 1 - np.clip((t - even_s) / max(braking_s, 1e-9), 0, 1)
            braked_px = (way_px - even_px) * (1 - left**2)
            return 30 + np.minimum(speed_px_s * t, even_px) + braked_px, np.full_like(t, row)

        side, passing_px_s = rng.choice([-1, 1]), rng.uniform(220, 380)
        passes_s = even_s + braking_s + STANDS_S + WIDTH / 2 / passing_px_s
        below_px = 0.75 * size_px if self.way.endswith("beside") else rng.uniform(5, 12)

        def passing(t: FloatArray) -> tuple[FloatArray, ...]:
            return 30 + way_px + side * passing_px_s * (t - passes_s), np.full_like(t, row + below_px)

        duration_s = passes_s + WIDTH / 2 / passing_px_s + AFTER_S
        cars = KINDS["car"](rng, size_px), KINDS["car"](rng, int(size_px * rng.uniform(0.9, 1.2)))
        sprites = (
            Sprite("car", *cars[0], Path.of(pose, duration_s)),
            Sprite("passing", *cars[1], Path.of(passing, duration_s), is_target=False),
        )
        config = SensorConfig(noise_rate_hz=rng.uniform(2e3, 1e4), bandwidth_hz=rng.choice([0.0, 300.0]), step_s=0.002)
        return Scene(WIDTH, HEIGHT, duration_s, behind, sprites), config


def overlaps_of(standing: Standing) -> list[float]:
    """The overlaps of the car's box where nearly all of it can be seen."""
    scene = standing.scene()
    times_s = np.arange(FIRST_S, scene.duration_s - STEP_S, STEP_S)
    seen = true_boxes(scene, "car", times_s, visible_min=VISIBLE_MIN)
    truth = [TimedBox(START_NS + round(time_s * 1e9), box) for time_s, box in seen]
    return label_overlaps(tracked(standing, TargetStart("car", truth[0].box, truth[0].stamp_ns)), truth[1:])


def main() -> None:
    """Print a line for each way."""
    for way in WAYS:
        found = list(of_each(overlaps_of, [Standing(seed, way) for seed in seeds_asked_for(0, 10)], jobs=2))
        ap = np.mean([np.mean(overlaps) for overlaps in found])
        ar = np.mean([np.mean(np.array(overlaps) >= SUCCESS_IOU) for overlaps in found])
        ends = sum(overlaps[-1] >= SUCCESS_IOU for overlaps in found)
        sys.stdout.write(f"{way:24s}{len(found):4d}  {ap:.3f} / {ar:.3f}  {ends}\n")


if __name__ == "__main__":
    main()
