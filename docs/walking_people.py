"""People who walk, seen from the side: a torso and a head, arms and legs that swing and bend.

All lists of scenes with people in them take them from here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.simulation import Path, Scene, Sprite
from etd_ros.simulation.textures import BRIGHT, DARK, smooth_noise
from etd_ros.simulation.things import OVERSAMPLING, shrunk, surface_of

Times = npt.NDArray[np.float64]
Way = Callable[[Times], Times]
"""Where somebody's middle is (pixels from the left) at times (s)."""
Pose = tuple[Times, Times, Times]
"""x, y (pixels) and angle (rad) of a part's middle at times."""

TORSO, HEAD, NECK = (0.2, 0.36), (0.11, 0.15), (0.055, 0.06)
UPPER_ARM, FOREARM, HAND = (0.07, 0.19), (0.055, 0.17), (0.05, 0.05)
THIGH, SHIN, FOOT = (0.1, 0.26), (0.075, 0.26), (0.13, 0.045)
"""Width and length of each, in parts of somebody's height."""
SHOULDER, HIP = 0.19, 0.49
"""How far below the top of the head they are, in parts of somebody's height."""
LEG, OVERLAP = 0.5, 0.95
"""Length of a leg, in parts of somebody's height; how far along a limb the next one hangs, in parts of its length."""
USUAL_PACE, USUAL_STEPS_HZ = 0.8, 1.9
"""Heights a second, and steps a second at that. Who walks faster takes longer steps, and more of them."""
BOB, SWAY_RAD = 0.012, 0.03
"""How far a body goes up and down, in parts of its height, and how far it leans to and fro."""
ELBOW_RAD, KNEE_RAD = 0.35, 0.6
"""By how much an arm is bent, and a leg that comes forward."""
SHARP = 2
"""Parts are drawn so many times as large as they are."""
PLAIN_SHARE = 0.6
"""Of clothes: they have folds, and no pattern."""
SAMPLE_S = 0.02
"""Between times at which a body's mean box is taken."""


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
    start_px, end_px = way(np.array([0.0, duration_s])).tolist()
    forward = math.copysign(1.0, end_px - start_px)
    pace = max(abs(end_px - start_px) / duration_s / height_px, 0.1)
    steps_hz = USUAL_STEPS_HZ * math.sqrt(pace / USUAL_PACE)
    # A foot that stands does not slide: a step is as long as the legs are apart.
    swing_rad = math.asin(min(pace / steps_hz / (2 * LEG), 0.7)) * rng.uniform(0.9, 1.1)
    arm_swing_rad = swing_rad * rng.uniform(0.6, 1.2)
    phase = rng.uniform(0, 2 * math.pi)
    shirt, trousers = _cloth(rng, height_px), _cloth(rng, height_px)
    skin, shoes = _plain(rng, rng.uniform(0.4, 0.9)), _plain(rng, rng.uniform(0.17, 0.8))

    def turn(t: Times) -> Times:
        return math.pi * steps_hz * t + phase

    def lean(t: Times) -> Times:
        return forward * 0.04 + SWAY_RAD * np.sin(2 * turn(t))

    def hip(t: Times) -> Pose:
        bob_px = BOB * height_px * np.cos(2 * turn(t))
        return way(t), foot_px + bob_px - (1 - HIP) * height_px, lean(t)

    def along(joint: Callable[[Times], Pose], down: float) -> Callable[[Times], Pose]:
        """What lies so far (heights) down a part from a joint, turned as that part is."""

        def place(t: Times) -> Pose:
            x, y, angle = joint(t)
            return x - down * height_px * np.sin(angle), y + down * height_px * np.cos(angle), angle

        return place

    def bent(joint: Callable[[Times], Pose], angle: Way) -> Callable[[Times], Pose]:
        """The same place, turned by that (rad) instead."""
        return lambda t: (*joint(t)[:2], angle(t))

    def part(what: str, size: tuple[float, float], cloth: Cloth, middle: Callable[[Times], Pose]) -> Sprite:
        columns, rows = (max(3, round(SHARP * side * height_px)) for side in size)
        path = Path.of(_posed(middle), duration_s)
        return Sprite(f"{name} {what}", cloth(rows, columns), _rounded(rows, columns), path)

    def hung(what: str, size: tuple[float, float], cloth: Cloth, joint: Callable[[Times], Pose]) -> Sprite:
        return part(what, size, cloth, along(joint, size[1] / 2))

    def leg(side: float) -> tuple[Sprite, ...]:
        which = "far" if side < 0 else "near"

        def thigh(t: Times) -> Times:
            return side * swing_rad * np.sin(turn(t))

        def shin(t: Times) -> Times:
            return thigh(t) + forward * KNEE_RAD * np.clip(-side * forward * np.cos(turn(t)), 0, None)

        at_hip = bent(hip, thigh)
        knee = bent(along(at_hip, OVERLAP * THIGH[1]), shin)
        sole = along(knee, SHIN[1] - FOOT[1] / 2)

        def foot(t: Times) -> Pose:
            x, y, angle = sole(t)
            return x + forward * 0.03 * height_px, y, 0.5 * angle

        return (
            part(f"{which} foot", FOOT, shoes, foot),
            hung(f"{which} shin", SHIN, trousers, knee),
            hung(f"{which} thigh", THIGH, trousers, at_hip),
        )

    def arm(side: float) -> tuple[Sprite, ...]:
        which = "far" if side < 0 else "near"

        def upper(t: Times) -> Times:
            return -side * arm_swing_rad * np.sin(turn(t))

        at_shoulder = bent(along(hip, SHOULDER - HIP), upper)
        elbow = bent(along(at_shoulder, OVERLAP * UPPER_ARM[1]), lambda t: upper(t) - forward * ELBOW_RAD)
        wrist = along(elbow, OVERLAP * FOREARM[1])
        return (
            hung(f"{which} hand", HAND, skin, wrist),
            hung(f"{which} forearm", FOREARM, shirt, elbow),
            hung(f"{which} arm", UPPER_ARM, shirt, at_shoulder),
        )

    top = -HIP
    torso = part("torso", TORSO, shirt, along(hip, top + HEAD[1] + TORSO[1] / 2 - 0.01))
    neck = part("neck", NECK, skin, along(hip, top + HEAD[1]))
    head = part("head", HEAD, _hair_over(skin, _plain(rng, rng.uniform(0.15, 0.6))), along(hip, top + HEAD[1] / 2))
    return (*arm(-1), *leg(-1), *leg(1), neck, torso, head, *arm(1))


