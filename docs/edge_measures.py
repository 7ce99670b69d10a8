"""What `etd-plus` makes of things with long parallel edges, along which one place looks like the next: bars,
rectangles, stripes, ladders, and people who walk.

    python docs/edge_measures.py [FIRST LAST]     # seeds, 0 and 6 if none are given; two minutes

Before walls, clouds and tiles, 30 to 200 px/s, a sensor of 240x180 pixels with noise. Each line: mean IoU of the boxes
(a target without a box has 0), and how many of the things have .5 in the last fifth of their time.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from seeded_scenes import SeededScene, seeds_asked_for, tracked
from walking_people import boxes_of_stride, person

from etd_ros.boxes import Box
from etd_ros.evaluation.scoring import SUCCESS_IOU, label_overlaps
from etd_ros.evaluation.suite import START_NS, of_each
from etd_ros.evaluation.truth import TimedBox
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite
from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.textures import BRIGHT, DARK, smooth_noise
from etd_ros.targets import TargetStart

STREAM = 77
"""Beside the seed: no other list of scenes has these."""
WIDTH, HEIGHT = 240, 180
WAY_PX, DURATION_MAX_S, STARTS_S, LABEL_S = 130.0, 3.0, 0.05, 0.01
END_SHARE = 0.2
PACES = 0.45, 1.4
"""How many times their height people walk in a second."""

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Course:
    """A straight way through the sensor's middle.

    Attributes:
        angle_rad: its direction.
        speed_px_s: along it.
        duration_s: how long it takes.
        sway_px: how far it swings to the side, once or twice.
    """

    angle_rad: float
    speed_px_s: float
    sway_px: float = 0.0

    @property
    def duration_s(self) -> float:
        return min(WAY_PX / self.speed_px_s, DURATION_MAX_S)

    def at(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Where the middle is (pixels)."""
        along = self.speed_px_s * (times_s - self.duration_s / 2)
        aside = self.sway_px * np.sin(3 * np.pi * times_s / self.duration_s)
        cos, sin = math.cos(self.angle_rad), math.sin(self.angle_rad)
        return WIDTH / 2 + cos * along - sin * aside, HEIGHT / 2 + sin * along + cos * aside


Parts = tuple[Course, tuple[Sprite, ...]]
Maker = Callable[[np.random.Generator], Parts]


@dataclass(frozen=True)
class LongEdged(SeededScene):
    """A thing, one of the kinds that KINDS makes.

    Attributes:
        kind: which.
    """

    kind: str = ""

    def make(self) -> tuple[Scene, SensorConfig]:
        rng = np.random.default_rng([STREAM, self.seed, list(KINDS).index(self.kind)])
        course, parts = KINDS[self.kind](rng)
        if self.seed % 2:
            background = BACKGROUNDS[rng.choice(["wall", "cloudy", "tiles"])](rng, HEIGHT, WIDTH)
        else:
            background = 0.5 + 0.05 * smooth_noise(rng, HEIGHT, WIDTH)
        noise = SensorConfig(noise_rate_hz=float(rng.choice([500.0, 2000.0, 8000.0])))
        return Scene(WIDTH, HEIGHT, course.duration_s, background, parts), noise


def _course(rng: np.random.Generator, angle_rad: float) -> Course:
    return Course(angle_rad, rng.uniform(30, 200), float(rng.choice([0.0, 3.0])))


def _block(
    rng: np.random.Generator, long_px: int, short_px: int, texture: Floats | None = None
) -> tuple[Floats, Floats]:
    """A rectangle that lies along x: plain, unless it has a texture."""
    plain = np.full((short_px, long_px), rng.choice([0.2, 0.95]))
    return np.clip(plain if texture is None else texture, DARK, BRIGHT), np.ones((short_px, long_px))


def _moved(block: tuple[Floats, Floats], course: Course, turned_rad: float) -> Parts:
    path = Path.of(lambda t: (*course.at(t), 1.0, turned_rad), course.duration_s)
    return course, (Sprite("thing", *block, path),)


def _along(turned_rad: float, rng: np.random.Generator, least_rad: float, most_rad: float) -> Course:
    """A course this far (rad) off an axis."""
    off_rad = rng.uniform(least_rad, most_rad) * rng.choice([-1, 1]) + rng.choice([0, math.pi])
    return _course(rng, turned_rad + off_rad)


def bar_along(rng: np.random.Generator) -> Parts:
    """A thin bar that moves along itself, or nearly."""
    turned = rng.uniform(0, math.pi)
    block = _block(rng, int(rng.integers(40, 80)), int(rng.integers(5, 16)))
    return _moved(block, _along(turned, rng, 0, 0.15), turned)


