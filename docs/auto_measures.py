"""How much of the time what moves before a still camera has a box of its own, if targets start by themselves.

    python docs/auto_measures.py [FIRST LAST]     # seeds, 0 and 3 if none are given; two minutes

Random cars, people who walk, a lamp that flickers, before random backgrounds, a sensor of 346x260 pixels with noise.
Each line: the share of the time from when half of it can be seen and it moves, in which a box has an IoU of 0.5 with
it; the share of the things that have one most of that time; and starts on what is no thing that moves, of how many.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from seeded_scenes import SeededScene, seeds_asked_for
from walking_people import box_of_all, names_of_all, person

from etd_ros.boxes import Box
from etd_ros.engine import track
from etd_ros.evaluation.scoring import SUCCESS_IOU
from etd_ros.evaluation.suite import START_NS, of_each
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite
from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.motion import Flicker
from etd_ros.simulation.things import KINDS as THINGS
from etd_ros.stream import StreamGuard
from etd_ros.tracking.discovery import shared

WIDTH, HEIGHT, STEP_S = 346, 260, 0.01
RESTS_S = 0.4
"""How long a car stands before it sets off."""

Way = Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]]
"""Where a car's middle is (pixels from the left) at times (s)."""


@dataclass(frozen=True)
class Street(SeededScene):
    """Cars or people, one of the kinds that KINDS makes.

    Attributes:
        kind: which.
    """

    kind: str = ""

    def make(self) -> tuple[Scene, SensorConfig]:
        rng = np.random.default_rng([self.seed, list(KINDS).index(self.kind)])
        background = BACKGROUNDS[rng.choice(["wall", "cloudy", "clutter", "tiles"])](rng, HEIGHT, WIDTH)
        duration_s, sprites = KINDS[self.kind](rng)
        noise = SensorConfig(noise_rate_hz=rng.uniform(2e3, 1e4), bandwidth_hz=rng.choice([0.0, 300.0]))
        return Scene(WIDTH, HEIGHT, duration_s, background, sprites), noise


def passes(rng: np.random.Generator, low_px: int = 40, high_px: int = 110) -> tuple[float, tuple[Sprite, ...]]:
    """A car comes in, passes and leaves."""
    size, speed = int(rng.integers(low_px, high_px)), rng.uniform(60, 320)
    duration_s = min(3.0, (WIDTH + size) / speed)
    return duration_s, (_car(rng, "car", size, lambda t: speed * t - size / 2, 0.5, duration_s),)


def near(rng: np.random.Generator) -> tuple[float, tuple[Sprite, ...]]:
    """A car fills much of the picture."""
    return passes(rng, 120, 190)


def both_ways(rng: np.random.Generator) -> tuple[float, tuple[Sprite, ...]]:
    """Two cars meet in two lanes."""
    first, other = rng.uniform(90, 200, 2)
    size, other_size = rng.integers(40, 80, 2).tolist()
    there = _car(rng, "there", size, lambda t: first * t - size / 2, 0.3, 2.5)
    return 2.5, (there, _car(rng, "back", other_size, lambda t: WIDTH + other_size / 2 - other * t, 0.7, 2.5))


def sets_off(rng: np.random.Generator) -> tuple[float, tuple[Sprite, ...]]:
    """A car stands, and sets off."""
    gains, size = rng.uniform(60, 200), int(rng.integers(40, 100))
    way: Way = lambda t: 100 + gains * np.clip(t - RESTS_S, 0, None) ** 2 / 2  # noqa: E731
    return 2.0, (_car(rng, "car", size, way, 0.55, 2.0),)


def queue(rng: np.random.Generator) -> tuple[float, tuple[Sprite, ...]]:
    """Two cars, one behind the other at half a length to one, at the same speed."""
    speed, size = rng.uniform(35, 90), int(rng.integers(36, 60))
    behind = size * rng.uniform(1.5, 2.0)
    ways: list[Way] = [lambda t: 130 + speed * t, lambda t: 130 - behind + speed * t]
    return 2.0, tuple(_car(rng, f"car_{index}", size, way, 0.55, 2.0) for index, way in enumerate(ways))


