"""How much of the time what moves before a moving camera has a box of its own, if targets start by themselves.

    python docs/moving_camera_measures.py [FIRST LAST]     # seeds, 0 and 4 if none are given; three minutes

Random things of 20 to 90 px that move through the world by 30 to 300 px/s, or people who walk, before random
backgrounds (photographs among them), and a camera that pans, slides past something near, shakes or drives forward; a
sensor of 346x260 pixels with noise. Each line: the share of the time in which half of a thing can be seen and a box has
an IoU of 0.5 with it; the share of the things that have one most of that time; of those that have one within 0.3 s;
starts a second on what does not move by itself; and processor time a frame of looking for what moves (ms). Constants
are chosen on seeds below 100.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from seeded_scenes import SeededScene, seeds_asked_for
from walking_people import box_of_all, names_of_all, person

from etd_ros.boxes import Box
from etd_ros.engine import track
from etd_ros.evaluation.scoring import SUCCESS_IOU
from etd_ros.evaluation.starting import on_sensor
from etd_ros.evaluation.suite import START_NS, of_each
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite
from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.motions import shakes
from etd_ros.simulation.textures import Texture
from etd_ros.simulation.things import KINDS as THINGS
from etd_ros.stream import StreamGuard
from etd_ros.tracking import DiscoveryConfig, Starter
from etd_ros.tracking.discovery import shared
from etd_ros.warm_up import warm_up

WIDTH, HEIGHT, DURATION_S, STEP_S = 346, 260, 1.6, 0.01
SOON_S = 0.3
SHAKE_HZ_MEAN = 3.0

Values = npt.NDArray[np.float64]
Camera = Callable[[Values], tuple[Values, ...]]
"""How far the background has gone to the left and upwards (pixels), its scale and angle (rad), at times (s)."""


@dataclass(frozen=True)
class Trip(SeededScene):
    """A camera that moves, one of the kinds that KINDS makes.

    Attributes:
        kind: which.
    """

    kind: str = ""

    def make(self) -> tuple[Scene, SensorConfig]:
        rng = np.random.default_rng([self.seed, list(KINDS).index(self.kind), 7])
        make_camera, make_sprites = KINDS[self.kind]
        camera = make_camera(rng)
        background = _background(rng, camera)
        sprites = make_sprites(rng)
        noise = SensorConfig(noise_rate_hz=rng.uniform(2e3, 1e4), step_s=0.005, step_px=0.6)
        view = Path.of(camera, DURATION_S)
        return Scene(WIDTH, HEIGHT, DURATION_S, background, sprites, view=view), noise


@dataclass
class Found:
    """What came of the things of a scene.

    Attributes:
        kind: of the scene.
        shares: for each thing, of the time in which half of it can be seen, that with a box.
        soon: for each thing, whether it has one within SOON_S.
        false_starts: targets that started on what does not move by itself.
        frame_ms: mean processor time a frame of looking for what moves.
    """

    kind: str
    shares: list[float] = field(default_factory=list)
    soon: list[bool] = field(default_factory=list)
    false_starts: int = 0
    frame_ms: float = 0.0


def pans(rng: np.random.Generator) -> Camera:
    """It turns to the side, a little up or down, a little unsteadily."""
    speed = math.exp(rng.uniform(math.log(30), math.log(300))) * rng.choice([-1.0, 1.0])
    tilt, rate_hz, phase = rng.uniform(-0.3, 0.3), rng.uniform(0.5, 1.5), rng.uniform(0, 2 * np.pi)

    def camera(t: Values) -> tuple[Values, ...]:
        along = speed * (t - DURATION_S / 2) + 0.02 * speed * np.sin(2 * np.pi * rate_hz * t + phase)
        return along, tilt * along, np.ones_like(t), np.zeros_like(t)

    return camera


def shaken(rng: np.random.Generator) -> Camera:
    """A hand holds it."""
    way = shakes(rng, math.exp(rng.uniform(math.log(40), math.log(200))) / (2 * np.pi * SHAKE_HZ_MEAN))
    return lambda t: (*way(t), np.ones_like(t), np.zeros_like(t))


def drives(rng: np.random.Generator) -> Camera:
    """It comes nearer, and turns a little."""
    rate, pan, roll = rng.uniform(0.15, 0.6), rng.uniform(-60, 60), rng.uniform(-0.15, 0.15)
    return lambda t: (pan * (t - DURATION_S / 2), 0 * t, np.exp(rate * (t - DURATION_S / 2)), roll * t)


def things(rng: np.random.Generator) -> tuple[Sprite, ...]:
    """One to three, in the picture halfway, each with a speed of its own."""
    return tuple(_thing(rng, f"thing_{number}") for number in range(int(rng.integers(1, 4))))


def things_past_something_near(rng: np.random.Generator) -> tuple[Sprite, ...]:
    """Things before or behind two panels that stand nearer than the background."""
    nearness = rng.uniform(1.3, 1.8)
    panels = []
    for number, x in enumerate((0.25, 0.8)):
        height, width = int(rng.integers(60, 130)), int(rng.integers(40, 90))
        texture, y = BACKGROUNDS["clutter"](rng, height, width), rng.uniform(0.3, 0.7)
        place = Path.of(lambda t, x=x, y=y: (x * WIDTH + 0 * t, y * HEIGHT + 0 * t), DURATION_S)
        panels.append(
            Sprite(f"panel_{number}", texture, np.ones_like(texture), place, is_target=False, nearness=nearness)
        )
    return (*panels, *things(rng))


def nothing(rng: np.random.Generator) -> tuple[Sprite, ...]:
    """Three things that stand in the world: they are no targets."""
    return tuple(_thing(rng, f"rests_{number}", speed=0.0, is_target=False) for number in range(3))


def walkers(rng: np.random.Generator) -> tuple[Sprite, ...]:
    """One or two who walk."""
    return tuple(
        sprite for number in range(int(rng.integers(1, 3))) for sprite in _walker(rng, f"walker_{number}", number)
    )


KINDS: dict[str, tuple[Callable[..., Camera], Callable[..., tuple[Sprite, ...]]]] = {
    "pans": (pans, things),
    "slides past something near": (pans, things_past_something_near),
    "shakes": (shaken, things),
    "drives forward": (drives, things),
    "pans, people walk": (pans, walkers),
    "pans, nothing moves": (pans, nothing),
    "drives forward, nothing moves": (drives, nothing),
}


def _background(rng: np.random.Generator, camera: Camera) -> Texture:
    x, y, *_ = camera(np.linspace(0, DURATION_S, 200))
    width, height = WIDTH + 2 * math.ceil(np.abs(x).max()), HEIGHT + 2 * math.ceil(np.abs(y).max())
    return BACKGROUNDS[rng.choice(["cloudy", "clutter", "tiles", "photo", "photo"])](rng, height, width)


def _thing(rng: np.random.Generator, name: str, speed: float | None = None, *, is_target: bool = True) -> Sprite:
    texture, opacity = THINGS[rng.choice(["car", "ball", "dartboard", "irregular"])](rng, int(rng.integers(20, 91)))
    speed = math.exp(rng.uniform(math.log(30), math.log(300))) if speed is None else speed
    angle = rng.choice([0, np.pi]) + rng.normal(0, 0.5)
    x, y = rng.uniform(0.2, 0.8) * WIDTH, rng.uniform(0.25, 0.75) * HEIGHT
    way = Path.of(
        lambda t: (
            x + speed * math.cos(angle) * (t - DURATION_S / 2),
            y + speed * math.sin(angle) * (t - DURATION_S / 2),
        ),
        DURATION_S,
    )
    return Sprite(name, texture, opacity, way, is_target=is_target)


def _walker(rng: np.random.Generator, name: str, number: int) -> tuple[Sprite, ...]:
    height_px = rng.uniform(60, 150)
    pace_px_s = height_px * rng.uniform(0.45, 0.95) * rng.choice([-1.0, 1.0])
    middle_px = WIDTH * rng.uniform(0.2 + 0.3 * number, 0.5 + 0.3 * number)
    return person(
        rng,
        name,
        height_px,
        lambda t: middle_px + pace_px_s * (t - DURATION_S / 2),
        HEIGHT * rng.uniform(0.75, 0.95),
        DURATION_S,
    )


def found_in(trip: Trip) -> Found:
    """What comes of the things of a scene."""
    scene = trip.scene()
    found = Found(trip.kind)
    overlaps: dict[str, list[float]] = {name: [] for name in names_of_all(scene)}
    known: set[str] = set()
    warm_up(["discovery"])
    timed, times_s = Starter(WIDTH, HEIGHT, DiscoveryConfig(), auto=True), []
    next_s, guard = 0.0, StreamGuard()
    streams = (batch for part in trip.events(scene, start_ns=START_NS) for batch in guard.feed(part))
    for step in track(streams, [], auto=True, threads=False):
        start_s = time.process_time()
        timed.take(step.frame.stamp_ns, step.frame.data, step.reports)
        times_s.append(time.process_time() - start_s)
        time_s = (step.frame.stamp_ns - START_NS) * 1e-9
        boxes = {report.name: report.box for report in step.reports if report.box is not None}
        truth = {name: box_of_all(scene, name, time_s) for name in overlaps}
        for name in boxes.keys() - known:
            found.false_starts += not any(shared(boxes[name], box) > SUCCESS_IOU for box in truth.values())
        known |= boxes.keys()
        if time_s < next_s:
            continue
        next_s = time_s + STEP_S
        for name, box in truth.items():
            seen = on_sensor(box, scene)
            if seen.w * seen.h >= box.w * box.h / 2:
                overlaps[name].append(max((_iou(other, seen, scene) for other in boxes.values()), default=0.0))
    for values in overlaps.values():
        right = np.array(values) >= SUCCESS_IOU
        found.shares.append(float(right.mean()))
        found.soon.append(bool(right[: round(SOON_S / STEP_S)].any()))
    found.frame_ms = 1e3 * float(np.mean(times_s))
    return found


def _iou(box: Box, seen: Box, scene: Scene) -> float:
    return on_sensor(box, scene).iou(seen)


def main() -> None:
    """Print a line for each kind."""
    trips = [Trip(seed, kind) for kind in KINDS for seed in seeds_asked_for(0, 4)]
    results = list(of_each(found_in, trips, jobs=1))
    for kind in KINDS:
        of_kind = [found for found in results if found.kind == kind]
        shares = np.array([share for found in of_kind for share in found.shares])
        soon = [is_soon for found in of_kind for is_soon in found.soon]
        false_rate = sum(found.false_starts for found in of_kind) / (len(of_kind) * DURATION_S)
        frame_ms = np.mean([found.frame_ms for found in of_kind])
        told = f"{shares.mean():.2f} {(shares >= 0.5).mean():.2f} {np.mean(soon):.2f}" if len(shares) else " " * 14
        sys.stdout.write(f"{kind:32s} {told}  {false_rate:.2f}/s  {frame_ms:.2f} ms\n")


if __name__ == "__main__":
    main()