def bar_across(rng: np.random.Generator) -> Parts:
    """One that moves across itself, or nearly."""
    turned = rng.uniform(0, math.pi)
    block = _block(rng, int(rng.integers(40, 80)), int(rng.integers(5, 16)))
    return _moved(block, _along(turned + math.pi / 2, rng, 0, 0.15), turned)


def bar_askew(rng: np.random.Generator) -> Parts:
    """One that moves at an angle to itself."""
    turned = rng.uniform(0, math.pi)
    block = _block(rng, int(rng.integers(40, 80)), int(rng.integers(5, 16)))
    return _moved(block, _along(turned, rng, 0.4, 1.2), turned)


def rectangle(rng: np.random.Generator) -> Parts:
    """An upright plain rectangle that moves along its sides, or nearly."""
    block = _block(rng, int(rng.integers(35, 80)), int(rng.integers(16, 35)))
    turned = float(rng.choice([0.0, math.pi / 2]))
    return _moved(block, _along(float(rng.choice([0.0, math.pi / 2])), rng, 0, 0.1), turned)


def striped(rng: np.random.Generator) -> Parts:
    """A square with stripes that moves in any direction to them."""
    size = int(rng.integers(25, 60))
    period = rng.uniform(6, 14)
    wave = np.sin(2 * np.pi * (np.arange(size) + rng.uniform(0, period)) / period)
    texture = np.tile(0.55 + 0.35 * np.tanh(3 * wave), (size, 1))
    turned = rng.uniform(0, math.pi)
    return _moved(_block(rng, size, size, texture), _course(rng, rng.uniform(0, 2 * math.pi)), turned)


def ladder(rng: np.random.Generator) -> Parts:
    """Two rails and rungs one can look through, in any direction to its motion."""
    long_px, short_px = int(rng.integers(45, 80)), int(rng.integers(18, 30))
    texture, opacity = _block(rng, long_px, short_px)
    gap, rail, rung = int(rng.integers(8, 15)), 3, 3
    opacity[rail:-rail] = 0
    for left in range(0, long_px - rung, gap):
        opacity[:, left : left + rung] = 1
    opacity[:, -rung:] = 1
    turned = rng.uniform(0, math.pi)
    return _moved((texture, opacity), _course(rng, rng.uniform(0, 2 * math.pi)), turned)


def walker(rng: np.random.Generator) -> Parts:
    """Somebody who walks to the side."""
    height_px = float(rng.uniform(40, 80))
    course = Course(float(rng.choice([0.0, math.pi])), height_px * float(rng.uniform(*PACES)))
    foot_px = (HEIGHT + height_px) / 2
    return course, person(rng, "thing", height_px, lambda t: course.at(t)[0], foot_px, course.duration_s)


KINDS: dict[str, Maker] = {
    "a bar along itself": bar_along,
    "a bar across itself": bar_across,
    "a bar askew": bar_askew,
    "a rectangle": rectangle,
    "stripes": striped,
    "a ladder": ladder,
    "a walker": walker,
}


def true_boxes(scene: Scene, times_s: Floats) -> list[Box]:
    """Round all of the thing (pixels) at times (s); somebody's limbs reach as far as on average."""
    if len(scene.targets) > 1:
        return boxes_of_stride(scene, "thing", times_s)
    return [scene.box("thing", time_s) for time_s in times_s]


def overlaps_of(thing: LongEdged) -> tuple[str, list[float]]:
    """What it is an example of, and the IoU of its boxes at each label."""
    scene = thing.scene()
    times_s = np.arange(STARTS_S, scene.duration_s, LABEL_S)
    start, *truth = (
        TimedBox(START_NS + round(time_s * 1e9), box)
        for time_s, box in zip(times_s.tolist(), true_boxes(scene, times_s), strict=True)
    )
    found = tracked(thing, TargetStart("thing", start.box, start.stamp_ns))
    return thing.kind, label_overlaps(found, truth)


def main() -> None:
    """Print a line for each kind, and one for all."""
    things = [LongEdged(seed, kind) for kind in KINDS for seed in seeds_asked_for(0, 6)]
    found: dict[str, list[tuple[float, float]]] = {}
    for kind, overlaps in of_each(overlaps_of, things, jobs=2):
        end = math.ceil(len(overlaps) * END_SHARE)
        for name in (kind, "all"):
            found.setdefault(name, []).append((float(np.mean(overlaps)), float(np.mean(overlaps[-end:]))))
    for name in [*KINDS, "all"]:
        means, ends = zip(*found[name], strict=True)
        good = sum(end >= SUCCESS_IOU for end in ends)
        sys.stdout.write(f"{name:24s} {np.mean(means):.3f}  {good} of {len(ends)}\n")


if __name__ == "__main__":
    main()
