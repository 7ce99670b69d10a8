"""Random sequences of the fixed suite's families, for training and for choosing parameters."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from etd_ros.simulation.recipes import SENSOR, STAYS_AWAY, Recipe
from etd_ros.simulation.scene import Scene
from etd_ros.simulation.sensor import SensorConfig
from etd_ros.simulation.suite import Sequence

RANDOM_STREAM = 2
"""Beside the seed: no seed makes a scene of the fixed suite."""
NAME = re.compile(r"random-(0|[1-9][0-9]{0,17})")
KINDS = ("ball", "dartboard", "car", "irregular", "plain", "panel")
BACKGROUNDS = ("wall", "cloudy", "clutter", "tiles")
SENSOR_SIZES = ((240, 180), (346, 260))
SIZE_PX = (12.0, 200.0)
SPEED_PX_S = (10.0, 3000.0)


def random_sequence(
    seed: int, width: int = 240, height: int = 180, *, duration_s: float = 1.5, photographs: bool = False
) -> Sequence:
    """A random sequence: the same arguments give the same one.

    Args:
        seed: 0 or more; no seed gives a sequence of the fixed suite.
        width: sensor width (pixels).
        height: sensor height (pixels).
        duration_s: how long it lasts.
        photographs: whether things and backgrounds may wear those of scikit-image's wheel.

    Raises:
        SimulationError: on `scene()`, photographs are asked for and scikit-image is missing.
    """
    rng = np.random.default_rng([RANDOM_STREAM, seed, 0])
    recipe = _recipe(rng, min(width, height), duration_s, photographs)
    return Sequence(f"random-{seed}", _told(recipe), seed, width, height, recipe, stream=RANDOM_STREAM)


def random_sequences(seeds: Iterable[int]) -> list[Sequence]:
    """Random sequences on sensors of several sizes: a seed always has the same one."""
    return [random_sequence(seed, *SENSOR_SIZES[seed % len(SENSOR_SIZES)]) for seed in seeds]


def random_seed_of(name: str) -> int | None:
    """The seed that a random sequence's name holds; None where it is no such name."""
    match = NAME.fullmatch(name)
    return int(match[1]) if match else None


def random_scene(
    seed: int, width: int = 240, height: int = 180, *, duration_s: float = 1.5, photographs: bool = False
) -> Scene:
    """The scene of `random_sequence`."""
    return random_sequence(seed, width, height, duration_s=duration_s, photographs=photographs).scene()


def _recipe(rng: np.random.Generator, short: int, duration_s: float, photographs: bool) -> Recipe:
    kinds = (*KINDS, "picture", "picture") if photographs else KINDS
    backgrounds = (*BACKGROUNDS, "photo", "photo", "photo") if photographs else BACKGROUNDS
    targets = int(rng.choice([1, 1, 1, 2, 2, 3, 4, 6]))
    # Many targets share the room.
    largest = min(SIZE_PX[1], short * (0.6 if targets == 1 else 0.8 / np.sqrt(targets)))
    size = float(np.exp(rng.uniform(np.log(SIZE_PX[0]), np.log(largest))))
    # Hardly anything is as fast as the fastest: middling speeds are the rule, fast ones the exception.
    speed = float(np.clip(np.exp(rng.normal(np.log(150), 0.9)), SPEED_PX_S[0], min(SPEED_PX_S[1], 12 * short)))
    camera = str(rng.choice(["still", "still", "slide", "shake", "wander", "zoom"]))
    motion = str(rng.choice(["wander", "wander", "cross"] if camera == "still" else ["wander", "rest", "cross"]))
    event = rng.choice(["nothing", "nothing", "nothing", "occlusion", "occlusion", "leaving"])
    # What hides large things hides everything.
    can_hide = size < 0.35 * short and targets < 4
    return Recipe(
        tuple(str(kind) for kind in rng.choice(kinds, targets)),
        str(rng.choice(backgrounds)),
        targets=targets,
        size_px=(max(SIZE_PX[0], 0.75 * size), min(largest, 1.25 * size)),
        speed_px_s=(0.7 * speed, 1.4 * speed),
        motion=motion,
        scale=(float(rng.uniform(0.6, 0.95)), float(rng.uniform(1.05, 1.7))) if rng.uniform() < 0.4 else (1.0, 1.0),
        spin_deg_s=float(rng.choice([0.0, 0.0, 45.0, 120.0])),
        camera=camera,
        camera_px_s=float(np.exp(rng.uniform(np.log(20), np.log(200)))),
        occlusion_s=float(rng.uniform(0.1, 0.4)) if event == "occlusion" and can_hide else 0.0,
        leaves_s=float(rng.uniform(0.25, 0.5)) if event == "leaving" and motion != "rest" else 0.0,
        away_s=float(rng.choice([0.2, 0.4, STAYS_AWAY])),
        look_alikes=int(rng.choice([0, 0, 0, 1, 2])),
        flicker_hz=100.0 if rng.uniform() < 0.1 else 0.0,
        flicker_depth=float(rng.uniform(0.05, 0.15)),
        contrast=float(rng.choice([1.0, 1.0, 0.8, 0.6])),
        gradient=float(rng.choice([1.0, 1.0, 1.0, 4.0, 12.0])),
        duration_s=duration_s,
        sensor=_sensor(rng),
    )


def _sensor(rng: np.random.Generator) -> SensorConfig:
    return SensorConfig(
        contrast_threshold=float(rng.uniform(0.15, 0.35)),
        threshold_spread=float(rng.uniform(0.01, 0.05)),
        refractory_s=float(rng.choice([0.0001, 0.0005, 0.001])),
        noise_rate_hz=float(np.exp(rng.uniform(np.log(500), np.log(50_000)))),
        step_s=SENSOR.step_s,
        step_px=SENSOR.step_px,
    )


def _told(recipe: Recipe) -> str:
    extras = [
        text
        for is_so, text in (
            (recipe.occlusion_s > 0, "occlusion"),
            (recipe.leaves_s > 0, "leaving"),
            (recipe.look_alikes > 0, "look-alikes"),
            (recipe.flicker_hz > 0, "flicker"),
        )
        if is_so
    ]
    parts = (f"{recipe.targets} x {', '.join(sorted(set(recipe.kinds)))}", recipe.motion, recipe.camera, *extras)
    return "; ".join(parts)
