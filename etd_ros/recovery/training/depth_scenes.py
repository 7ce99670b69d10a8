"""Random scenes of a camera that passes things at several depths, one before the other: nothing stands out from a
ground, and whatever is lost has neighbours that move nearly alike."""

from __future__ import annotations

import math

import cv2
import numpy as np

from etd_ros.simulation import Path, Scene, Sprite
from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.motion import FloatArray
from etd_ros.simulation.motions import Area, Track, rests, shakes, slides, wanders
from etd_ros.simulation.solids import SOLIDS
from etd_ros.simulation.textures import BRIGHT, DARK, Texture, smooth_noise
from etd_ros.simulation.things import KINDS, Thing

THINGS = (*SOLIDS, *SOLIDS, *(KINDS[name] for name in ("ball", "ball", "dartboard", "irregular", "plain", "panel")))
PICTURE_SHARE = 0.3
"""Of things that wear a photograph: the rest has surfaces of its own."""
THINGS_COUNT = 3, 9
SIDE_PX = 16.0, 110.0
NEARNESS = 0.9, 4.5
SPEED_PX_S = 8.0, 120.0
"""Of the background; things before it are up to `NEARNESS` times as fast."""
MOVING_SHARE = 0.2
"""Of things that also move by themselves, by up to so much:"""
OWN_SPEED_PX_S = 120.0
ROUGH_SHARE = 0.4
"""Of surfaces with a grain, as of leather, felt or plaster: pixels of an event sensor see it as speckles."""
POLE_SHARE = 0.4
"""Of scenes with a pole or a leg in front of everything."""


def depth_scene(rng: np.random.Generator, width: int, height: int, duration_s: float) -> Scene:
    """A scene before a sensor of width x height pixels; `rng` decides everything.

    Raises:
        SimulationError: scikit-image, whose photographs are used, is not installed.
    """
    times = np.linspace(0, duration_s, 50)
    camera = _camera(rng, width, height, duration_s)
    way_x, way_y = camera(times)
    room = 2 * math.ceil(float(np.abs(way_x).max())) + 8, 2 * math.ceil(float(np.abs(way_y).max())) + 8
    background = _background(rng, height + room[1], width + room[0])
    depths = rng.uniform(math.log(NEARNESS[0]), math.log(NEARNESS[1]), int(rng.integers(*THINGS_COUNT)))
    nearness = np.sort(np.exp(depths)).tolist()
    sprites = [
        _standing(rng, f"thing_{number}", _thing(rng), near, camera, (width, height), duration_s)
        for number, near in enumerate(nearness)
    ]
    if rng.random() < POLE_SHARE:
        in_front = nearness[-1] * rng.uniform(1.0, 1.6)
        pole = _pole(rng, height)
        sprites.append(_standing(rng, "pole", pole, in_front, camera, (width, height), duration_s, is_target=False))
    zoom = float(rng.uniform(-0.25, 0.25)) if rng.random() < 0.3 else 0.0

    def view(times: FloatArray) -> tuple[FloatArray, ...]:
        return (*camera(times), np.exp(zoom * times / duration_s))

    return Scene(width, height, duration_s, background, tuple(sprites), view=Path.of(view, duration_s))


def _camera(rng: np.random.Generator, width: int, height: int, duration_s: float) -> Track:
    """How the background moves: mostly to the side, as before a robot or a slider."""
    speed_px_s = float(np.exp(rng.uniform(*np.log(SPEED_PX_S))))
    kind = rng.random()
    if kind < 0.6:
        return slides(rng, speed_px_s, duration_s)
    if kind < 0.8:
        return shakes(rng, speed_px_s / 20)
    return wanders(rng, Area(-width / 6, -height / 6, width / 6, height / 6), speed_px_s)


def _background(rng: np.random.Generator, height: int, width: int) -> Texture:
    """A wall with boards and posts half of the time."""
    if rng.random() < 0.5:
        return BACKGROUNDS[str(rng.choice(["photo", "photo", "clutter", "wall", "cloudy"]))](rng, height, width)
    picture = rng.uniform(0.3, 0.8) * (1 + 0.15 * (smooth_noise(rng, height, width) - 0.5))
    for _ in range(int(rng.integers(2, 12))):
        x, y = int(rng.uniform(0, width)), int(rng.uniform(0, height))
        across, down = rng.uniform(20, 200), rng.uniform(3, 80)
        if rng.random() < 0.5:
            across, down = rng.uniform(2, 12), height
        cv2.rectangle(picture, (x, y), (int(x + across), int(y + down)), float(rng.uniform(DARK, 0.9)), cv2.FILLED)
    return np.asarray(np.clip(cv2.GaussianBlur(picture, (0, 0), 0.7), DARK, BRIGHT), np.float64)


def _thing(rng: np.random.Generator) -> Thing:
    size = round(float(np.exp(rng.uniform(*np.log(SIDE_PX)))))
    kind = KINDS["picture"] if rng.random() < PICTURE_SHARE else THINGS[int(rng.integers(len(THINGS)))]
    texture, opacity = kind(rng, size)
    contrast = rng.uniform(0.5, 1.0)
    middle = float(np.exp(np.log(texture).mean()))
    texture = middle * (texture / middle) ** contrast
    if rng.random() < ROUGH_SHARE:
        grain = smooth_noise(rng, *texture.shape, grain=float(rng.uniform(0.7, 2.0))) - 0.5
        texture = texture * (1 + rng.uniform(0.1, 0.8) * grain)
    return np.clip(texture, DARK / 2, BRIGHT), opacity


def _pole(rng: np.random.Generator, height: int) -> Thing:
    """Higher than the sensor, upright or slanted."""
    thick, slant = int(rng.integers(3, 22)), float(rng.uniform(-60, 60)) * (rng.random() < 0.5)
    tall, wide = height + 40, thick + 2 + int(abs(slant))
    opacity = np.zeros((tall, wide))
    x = (wide - thick) / 2
    corners = [(x - slant / 2, 0), (x - slant / 2 + thick, 0), (x + slant / 2 + thick, tall), (x + slant / 2, tall)]
    cv2.fillPoly(opacity, [np.rint(corners).astype(np.int32)], 1.0, cv2.LINE_AA)
    texture = rng.uniform(DARK, 0.9) * (1 + rng.uniform(0, 0.6) * (smooth_noise(rng, tall, wide, grain=2.0) - 0.5))
    return np.clip(texture, DARK / 2, BRIGHT), np.asarray(opacity, np.float64)


def _standing(
    rng: np.random.Generator,
    name: str,
    thing: Thing,
    nearness: float,
    camera: Track,
    size: tuple[int, int],
    duration_s: float,
    *,
    is_target: bool = True,
) -> Sprite:
    """A thing somewhere on the sensor at some time of the scene, standing there or moving by itself."""
    when = np.array([rng.uniform(0.1, 0.9) * duration_s])
    seen_x, seen_y = (float(way[0]) for way in camera(when))
    x = rng.uniform(0.1, 0.9) * size[0] + nearness * seen_x
    y = size[1] / 2 if not is_target else rng.uniform(0.15, 0.9) * size[1] + nearness * seen_y
    track = rests(x, y)
    if is_target and rng.random() < MOVING_SHARE:
        reach = rng.uniform(5, 60)
        track = wanders(rng, Area(x - reach, y - reach, x + reach, y + reach), rng.uniform(10, OWN_SPEED_PX_S))
    return Sprite(name, *thing, Path.of(track, duration_s), is_target=is_target, nearness=nearness)
