"""Random scenes of the kinds of the Extreme Event Dataset (Mitrokhin 2018), before a hand-held camera."""

from __future__ import annotations

import numpy as np

from etd_ros.simulation import things
from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.motion import Flicker, FloatArray, Path, SimulationError
from etd_ros.simulation.scene import Scene, Sprite
from etd_ros.simulation.sensor import SensorConfig
from etd_ros.simulation.things import Thing

KINDS = ("net", "hidden", "drone", "flash")
WIDTH, HEIGHT, ROOM_PX = 240, 180, 40
"""Of the sensor, and what the background has beyond it on each side, for the camera's motion."""
TARGET = "target"
BALL_PX, DRONE_PX = (18, 45), (14, 32)
"""The target's larger side in the middle of the scene."""
BEFORE_S = 0.05
"""A scene stands for so long before a flight, and twice as long after it."""
WANDERS_S = 1.5
"""How long scenes last in which nothing is thrown."""


class Flash(Flicker):
    """Light that flashes: up within 2 ms, and down again more slowly; `rate_hz` is how finely that is rendered."""

    def at(self, times_s: FloatArray) -> FloatArray:
        phase_s = times_s % 0.21 - 0.1
        return 1 + self.depth * np.where(phase_s < 0, np.exp(phase_s / 0.001), np.exp(-phase_s / 0.006))


def extreme_scene(rng: np.random.Generator, kind: str) -> tuple[Scene, SensorConfig]:
    """A scene with one target, `TARGET`, and the sensor that sees it; `rng` decides all but the kind.

    Args:
        rng: where all that is random comes from.
        kind: a ball thrown behind a dense net (`net`), a ball thrown past something that hides it for a moment, in the
            dark (`hidden`), a small drone in the dark (`drone`), or that while light flashes (`flash`).

    Raises:
        SimulationError: there is no such kind, or scikit-image, whose photographs are some of the backgrounds, is not
            installed.
    """
    if kind not in KINDS:
        msg = f"no kind {kind!r} of extreme scene: there are {', '.join(KINDS)}"
        raise SimulationError(msg)
    is_drone, is_dark = kind in ("drone", "flash"), kind != "net"
    size_px = float(np.exp(rng.uniform(*np.log(DRONE_PX if is_drone else BALL_PX))))
    path, duration_s = _wandering(rng) if is_drone else _thrown(rng)
    thing = things.irregular if is_drone else things.ball
    sprites = [Sprite(TARGET, *thing(rng, round(size_px)), path)]
    if kind == "net":
        sprites.append(_before_it(rng, "net", _net(rng), duration_s))
    if kind == "hidden":
        sprites.append(_before_it(rng, "panel", _panel(rng, size_px), duration_s))
    background = BACKGROUNDS[str(rng.choice(["wall", "cloudy", "clutter", "photo"]))](
        rng, HEIGHT + 2 * ROOM_PX, WIDTH + 2 * ROOM_PX
    )
    sensor = SensorConfig(
        contrast_threshold=float(rng.uniform(0.15, 0.3)),
        threshold_spread=0.03,
        noise_rate_hz=float(np.exp(rng.uniform(np.log(2000), np.log(30_000 if is_dark else 8000)))),
        step_s=0.005,
        step_px=0.6,
    )
    scene = Scene(
        WIDTH, HEIGHT, duration_s, background, tuple(sprites), view=_hand(rng, duration_s),
        flicker=Flash(60.0, float(rng.uniform(0.2, 0.9))) if kind == "flash" else None,
        dark=float(rng.uniform(0.02, 0.15)) if is_dark else 0.0,
    )  # fmt: skip
    return scene, sensor


def _thrown(rng: np.random.Generator) -> tuple[Path, float]:
    """The way of a ball that crosses the sensor, and how long the scene lasts (s)."""
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
    """The way of a drone that stays before the camera, and how long the scene lasts (s)."""
    reach_x, reach_y = rng.uniform(0.1, 0.35) * WIDTH, rng.uniform(0.05, 0.25) * HEIGHT
    rate_x, rate_y = 2 * np.pi * rng.uniform(0.3, 0.9, 2)
    phase_x, phase_y = rng.uniform(0, 2 * np.pi, 2)
    growth = rng.uniform(-0.4, 0.4)

    def pose(times_s: FloatArray) -> tuple[FloatArray, ...]:
        x = WIDTH / 2 + reach_x * np.sin(rate_x * times_s + phase_x)
        y = HEIGHT / 2 + reach_y * np.sin(rate_y * times_s + phase_y)
        return x, y, np.exp(growth * (times_s / WANDERS_S - 0.5)), 0.15 * np.sin(5 * times_s + phase_x)

    return Path.of(pose, WANDERS_S), WANDERS_S


def _hand(rng: np.random.Generator, duration_s: float) -> Path:
    """A camera in a hand: it turns slowly and trembles."""
    speed_px_s, angle, tremble_px = rng.uniform(0, 60), rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 3)

    def view(times_s: FloatArray) -> tuple[FloatArray, ...]:
        way_px = np.minimum(speed_px_s * times_s, ROOM_PX - 6)
        x = way_px * np.cos(angle) + tremble_px * np.sin(2 * np.pi * 3.1 * times_s + angle)
        return x, way_px * np.sin(angle) + tremble_px * np.sin(2 * np.pi * 4.3 * times_s)

    return Path.of(view, duration_s)


def _before_it(rng: np.random.Generator, name: str, thing: Thing, duration_s: float) -> Sprite:
    """What stands in front of the target's way."""
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
    """Higher than the sensor, about as wide as the target (pixels)."""
    shape = round(HEIGHT * 1.6), round(size_px * rng.uniform(0.8, 1.6))
    return np.full(shape, float(rng.uniform(0.1, 0.9))), np.ones(shape)
