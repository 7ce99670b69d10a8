"""Random scenes from which the box network learns: all that is simulated elsewhere, before sensors of all kinds."""

from __future__ import annotations

import dataclasses

import numpy as np

from etd_ros.recovery.training.depth_scenes import depth_scene
from etd_ros.recovery.training.scenes import any_sensor, flawed, log_uniform, random_situation
from etd_ros.simulation import Scene, SensorConfig, extreme_scene, shelf_scene, thrown_scene
from etd_ros.simulation.extreme_scenes import KINDS as EXTREME_KINDS

KINDS = {"random": 0.3, "thrown": 0.25, "extreme": 0.2, "depth": 0.15, "shelf": 0.1}
"""What part of the scenes is of each kind."""
WIDTH, HEIGHT, DEPTH_S = 240, 180, 1.0
BANDWIDTH_HZ, LATE_SHARE = (100.0, 500.0), 0.3
"""Of pixels that follow the light late; part of the sensors have them (rendering takes several times as long)."""


def box_scene(rng: np.random.Generator) -> tuple[Scene, SensorConfig]:
    """A scene, and the sensor before it; `rng` decides everything.

    Raises:
        SimulationError: scikit-image, whose photographs are used, is not installed.
    """
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    if kind == "random":
        situation = random_situation(rng)
        scene, sensor = situation.scene, situation.sensor
    elif kind == "depth":
        scene, sensor = depth_scene(rng, WIDTH, HEIGHT, DEPTH_S), any_sensor(rng)
    elif kind == "thrown":
        scene, sensor = thrown_scene(rng)
    elif kind == "shelf":
        scene, sensor = shelf_scene(rng)
    else:
        scene, sensor = extreme_scene(rng, str(rng.choice(EXTREME_KINDS)))
    if rng.random() < 0.5:
        sensor = flawed(sensor, rng)
    if rng.random() < LATE_SHARE:
        sensor = dataclasses.replace(sensor, bandwidth_hz=log_uniform(rng, *BANDWIDTH_HZ))
    return scene, sensor
