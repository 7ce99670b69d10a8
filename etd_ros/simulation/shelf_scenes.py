"""Random scenes of a camera that slides past things at different depths, none of which changes its size: they have few
edges, many of them slanted, so that a look can hardly tell moving along them from growing."""

from __future__ import annotations

import math

import cv2
import numpy as np

from etd_ros.simulation import things
from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.motion import FloatArray, Path
from etd_ros.simulation.motions import Track
from etd_ros.simulation.scene import Scene, Sprite
from etd_ros.simulation.sensor import SensorConfig
from etd_ros.simulation.solids import SOLIDS
from etd_ros.simulation.textures import BRIGHT, DARK, smooth_noise

KINDS = (*SOLIDS, things.ball, things.plain, things.panel, things.dartboard, things.irregular)
WIDTH, HEIGHT, DURATION_S = 240, 180, 2.0
THINGS_COUNT = 3, 7
SIDE_PX = 22, 95
NEARNESS = 1.1, 4.5
SPEED_PX_S = 20, 70
"""Of the background; things before it are up to `NEARNESS` times as fast."""


def shelf_scene(rng: np.random.Generator) -> tuple[Scene, SensorConfig]:
    """A scene with three to six targets, the nearest in front, and the sensor that sees it; `rng` decides everything.

    Raises:
        SimulationError: scikit-image, whose photographs are some of the backgrounds, is not installed.
    """
    shift = _camera(rng)
    farthest, nearest = np.log(NEARNESS)
    nearness = np.sort(np.exp(rng.uniform(farthest, nearest, int(rng.integers(*THINGS_COUNT)))))
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
    speed_px_s = rng.uniform(*SPEED_PX_S) * rng.choice([-1, 1])
    angle = 0.0 if rng.uniform() < 0.6 else rng.uniform(0, 2 * np.pi)
    swing, rate = rng.uniform(-0.3, 0.3), 2 * np.pi * rng.uniform(0.2, 0.7)

    def shift(times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        way = speed_px_s * (times_s + swing / rate * (1 - np.cos(rate * times_s)))
        return way * np.cos(angle), way * np.sin(angle)

    return shift


def _background(rng: np.random.Generator, way_x: float, way_y: float) -> FloatArray:
    """Boards and posts in two of five scenes, for a camera that moves so far (pixels) from start to end."""
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
    return np.asarray(np.clip(cv2.GaussianBlur(picture, (0, 0), 0.7), DARK, BRIGHT), np.float64)


def _sprite(rng: np.random.Generator, number: int, nearness: float, shift: Track) -> Sprite:
    """A thing that stands where it is seen on the sensor at some time of the scene."""
    kind = KINDS[int(rng.integers(len(KINDS)))]
    texture, opacity = kind(rng, round(float(np.exp(rng.uniform(*np.log(SIDE_PX))))))
    seen_x, seen_y = (float(way[0]) for way in shift(np.array([rng.uniform(0, 0.8 * DURATION_S)])))
    x = rng.uniform(0.2, 0.8) * WIDTH + nearness * seen_x
    y = rng.uniform(0.25, 0.8) * HEIGHT + nearness * seen_y
    path = Path.of(lambda times_s: (np.full_like(times_s, x), np.full_like(times_s, y)), DURATION_S)
    return Sprite(f"{kind.__name__}_{number}", texture, opacity, path, nearness=nearness)
