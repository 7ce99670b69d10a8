"""People who walk, seen from the side: a torso and a head, arms and legs that swing and bend."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.simulation import Path, Scene, Sprite
from etd_ros.simulation.things import surface_of

Times = npt.NDArray[np.float64]
Way = Callable[[Times], Times]
"""Where somebody's middle is (pixels from the left) at times (s)."""

TORSO, HEAD, ARM, THIGH, SHIN = (0.2, 0.36), (0.12, 0.15), (0.07, 0.36), (0.09, 0.26), (0.07, 0.26)
"""Width and length of each, in parts of somebody's height."""
SHOULDER, HIP = 0.19, 0.49
"""How far below the top of the head they are, in parts of somebody's height."""


def person(
    rng: np.random.Generator, name: str, height_px: float, way: Way, foot_px: float, duration_s: float
) -> tuple[Sprite, ...]:
    """The sprites of somebody, whose names start with theirs and a blank, from the back to the front.

    Args:
        rng: chooses clothes and gait.
        name: theirs.
        height_px: how tall they are (pixels).
        way: where they go.
        foot_px: where the ground is (pixels from the top).
        duration_s: of the scene.
    """
    # 1.5 steps of .4 heights a second at .6 heights a second; who walks faster takes longer and more steps.
    pace_px_s = abs(float(way(np.array([duration_s]))[0] - way(np.zeros(1))[0])) / duration_s
    steps_hz = 1.9 * math.sqrt(max(pace_px_s / height_px, 0.1) / 0.8)
    swing_rad = rng.uniform(0.35, 0.5)
    phase = rng.uniform(0, 2 * math.pi)
    forward = 1.0 if way(np.array([duration_s]))[0] > way(np.zeros(1))[0] else -1.0

    def turn(t: Times) -> Times:
        return math.pi * steps_hz * t + phase

    def bob(t: Times) -> Times:
        return foot_px + 0.012 * height_px * np.cos(2 * turn(t))

    def part(what: str, size: tuple[float, float], middle: Callable[[Times], tuple[Times, Times, Times]]) -> Sprite:
        columns, rows = (max(2, round(side * height_px)) for side in size)
        texture = surface_of(rng, rows, columns)
        return Sprite(f"{name} {what}", texture, np.ones_like(texture), Path.of(_posed(middle), duration_s))

    def upright(down: float) -> Callable[[Times], tuple[Times, Times, Times]]:
        return lambda t: (way(t), bob(t) - (1 - down) * height_px, 0 * t)

    def hung(down: float, length: float, angle: Way) -> Callable[[Times], tuple[Times, Times, Times]]:
        def middle(t: Times) -> tuple[Times, Times, Times]:
            half_px = length / 2 * height_px
            top_px = bob(t) - (1 - down) * height_px
            return way(t) - half_px * np.sin(angle(t)), top_px + half_px * np.cos(angle(t)), angle(t)

        return middle

    def leg(side: float) -> tuple[Sprite, Sprite]:
        def thigh(t: Times) -> Times:
            return side * swing_rad * np.sin(turn(t))

        def shin(t: Times) -> Times:
            # A leg that comes forward bends.
            return thigh(t) + forward * 0.5 * np.clip(-side * forward * np.cos(turn(t)), 0, None)

        def knee(t: Times) -> tuple[Times, Times, Times]:
            thigh_px, half_px = THIGH[1] * 0.95 * height_px, SHIN[1] / 2 * height_px
            hip_px = bob(t) - (1 - HIP) * height_px
            across = way(t) - thigh_px * np.sin(thigh(t)) - half_px * np.sin(shin(t))
            return across, hip_px + thigh_px * np.cos(thigh(t)) + half_px * np.cos(shin(t)), shin(t)

        which = "far" if side < 0 else "near"
        return part(f"{which} shin", SHIN, knee), part(f"{which} thigh", THIGH, hung(HIP, THIGH[1], thigh))

    def arm(side: float) -> Sprite:
        which = "far" if side < 0 else "near"
        return part(f"{which} arm", ARM, hung(SHOULDER, ARM[1], lambda t: -side * swing_rad * np.sin(turn(t))))

    torso = part("torso", TORSO, upright(HEAD[1] + TORSO[1] / 2 - 0.01))
    head = part("head", HEAD, upright(HEAD[1] / 2))
    return (arm(-1), *leg(-1), *leg(1), torso, head, arm(1))


def _posed(
    middle: Callable[[Times], tuple[Times, Times, Times]],
) -> Callable[[Times], tuple[Times, Times, float, Times]]:
    def pose(t: Times) -> tuple[Times, Times, float, Times]:
        x, y, angle = middle(t)
        return x, y, 1.0, angle

    return pose


def box_of_all(scene: Scene, name: str, time_s: float) -> Box:
    """The box (pixels) of a sprite, or round all sprites of somebody of this name, at a time (s)."""
    boxes = [scene.box(of, time_s) for of in scene.targets if of == name or of.startswith(f"{name} ")]
    left, top = min(box.x for box in boxes), min(box.y for box in boxes)
    right, bottom = max(box.x + box.w for box in boxes), max(box.y + box.h for box in boxes)
    return Box(left, top, right - left, bottom - top)


def names_of_all(scene: Scene) -> list[str]:
    """The names of the things of a scene, those of one person once; other things have names without blanks."""
    return list(dict.fromkeys(name.split(" ")[0] for name in scene.targets))