Cloth = Callable[[int, int], npt.NDArray[np.float64]]
"""Makes a texture of so many rows and columns."""


def _plain(rng: np.random.Generator, tone: float, folds: float = 0.1) -> Cloth:
    """One tone, with folds of such a contrast."""

    def cloth(rows: int, columns: int) -> npt.NDArray[np.float64]:
        shade = smooth_noise(rng, rows, columns, grain=max(1.0, columns / 6)) - 0.5
        return np.asarray(np.clip(tone * (1 + folds * shade), DARK, BRIGHT), np.float64)

    return cloth


def _cloth(rng: np.random.Generator, height_px: float) -> Cloth:
    """Plain, or cut from a pattern."""
    if rng.uniform() < PLAIN_SHARE:
        return _plain(rng, rng.choice([0.2, 0.3, 0.5, 0.7, 0.95]), rng.uniform(0.05, 0.3))
    side = round(SHARP * height_px * TORSO[1])
    pattern = surface_of(rng, side, side)

    def cloth(rows: int, columns: int) -> npt.NDArray[np.float64]:
        down, right = (int(rng.integers(max(1, side - extent + 1))) for extent in (rows, columns))
        return np.asarray(np.resize(pattern[down:, right : right + columns], (rows, columns)), np.float64)

    return cloth


def _hair_over(skin: Cloth, hair: Cloth) -> Cloth:
    def cloth(rows: int, columns: int) -> npt.NDArray[np.float64]:
        above = np.arange(rows)[:, None] < 0.35 * rows
        return np.where(above, hair(rows, columns), skin(rows, columns))

    return cloth


