"""Scenes of the kind of the Extreme Event Dataset (Mitrokhin 2018): what `etd-plus` makes of them.

    python docs/extreme_measures.py [FIRST LAST]     # seeds, 0 and 120 if none are given; two minutes on two cores

By turns, before a hand-held camera of 240x180 pixels: a ball thrown behind a dense net (`net`), a ball thrown past
something that hides it for a moment, in the dark (`hidden`), a small drone in the dark (`drone`), and the same while
light flashes (`flash`). Labels: 200 a second, while .45 of the thing can be seen. Some backgrounds are photographs
(extra `simulate`).
"""

from __future__ import annotations

import sys
from collections import defaultdict
from typing import Any

import numpy as np
from seeded_scenes import SeededScene, seeds_asked_for, tracked

from etd_ros.evaluation.scoring import SUCCESS_IOU, label_overlaps
from etd_ros.evaluation.suite import START_NS, of_each
from etd_ros.evaluation.truth import TimedBox
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite, things
from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.motion import Flicker, FloatArray
from etd_ros.simulation.things import Thing
from etd_ros.simulation.truth import visible_shares
from etd_ros.targets import TargetStart

STREAM = 123
"""Beside the seed: no other list of scenes has these."""
KINDS = ("net", "hidden", "drone", "flash")
WIDTH, HEIGHT, ROOM_PX = 240, 180, 40
LABEL_S, STARTS_AT = 0.005, 2
ON_SENSOR_MIN, VISIBLE_MIN = 0.95, 0.45
BEFORE_S = 0.05


class Flash(Flicker):
    """Light that flashes: up within 2 ms, and down again more slowly; `rate_hz` is how finely that is rendered."""

    def at(self, times_s: FloatArray) -> FloatArray:
        phase_s = times_s % 0.21 - 0.1
        return 1 + self.depth * np.where(phase_s < 0, np.exp(phase_s / 0.001), np.exp(-phase_s / 0.006))


class Extreme(SeededScene):
    """A thing in one of the scenes."""

    @property
    def kind(self) -> str:
        return KINDS[self.seed % len(KINDS)]

    def make(self) -> tuple[Scene, SensorConfig]:
        rng = np.random.default_rng([STREAM, self.seed])
        is_drone = self.kind in ("drone", "flash")
        smallest, largest = (14, 32) if is_drone else (18, 45)
        size_px = float(np.exp(rng.uniform(np.log(smallest), np.log(largest))))
        path, duration_s = _wandering(rng) if is_drone else _thrown(rng)
        thing = things.irregular if is_drone else things.ball
        sprites = [Sprite("target", *thing(rng, round(size_px)), path)]
        if self.kind == "net":
            sprites.append(_before_it(rng, "net", _net(rng), duration_s))
        if self.kind == "hidden":
            sprites.append(_before_it(rng, "panel", _panel(rng, size_px), duration_s))
        background = BACKGROUNDS[str(rng.choice(["wall", "cloudy", "clutter", "photo"]))](
            rng, HEIGHT + 2 * ROOM_PX, WIDTH + 2 * ROOM_PX
        )
        is_dark = self.kind != "net"
        sensor = SensorConfig(
            contrast_threshold=float(rng.uniform(0.15, 0.3)),
            threshold_spread=0.03,
            noise_rate_hz=float(np.exp(rng.uniform(np.log(2000), np.log(30_000 if is_dark else 8000)))),
            step_s=0.005,
            step_px=0.6,
        )
        scene = Scene(
            WIDTH, HEIGHT, duration_s, background, tuple(sprites), view=_hand(rng, duration_s),
            flicker=Flash(60.0, float(rng.uniform(0.2, 0.9))) if self.kind == "flash" else None,
            dark=float(rng.uniform(0.02, 0.15)) if is_dark else 0.0,
        )  # fmt: skip
        return scene, sensor


def _thrown(rng: np.random.Generator) -> tuple[Path, float]:
    speed_px_s = float(np.exp(rng.uniform(np.log(0.8 * WIDTH), np.log(3 * WIDTH))))
    side = rng.choice([-1, 1])
    flight_s = 0.95 * WIDTH / speed_px_s
    y, fall_px = rng.uniform(0.2, 0.5) * HEIGHT, rng.uniform(0.1, 0.6) * HEIGHT
    growth, spin_rad_s = rng.uniform(-0.4, 0.4), rng.uniform(-6, 6)

    def pose(times_s: FloatArray) -> tuple[FloatArray, ...]:
        part = np.clip((times_s - BEFORE_S) / flight_s, -0.2, 1.3)
        x = WIDTH * (0.5 + side * 0.95 * (part - 0.5))
        return x, y + fall_px * (part - 0.4) ** 2 * 1.5, np.exp(growth * (part - 0.5)), spin_rad_s * times_s

    duration_s = flight_s + 3 * BEFORE_S
    return Path.of(pose, duration_s), duration_s


