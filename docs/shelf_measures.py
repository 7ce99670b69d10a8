"""A camera slides past things at different depths, none of which changes its size: what `etd-plus` makes of them.

    python docs/shelf_measures.py [FIRST LAST]     # seeds, 0 and 120 if none are given; a minute for 60 on two cores

Pyramids, leaning books, mugs, towers, boxes and chess boards have few edges, many of them slanted, so that a look can
hardly tell moving along them from growing. Labels are those of `evaluate --suite`; some backgrounds are photographs
(extra `simulate`).
"""

from __future__ import annotations

import math
import sys
from collections import defaultdict
from typing import Any

import cv2
import numpy as np
from seeded_scenes import SeededScene, seeds_asked_for

from etd_ros.evaluation.suite import evaluate
from etd_ros.simulation import Scene, things
from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.motion import FloatArray, Path
from etd_ros.simulation.motions import Track
from etd_ros.simulation.scene import Sprite
from etd_ros.simulation.sensor import SensorConfig
from etd_ros.simulation.solids import SOLIDS
from etd_ros.simulation.textures import BRIGHT, DARK, smooth_noise

STREAM = 77
WIDTH, HEIGHT, DURATION_S = 240, 180, 2.0


def main() -> None:
    """Print the mean AP and AR of each kind of thing and of all."""
    shelves: Any = [Shelf(seed) for seed in seeds_asked_for(0, 120)]  # as far as `evaluate` asks, they are sequences
    results = [result for found in evaluate(shelves, jobs=2) for result in found]
    kinds = defaultdict(list)
    for result in results:
        kinds[result.target.rsplit("_", 1)[0]].append(result)
    for kind, of_kind in [*sorted(kinds.items()), ("all", results)]:
        ap, ar = (np.mean([getattr(result, figure) for result in of_kind]) for figure in ("ap", "ar"))
        sys.stdout.write(f"{kind:<12}{len(of_kind):>5}{ap:>8.3f}{ar:>8.3f}\n")
    ap = np.array([result.ap for result in results])
    sys.stdout.write(f"median AP {np.median(ap):.3f}; {np.count_nonzero(ap < 0.5)} below 0.5\n")


class Shelf(SeededScene):
    """Things that a camera slides past."""

    def make(self) -> tuple[Scene, SensorConfig]:
        rng = np.random.default_rng([STREAM, self.seed])
        shift = _camera(rng)
        nearness = np.sort(np.exp(rng.uniform(np.log(1.1), np.log(4.5), int(rng.integers(3, 7)))))
        background = _background(rng, *(float(np.abs(way[-1])) for way in shift(np.array([DURATION_S]))))
        sprites = tuple(_sprite(rng, number, float(near), shift) for number, near in enumerate(nearness))
        sensor = SensorConfig(
            contrast_threshold=float(rng.uniform(0.15, 0.3)),
            threshold_spread=0.03,
            noise_rate_hz=float(rng.uniform(0, 8000)),
            step_s=0.005,
            step_px=0.6,
        )
        view = Path.of(shift, DURATION_S)
        return Scene(WIDTH, HEIGHT, DURATION_S, background, sprites, view=view), sensor


def _camera(rng: np.random.Generator) -> Track:
    """How far the background has moved at times (s): to the side in most scenes, at a speed that hardly changes."""
    speed_px_s = rng.uniform(20, 70) * rng.choice([-1, 1])
    angle = 0.0 if rng.uniform() < 0.6 else rng.uniform(0, 2 * np.pi)
    swing, rate = rng.uniform(-0.3, 0.3), 2 * np.pi * rng.uniform(0.2, 0.7)

    def shift(times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        way = speed_px_s * (times_s + swing / rate * (1 - np.cos(rate * times_s)))
        return way * np.cos(angle), way * np.sin(angle)

    return shift


def _background(rng: np.random.Generator, way_x: float, way_y: float) -> FloatArray:
    kind = str(rng.choice(["shelf", "shelf", "photo", "clutter", "wall"]))
    height, width = HEIGHT + 2 * math.ceil(way_y + 4), WIDTH + 2 * math.ceil(way_x + 4)
    if kind != "shelf":
        return BACKGROUNDS[kind](rng, height, width)
    picture = rng.uniform(0.3, 0.8) * (1 + 0.1 * (smooth_noise(rng, height, width) - 0.5))
    for _ in range(int(rng.integers(3, 8))):
        x, y, tone = rng.uniform(0, width), rng.uniform(0, height), float(rng.uniform(DARK, 0.9))
        if rng.uniform() < 0.5:
            corner = int(x + rng.uniform(20, 200)), int(y + rng.uniform(3, 80))
            cv2.rectangle(picture, (int(x), int(y)), corner, tone, cv2.FILLED)
        else:
            cv2.rectangle(picture, (int(x), 0), (int(x + rng.uniform(2, 12)), height), tone, cv2.FILLED)
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.7), DARK, BRIGHT)


def _sprite(rng: np.random.Generator, number: int, nearness: float, shift: Track) -> Sprite:
    kind = KINDS[int(rng.integers(len(KINDS)))]
    texture, opacity = kind(rng, round(float(np.exp(rng.uniform(np.log(22), np.log(95))))))
    seen_x, seen_y = (float(way[0]) for way in shift(np.array([rng.uniform(0, 0.8 * DURATION_S)])))
    x = rng.uniform(0.2, 0.8) * WIDTH + nearness * seen_x
    y = rng.uniform(0.25, 0.8) * HEIGHT + nearness * seen_y
    path = Path.of(lambda times: (np.full_like(times, x), np.full_like(times, y)), DURATION_S)
    return Sprite(f"{kind.__name__}_{number}", texture, opacity, path, nearness=nearness)


KINDS = (*SOLIDS, things.ball, things.plain, things.panel, things.dartboard, things.irregular)


if __name__ == "__main__":
    main()