def _rounded(rows: int, columns: int) -> npt.NDArray[np.float64]:
    """The opacity of a part: its shorter sides are round, its edges smooth."""
    high, wide = rows * OVERSAMPLING, columns * OVERSAMPLING
    inside: npt.NDArray[np.float64] = np.zeros((high, wide))
    radius = min(high, wide) // 2
    if high >= wide:
        ends = (wide // 2, radius), (wide // 2, high - 1 - radius)
    else:
        ends = (radius, high // 2), (wide - 1 - radius, high // 2)
    cv2.line(inside, *ends, 1.0, thickness=2 * radius)
    return shrunk(inside)


def _posed(middle: Callable[[Times], Pose]) -> Callable[[Times], tuple[Times, Times, float, Times]]:
    def pose(t: Times) -> tuple[Times, Times, float, Times]:
        x, y, angle = middle(t)
        return x, y, 1 / SHARP, angle

    return pose


def nearing(part: Sprite, body: Sequence[Sprite], per_s: float, duration_s: float) -> Sprite:
    """A part of somebody, or of one of several, who comes nearer or goes away: as large as before half way.

    Args:
        part: one of their sprites.
        body: all of them; round the torso of theirs they grow.
        per_s: how fast (1/s, of the logarithm of their size).
        duration_s: of the scene.
    """
    (torso,) = (other for other in body if other.name == f"{part.name.split(' ')[0]} torso")

    def pose(t: Times) -> tuple[Times, Times, Times, Times]:
        size = np.exp(per_s * (t - duration_s / 2))
        (x, y, scale, angle), (middle_x, middle_y, *_) = part.path.poses(t).T, torso.path.poses(t).T
        return middle_x + size * (x - middle_x), middle_y + size * (y - middle_y), size * scale, angle

    return replace(part, path=Path.of(pose, duration_s))


def box_of_all(scene: Scene, name: str, time_s: float) -> Box:
    """The box (pixels) of a sprite, or round all sprites of somebody of this name, at a time (s)."""
    boxes = [scene.box(of, time_s) for of in scene.targets if of == name or of.startswith(f"{name} ")]
    left, top = min(box.x for box in boxes), min(box.y for box in boxes)
    right, bottom = max(box.x + box.w for box in boxes), max(box.y + box.h for box in boxes)
    return Box(left, top, right - left, bottom - top)


def boxes_of_stride(scene: Scene, name: str, times_s: Times) -> list[Box]:
    """Boxes (pixels) of somebody at times (s), whose limbs reach as far from their torso as on average: what somebody
    who draws a box for all of a walk would draw."""
    of = f"{name} torso"
    (torso,) = (sprite for sprite in scene.sprites if sprite.name == of)
    samples_s = np.arange(0, scene.duration_s, SAMPLE_S)
    sizes = SHARP * torso.path.poses(samples_s)[:, 2]
    reaches = [_reach(scene, name, of, time_s) / size for time_s, size in zip(samples_s, sizes, strict=True)]
    boxes = []
    for time_s, size in zip(times_s.tolist(), SHARP * torso.path.poses(times_s)[:, 2], strict=True):
        (x, y), (left, top, right, bottom) = scene.box(of, time_s).center, (size * np.mean(reaches, axis=0)).tolist()
        boxes.append(Box(x + left, y + top, right - left, bottom - top))
    return boxes


def _reach(scene: Scene, name: str, of: str, time_s: float) -> npt.NDArray[np.float64]:
    """How far all parts reach from the middle of one: left, top, right, bottom (pixels)."""
    box, (x, y) = box_of_all(scene, name, time_s), scene.box(of, time_s).center
    return np.array([box.x - x, box.y - y, box.x + box.w - x, box.y + box.h - y])


def names_of_all(scene: Scene) -> list[str]:
    """The names of the things of a scene, those of one person once; other things have names without blanks."""
    return list(dict.fromkeys(name.split(" ")[0] for name in scene.targets))