def _wandering(rng: np.random.Generator) -> tuple[Path, float]:
    duration_s = 1.5
    reach_x, reach_y = rng.uniform(0.1, 0.35) * WIDTH, rng.uniform(0.05, 0.25) * HEIGHT
    rate_x, rate_y = 2 * np.pi * rng.uniform(0.3, 0.9, 2)
    phase_x, phase_y = rng.uniform(0, 2 * np.pi, 2)
    growth = rng.uniform(-0.4, 0.4)

    def pose(times_s: FloatArray) -> tuple[FloatArray, ...]:
        x = WIDTH / 2 + reach_x * np.sin(rate_x * times_s + phase_x)
        y = HEIGHT / 2 + reach_y * np.sin(rate_y * times_s + phase_y)
        return x, y, np.exp(growth * (times_s / duration_s - 0.5)), 0.15 * np.sin(5 * times_s + phase_x)

    return Path.of(pose, duration_s), duration_s


def _hand(rng: np.random.Generator, duration_s: float) -> Path:
    """A camera in a hand: it turns slowly and trembles."""
    speed_px_s, angle, tremble_px = rng.uniform(0, 60), rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 3)

    def view(times_s: FloatArray) -> tuple[FloatArray, ...]:
        way_px = np.minimum(speed_px_s * times_s, ROOM_PX - 6)
        x = way_px * np.cos(angle) + tremble_px * np.sin(2 * np.pi * 3.1 * times_s + angle)
        return x, way_px * np.sin(angle) + tremble_px * np.sin(2 * np.pi * 4.3 * times_s)

    return Path.of(view, duration_s)


def _before_it(rng: np.random.Generator, name: str, thing: Thing, duration_s: float) -> Sprite:
    x = WIDTH / 2 if name == "net" else rng.uniform(0.4, 0.65) * WIDTH

    def stays(times_s: FloatArray) -> tuple[FloatArray, ...]:
        return np.full_like(times_s, x), np.full_like(times_s, HEIGHT / 2)

    return Sprite(name, *thing, Path.of(stays, duration_s), is_target=False, nearness=float(rng.uniform(1, 2)))


def _net(rng: np.random.Generator) -> Thing:
    """Strings that cross, at some angle."""
    side = 2 * WIDTH
    pitch, thick, angle = rng.uniform(12, 26), rng.uniform(1, 2.5), rng.uniform(0, np.pi)
    y, x = np.mgrid[:side, :side].astype(np.float64)
    across, down = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    far = np.minimum(np.abs(across % pitch - pitch / 2), np.abs(down % pitch - pitch / 2))
    opacity = np.clip((thick - far * 2) / 2 + 0.5, 0, 1)
    return np.full_like(opacity, float(rng.choice([0.1, 0.9]))), opacity


def _panel(rng: np.random.Generator, size_px: float) -> Thing:
    shape = round(HEIGHT * 1.6), round(size_px * rng.uniform(0.8, 1.6))
    return np.full(shape, float(rng.uniform(0.1, 0.9))), np.ones(shape)


def overlaps_of(extreme: Extreme) -> tuple[str, list[float]]:
    """The kind of scene, and the IoU with the truth at each label."""
    scene = extreme.scene()
    times_s = np.arange(0.02, scene.duration_s, LABEL_S)
    shares = visible_shares(scene, "target", times_s)
    is_labelled = (shares.on_sensor > ON_SENSOR_MIN) & (shares.visible > VISIBLE_MIN)
    truth = [
        TimedBox(START_NS + round(time_s * 1e9), scene.box("target", time_s))
        for time_s in times_s[is_labelled].tolist()
    ][STARTS_AT:]
    start = TargetStart("target", truth[0].box, truth[0].stamp_ns)
    return extreme.kind, label_overlaps(tracked(extreme, start), truth[1:])


def main() -> None:
    """Print the mean AP and AR of each kind of scene and of all."""
    kinds: Any = defaultdict(list)
    for kind, overlaps in of_each(overlaps_of, map(Extreme, seeds_asked_for(0, 120)), jobs=2):
        for group in (kind, "all"):
            kinds[group].append((np.mean(overlaps), np.mean(np.array(overlaps) >= SUCCESS_IOU)))
    for kind in (*KINDS, "all"):
        ap, ar = np.array(kinds[kind]).T
        below = np.count_nonzero(ap < SUCCESS_IOU)
        sys.stdout.write(f"{kind:<8}{len(ap):>4}{ap.mean():>7.3f}/{ar.mean():.3f}{below:>4} below {SUCCESS_IOU}\n")


if __name__ == "__main__":
    main()
