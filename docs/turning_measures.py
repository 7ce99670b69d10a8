"""What `etd-plus` makes of what turns: in place, swinging, on its way, or with all that the camera sees as it rolls.

    python docs/turning_measures.py [FIRST LAST]     # seeds, 4 and 8 if none are given; two minutes

Squares, rectangles, discs, stars and photographs of 20 to 80 px, at first upright or turned, before a wall or clutter,
a sensor of 240x180 pixels with noise. Each line: mean IoU of the boxes in the second half of the scene (a target
without a box has 0), and how many of the scenes have .5 on average. The code was chosen by seeds 0 to 3. Some things
are photographs (extra `simulate`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from everyday_measures import HEIGHT, WIDTH
from seeded_scenes import SeededScene, mean_overlap, print_overlaps, seeds_asked_for

from etd_ros.simulation import Path, Scene, SensorConfig, Sprite
from etd_ros.simulation.backgrounds import clutter, wall
from etd_ros.simulation.photographs import photograph
from etd_ros.simulation.textures import checks
from etd_ros.simulation.things import OVERSAMPLING, Thing, ball, dartboard, shrunk, surface_of

STREAM = 98
"""Beside the seed: no other list of scenes has these."""
STARTS_S, DURATION_S, WAY_PX = 0.02, 1.2, 130
SWINGS_RAD, SWINGS_HZ = (0.3, 1.2), (0.4, 1.5)
OFF_MIDDLE_PX = 40
"""How far from the sensor's middle a thing is, of a camera that rolls."""


def square(rng: np.random.Generator, size: int) -> Thing:
    """A checked one."""
    return checks(rng, size, size, cell=max(4, size // 4)), np.ones((size, size))


def rectangle(rng: np.random.Generator, size: int) -> Thing:
    """One that is twice as wide as high."""
    return surface_of(rng, size // 2, size), np.ones((size // 2, size))


def disc(rng: np.random.Generator, size: int) -> Thing:
    """A dartboard or a ball."""
    return (dartboard if rng.uniform() < 0.5 else ball)(rng, size)


def star(rng: np.random.Generator, size: int) -> Thing:
    """A plain triangle, star or hexagon, bright or dark, as wide or high as `size`."""
    points, inner = ((3, 0.5), (5, 0.45), (6, 0.866))[rng.integers(3)]
    angles = np.arange(2 * points) * np.pi / points - np.pi / 2
    radius = np.where(np.arange(2 * points) % 2, inner, 1.0)
    corners = np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)
    corners -= corners.min(axis=0)
    corners *= (size * OVERSAMPLING - 1) / corners.max()
    width, height = (OVERSAMPLING * math.ceil((extent + 1) / OVERSAMPLING) for extent in corners.max(axis=0))
    inside = np.zeros((height, width))
    cv2.fillPoly(inside, [np.rint(corners).astype(np.int32)], 1.0)
    opacity = shrunk(inside)
    return np.full_like(opacity, rng.choice((0.2, 0.9))), opacity


def patch(rng: np.random.Generator, size: int) -> Thing:
    """Of a photograph."""
    height = round(size * rng.uniform(0.6, 1.0))
    return photograph(rng, height, size), np.ones((height, size))


THINGS = square, rectangle, disc, star, patch

Times = npt.NDArray[np.float64]
Range = tuple[float, float]


@dataclass(frozen=True)
class Turning(SeededScene):
    """A thing that turns.

    Attributes:
        kind: what it is an example of.
        thing: makes it.
        turning_rad_s: how fast it turns, at least and at most; nothing where it swings.
        moving_px_s: how fast it moves along.
        rolls: whether the camera turns instead.
    """

    kind: str
    thing: Callable[[np.random.Generator, int], Thing]
    turning_rad_s: Range | None
    moving_px_s: Range = (0.0, 0.0)
    rolls: bool = False

    def make(self) -> tuple[Scene, SensorConfig]:
        rng = np.random.default_rng([STREAM, self.seed, THINGS.index(self.thing), *self.kind.encode()])
        size = round(math.exp(rng.uniform(math.log(20), math.log(80))))
        texture, opacity = self.thing(rng, size)
        angle_rad = rng.choice((0.0, rng.uniform(0, 2 * math.pi)))
        speed_px_s, towards_rad = rng.uniform(*self.moving_px_s), rng.uniform(0, 2 * math.pi)
        duration_s = min(DURATION_S, WAY_PX / max(speed_px_s, 1.0))
        turned = self._turned(rng)
        across, down = math.cos(towards_rad), math.sin(towards_rad)
        off_px = rng.uniform(0, OFF_MIDDLE_PX) if self.rolls else 0.0

        def pose(t: Times) -> tuple[Times | float, ...]:
            gone_px = off_px + speed_px_s * (t - duration_s / 2)
            angle = angle_rad + (0.0 if self.rolls else turned(t))
            return WIDTH / 2 + across * gone_px, HEIGHT / 2 + down * gone_px, 1.0, angle

        background = (clutter if self.rolls or rng.uniform() < 0.5 else wall)(rng, HEIGHT, WIDTH)
        view = Path.of(lambda t: (0.0, 0.0, 1.0, turned(t)), duration_s) if self.rolls else None
        sprite = Sprite("thing", texture, opacity, Path.of(pose, duration_s))
        scene = Scene(WIDTH, HEIGHT, duration_s, background, (sprite,), view=view)
        return scene, SensorConfig(noise_rate_hz=float(rng.choice((1000.0, 5000.0))))

    def _turned(self, rng: np.random.Generator) -> Callable[[Times], Times]:
        """By how much it has turned (rad) at times (s)."""
        way = rng.choice((-1, 1))
        if self.turning_rad_s is not None:
            rate = way * rng.uniform(*self.turning_rad_s)
            return lambda t: rate * t
        most_rad, swings_hz = way * rng.uniform(*SWINGS_RAD), rng.uniform(*SWINGS_HZ)
        return lambda t: most_rad * np.sin(2 * np.pi * swings_hz * t)


def all_kinds(seeds: range) -> Iterator[Turning]:
    """Every thing in every motion."""
    for seed, thing in itertools.product(seeds, THINGS):
        for least, most in ((0.5, 1.0), (1.0, 3.0), (3.0, 8.0)):
            yield Turning(seed, f"in place, {least} to {most} rad/s", thing, (least, most))
        yield Turning(seed, "swings", thing, None)
        for slowest, fastest in ((30.0, 80.0), (80.0, 200.0)):
            kind = f"on its way, {slowest:.0f} to {fastest:.0f} px/s"
            yield Turning(seed, kind, thing, (0.5, 5.0), (slowest, fastest))
        yield Turning(seed, "with all, .3 to 1.5 rad/s", thing, (0.3, 1.5), rolls=True)


def main() -> None:
    """Print a line for each motion and each thing."""
    found: dict[str, list[float]] = {}
    for turning in all_kinds(seeds_asked_for(4, 8)):
        overlap = mean_overlap(turning, STARTS_S, turning.scene().duration_s / 2)
        for kind in (turning.kind, turning.thing.__name__, "all"):
            found.setdefault(kind, []).append(overlap)
    print_overlaps(found)


if __name__ == "__main__":
    main()