def lamp(rng: np.random.Generator) -> tuple[float, tuple[Sprite, ...]]:
    """A car passes, and a lamp flickers."""
    duration_s, (car,) = passes(rng, 40, 80)
    texture, opacity = THINGS["lamp"](rng, int(rng.integers(20, 60)))
    place = Path.of(lambda t: (70 + 0 * t, 57 + 0 * t), duration_s)
    flicker = Flicker(rng.choice([3.0, 8.0, 50.0, 100.0]), rng.uniform(0.2, 0.6))
    return duration_s, (car, Sprite("lamp", texture, opacity, place, is_target=False, flicker=flicker))


def walks(rng: np.random.Generator) -> tuple[float, tuple[Sprite, ...]]:
    """Somebody walks through the picture."""
    return 2.5, _walker(rng, "first", rng.uniform(-0.1, 0.3))


def two_walk(rng: np.random.Generator) -> tuple[float, tuple[Sprite, ...]]:
    """Two walk, to the same side or not."""
    return 2.5, (*_walker(rng, "first", 0.15), *_walker(rng, "second", 0.65))


KINDS = {
    "a car passes": passes,
    "a car passes, 120 to 190 px": near,
    "two cars, both ways": both_ways,
    "a car sets off": sets_off,
    "two cars in a queue": queue,
    "a car passes, a lamp flickers": lamp,
    "somebody walks": walks,
    "two walk": two_walk,
}


def _car(rng: np.random.Generator, name: str, size: int, way: Way, down: float, duration_s: float) -> Sprite:
    texture, opacity = THINGS["car"](rng, size)
    return Sprite(name, texture, opacity, Path.of(lambda t: (way(t), down * HEIGHT + 0 * t), duration_s))


def _walker(rng: np.random.Generator, name: str, starts: float) -> tuple[Sprite, ...]:
    """Somebody who starts at this share of the picture's width from the side that they come from."""
    height_px = rng.uniform(60, 150)
    pace_px_s = height_px * rng.uniform(0.45, 0.95)
    to_the_right = rng.random() < 0.5

    def way(t: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        gone_px = starts * WIDTH + pace_px_s * t
        return gone_px if to_the_right else WIDTH - gone_px

    return person(rng, name, height_px, way, HEIGHT * rng.uniform(0.75, 0.95), 2.5)


def covers(street: Street) -> tuple[str, list[float], list[bool]]:
    """The kind, for each car or person the share of its time with a box, and for each start whether it is on none."""
    scene = street.scene()
    overlaps: dict[str, list[float]] = {name: [] for name in names_of_all(scene)}
    strays: dict[str, bool] = {}
    next_s, guard = 0.0, StreamGuard()
    streams = (batch for part in street.events(scene, start_ns=START_NS) for batch in guard.feed(part))
    for step in track(streams, [], auto=True, threads=False):
        time_s = (step.frame.stamp_ns - START_NS) * 1e-9
        boxes = {report.name: report.box for report in step.reports if report.box is not None}
        truth = {name: box_of_all(scene, name, time_s) for name in overlaps}
        for name in boxes.keys() - strays.keys():
            strays[name] = not any(shared(boxes[name], box) > SUCCESS_IOU for box in truth.values())
        if time_s < next_s:
            continue
        next_s += STEP_S
        for name, box in truth.items():
            seen = _on_sensor(box)
            if seen.w >= box.w / 2 and not (street.kind == "a car sets off" and time_s < RESTS_S):
                overlaps[name].append(max((_on_sensor(found).iou(seen) for found in boxes.values()), default=0.0))
    return street.kind, [float(np.mean(np.array(o) >= SUCCESS_IOU)) for o in overlaps.values()], [*strays.values()]


def _on_sensor(box: Box) -> Box:
    left, right = np.clip([box.x, box.x + box.w], 0, WIDTH).tolist()
    return Box(left, box.y, right - left, box.h)


def main() -> None:
    """Print a line for each kind."""
    streets = [Street(seed, kind) for kind in KINDS for seed in seeds_asked_for(0, 3)]
    found = list(of_each(covers, streets, jobs=2))
    for kind in KINDS:
        shares = [share for of, cars, _ in found if of == kind for share in cars]
        strays = [stray for of, _, starts in found if of == kind for stray in starts]
        most = np.mean(np.array(shares) >= 0.5)
        sys.stdout.write(f"{kind:32s} {np.mean(shares):.2f}  {most:.2f}  {sum(strays)} of {len(strays)}\n")


if __name__ == "__main__":
    main()
