"""What `etd-plus` makes of what stands still before a camera in a hand that moves ever faster.

    python docs/handheld_measures.py [FIRST LAST]     # seeds, 0 and 12 if none are given; eight minutes

Dark shapes on a bright wall, as on a sheet of paper, and pictures on a poster, all of one depth (240x180 pixels,
noise). The camera shifts to and fro ("shifts"), rolls as well ("rolls"), or does both and comes nearer and goes away
("six"); within 3 s its motion becomes four times as fast. Targets are those that stay on the sensor, up to four a
scene. Each line: mean IoU of the boxes from their starts on (a target without a box has 0), and how many have .5 on
average in the last fifth. The code was chosen by the shapes of seeds 0 to 9.
Posters are photographs (extra `simulate`).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from seeded_scenes import SeededScene, seeds_asked_for, tracked_all
from turning_measures import star

from etd_ros.evaluation.scoring import SUCCESS_IOU, label_overlaps
from etd_ros.evaluation.suite import START_NS, of_each
from etd_ros.evaluation.truth import TimedBox
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite
from etd_ros.simulation.photographs import photograph
from etd_ros.simulation.textures import smooth_noise
from etd_ros.simulation.things import Thing
from etd_ros.simulation.truth import visible_shares
from etd_ros.targets import TargetStart

STREAM = 95
"""Beside the seed: no other list of scenes has these."""
WIDTH, HEIGHT = 240, 180
DURATION_S, STARTS_S, LABEL_S = 3.0, 0.1, 0.01
FASTER = 4.0
"""At the end, over the start."""
SPEED_PX_S = 40.0, 250.0
"""The root mean square of its shift at the end."""
AREA_PX, ROLL_RAD, ZOOM = 45.0, 0.45, 0.18
"""The most that it shifts, rolls and enlarges."""
ROLL_RATE, ZOOM_RATE = 0.6, 0.4
"""How often it does so, over how often it shifts."""
KINDS = "shifts", "rolls", "six"

Times = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Handheld(SeededScene):
    """Things of one depth before a camera that moves.

    Attributes:
        kind: how the camera moves, of KINDS.
        poster: whether they are pictures on a poster, or shapes on paper.
    """

    kind: str
    poster: bool

    stream: ClassVar[int] = STREAM
    kinds: ClassVar[tuple[str, ...]] = KINDS

    def make(self) -> tuple[Scene, SensorConfig]:
        rng = np.random.default_rng([self.stream, self.seed, self.poster, self.kinds.index(self.kind)])
        sheet = HEIGHT + 120, WIDTH + 120
        background = photograph(rng, *sheet) if self.poster else 0.8 + 0.02 * smooth_noise(rng, *sheet)
        sprites = []
        for row in range(3):
            for column in range(4):
                size = round(math.exp(rng.uniform(math.log(22), math.log(48))))
                x, y = (60 * (column - 1.5) + rng.uniform(-6, 6), 60 * (row - 1) + rng.uniform(-6, 6))
                place = Path.of(lambda t, x=x, y=y: (WIDTH / 2 + x + 0 * t, HEIGHT / 2 + y), DURATION_S)
                texture, opacity = self._thing(rng, size)
                sprites.append(Sprite(f"thing_{row}_{column}", texture, opacity, place))
        scene = Scene(WIDTH, HEIGHT, DURATION_S, background, tuple(sprites), view=self._camera(rng))
        return scene, SensorConfig(noise_rate_hz=float(rng.choice((1000.0, 5000.0))))

    def _thing(self, rng: np.random.Generator, size: int) -> Thing:
        height = round(size * rng.uniform(0.6, 1.0))
        if self.poster:
            return photograph(rng, height, size), np.ones((height, size))
        if rng.uniform() < 0.4:
            return np.full((height, size), 0.15), np.ones((height, size))
        _, opacity = star(rng, size)
        return np.full_like(opacity, 0.15), opacity

    def _camera(self, rng: np.random.Generator) -> Path:
        speed_px_s = math.exp(rng.uniform(*np.log(SPEED_PX_S)))
        waves = rng.uniform(0, 2 * np.pi, 4), rng.uniform(0.7, 1.4, 4) * (1.0, 1.0, ZOOM_RATE, ROLL_RATE)
        # The frequency goes up: what goes a way in ever less time is ever faster.
        most_hz = speed_px_s / (np.pi * math.sqrt(2) * AREA_PX) * rng.uniform(1.0, 2.0)

        def sway(t: Times, number: int) -> Times:
            phase, rate = waves[0][number], waves[1][number]
            cycles = most_hz * rate * (t / FASTER + (1 - 1 / FASTER) * t**2 / (2 * DURATION_S))
            return np.asarray(np.sin(phase + 2 * np.pi * cycles), np.float64)

        reach_px = speed_px_s / (2 * np.pi * most_hz) * math.sqrt(2)

        def pose(t: Times) -> tuple[Times, ...]:
            x, y, zoom, roll = (sway(t, number) for number in range(4))
            shares = {"shifts": (1.0, 0.0, 0.0), "rolls": (0.4, 1.0, 0.0), "six": (0.7, 0.6, 1.0)}[self.kind]
            shift, rolls, zooms = shares
            return reach_px * shift * x, reach_px * shift * y, 1 + ZOOM * zooms * zoom, ROLL_RAD * rolls * roll

        return Path.of(pose, DURATION_S)


def overlaps_of(handheld: Handheld) -> list[tuple[float, float]]:
    """For each target its mean IoU from the start on, and that of the last fifth."""
    scene = handheld.scene()
    times = np.arange(0, DURATION_S, 0.05)
    names = [name for name in scene.targets if visible_shares(scene, name, times.tolist()).visible.min() > 0.95][:4]
    starts = [TargetStart(name, scene.box(name, STARTS_S), START_NS + round(STARTS_S * 1e9)) for name in names]
    rows = tracked_all(handheld, starts) if starts else []
    found = []
    for name in names:
        labels = [
            TimedBox(START_NS + round(time_s * 1e9), scene.box(name, time_s))
            for time_s in np.arange(STARTS_S + LABEL_S, DURATION_S, LABEL_S).tolist()
        ]
        overlaps = label_overlaps([row for row in rows if row.target == name], labels)
        found.append((float(np.mean(overlaps)), float(np.mean(overlaps[-len(overlaps) // 5 :]))))
    return found


def all_scenes(motions: type[Handheld], seeds: range) -> Iterator[Handheld]:
    """Every motion before every sheet."""
    for seed in seeds:
        for kind in motions.kinds:
            for poster in (False, True):
                yield motions(seed, kind, poster)


def print_scenes(scenes: Sequence[Handheld]) -> None:
    """Print a line for each motion and sheet."""
    found: dict[str, list[tuple[float, float]]] = {}
    for scene, overlaps in zip(scenes, of_each(overlaps_of, iter(scenes), jobs=2), strict=True):
        for kind in (f"{'poster' if scene.poster else 'shapes'}, {scene.kind}", "all"):
            found.setdefault(kind, []).extend(overlaps)
    for kind, pairs in found.items():
        whole, last = np.array(pairs).T
        held = np.count_nonzero(last >= SUCCESS_IOU)
        sys.stdout.write(f"{kind:20s} {whole.mean():.3f}  {held} of {len(last)}\n")


def main() -> None:
    """Print the lines of all."""
    print_scenes(list(all_scenes(Handheld, seeds_asked_for(0, 12))))


if __name__ == "__main__":
    main()
