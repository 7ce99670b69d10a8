"""Random scenes to learn from: several things at a time, some of them nearly twins, before sensors of all kinds; half
of them in depth (depth_scenes.py)."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from etd_ros.reconstruction import HighPassConfig
from etd_ros.recovery.training.depth_scenes import depth_scene
from etd_ros.simulation import Recipe, Scene, SensorConfig, make_scene

WIDTH, HEIGHT = 240, 180
DURATION_S = 1.6
SIDE_PX = (13.0, 100.0)
"""Middles of what the things of a scene have, whose largest is half as large again: an exemplar is brought to one size,
so larger ones look the same, with less noise."""
SPEED_PX_S_MEDIAN = 150.0
STEP_S, STEP_PX = 0.005, 0.6
TWIN_SHARE = 0.5
"""Of scenes with several things, one wears another's surface turned over: hard to tell apart, but not impossible."""
DEPTH_SHARE = 0.5
"""Of situations, what a camera sees that passes things at several depths."""
FLAWED_SHARE = 0.5
"""Of sensors, those with hot pixels; and with leaking ones."""
THRESHOLD_BIAS = 0.2
KINDS = ("ball", "dartboard", "car", "irregular", "plain", "panel", "picture", "picture", "picture")
BACKGROUNDS = ("wall", "cloudy", "clutter", "tiles", "photo", "photo", "photo")
CAMERAS = ("still", "still", "slide", "shake", "wander", "zoom")


@dataclass(frozen=True, slots=True)
class Situation:
    """A scene, the sensor before it and the reconstruction behind that."""

    scene: Scene
    sensor: SensorConfig
    reconstruction: HighPassConfig


def training_situation(rng: np.random.Generator) -> Situation:
    """What the recovery network learns from: random situations and scenes in depth, before flawed sensors.

    Raises:
        SimulationError: as `random_situation`.
    """
    if rng.random() < DEPTH_SHARE:
        scene = depth_scene(rng, WIDTH, HEIGHT, DURATION_S)
        situation = Situation(_maybe_with_twin(scene, rng), any_sensor(rng), _reconstruction(rng))
    else:
        situation = random_situation(rng)
    return dataclasses.replace(situation, sensor=flawed(situation.sensor, rng))


def random_situation(rng: np.random.Generator) -> Situation:
    """A scene of 1.6 s on a 240x180 sensor; `rng` decides everything.

    Raises:
        SimulationError: scikit-image, whose photographs are used, is not installed.
    """
    recipe = _recipe(rng)
    scene = _maybe_with_twin(make_scene(recipe, WIDTH, HEIGHT, rng), rng)
    return Situation(scene, recipe.sensor, _reconstruction(rng))


def _recipe(rng: np.random.Generator) -> Recipe:
    targets = int(rng.choice([1, 2, 2, 3, 3, 4]))
    side = log_uniform(rng, SIDE_PX[0], SIDE_PX[1] / targets**0.5)
    speed = float(np.clip(SPEED_PX_S_MEDIAN * np.exp(rng.normal(0, 1)), 10, 2000))
    camera = str(rng.choice(CAMERAS))
    motion = str(rng.choice(["wander", "wander", "cross"] if camera == "still" else ["wander", "rest", "cross"]))
    return Recipe(
        tuple(rng.choice(KINDS, targets).tolist()),
        str(rng.choice(BACKGROUNDS)),
        targets=targets,
        size_px=(max(SIDE_PX[0], 0.6 * side), 1.5 * side),
        speed_px_s=(0.5 * speed, 1.5 * speed),
        motion=motion,
        scale=(float(rng.uniform(0.6, 0.95)), float(rng.uniform(1.05, 1.6))) if rng.random() < 0.5 else (1.0, 1.0),
        spin_deg_s=float(rng.choice([0.0, 0.0, 30.0, 90.0])),
        camera=camera,
        camera_px_s=log_uniform(rng, 20, 300),
        occlusion_s=float(rng.uniform(0.1, 0.4)) if rng.random() < 0.3 else 0.0,
        flicker_hz=100.0 if rng.random() < 0.1 else 0.0,
        flicker_depth=float(rng.uniform(0.05, 0.15)),
        contrast=float(rng.uniform(0.4, 1.0)),
        gradient=float(rng.choice([1.0, 1.0, 1.0, 4.0, 12.0])),
        duration_s=DURATION_S,
        sensor=any_sensor(rng),
    )


def any_sensor(rng: np.random.Generator) -> SensorConfig:
    """A sensor of some threshold and noise."""
    threshold = log_uniform(rng, 0.08, 0.4)
    return SensorConfig(
        contrast_threshold=threshold,
        threshold_spread=threshold * float(rng.uniform(0.02, 0.25)),
        refractory_s=float(rng.choice([0.0, 0.0005, 0.001])),
        noise_rate_hz=log_uniform(rng, 300, 50_000),
        step_s=STEP_S,
        step_px=STEP_PX,
    )


def flawed(sensor: SensorConfig, rng: np.random.Generator) -> SensorConfig:
    """The sensor with thresholds that differ by polarity, hot pixels and leaking ones."""
    is_hot, is_leaking = rng.random(2) < FLAWED_SHARE
    return dataclasses.replace(
        sensor,
        threshold_bias=float(np.clip(rng.normal(0, THRESHOLD_BIAS), -0.6, 0.6)),
        hot_pixels=int(rng.integers(1, 30)) if is_hot else 0,
        hot_pixel_rate_hz=log_uniform(rng, 20, 1000),
        leak_rate_hz=log_uniform(rng, 500, 10_000) if is_leaking else 0.0,
    )


def _reconstruction(rng: np.random.Generator) -> HighPassConfig:
    """The default most of the time, as the images that recovery will see are made with it."""
    return HighPassConfig(cutoff_hz=HighPassConfig().cutoff_hz if rng.random() < 0.6 else log_uniform(rng, 1.0, 10.0))


def _maybe_with_twin(scene: Scene, rng: np.random.Generator) -> Scene:
    """The scene, at times with one thing mirrored or turned upside down in another's place."""
    if len(scene.targets) < 2 or rng.random() >= TWIN_SHARE:
        return scene
    first, second = rng.choice([index for index, sprite in enumerate(scene.sprites) if sprite.is_target], 2, False)
    model, replaced = scene.sprites[first], scene.sprites[second]
    turned = np.s_[:, ::-1] if rng.random() < 0.5 else np.s_[::-1, ::-1]
    twin = dataclasses.replace(replaced, texture=model.texture[turned].copy(), opacity=model.opacity[turned].copy())
    sprites = [twin if index == second else sprite for index, sprite in enumerate(scene.sprites)]
    return dataclasses.replace(scene, sprites=tuple(sprites))


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is as likely anywhere between those of two."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
