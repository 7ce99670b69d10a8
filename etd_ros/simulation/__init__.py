"""Simulated recordings with exact boxes, for the demo, the regression suite, training and the tests."""

from etd_ros.simulation.demo import demo_scene
from etd_ros.simulation.extreme_scenes import extreme_scene
from etd_ros.simulation.motion import Flicker, Path, Pose, SimulationError, Waypoint
from etd_ros.simulation.random_scenes import random_scene, random_seed_of, random_sequence, random_sequences
from etd_ros.simulation.recipes import Recipe, make_scene
from etd_ros.simulation.scene import Scene, Sprite
from etd_ros.simulation.sensor import SensorConfig, simulate
from etd_ros.simulation.shelf_scenes import shelf_scene
from etd_ros.simulation.suite import SUITE, Sequence, sequence_named
from etd_ros.simulation.textures import TEXTURES
from etd_ros.simulation.thrown_scenes import thrown_scene
from etd_ros.simulation.truth import Absence, AbsentTime, absent_times, true_boxes, visible_shares

__all__ = [
    "SUITE",
    "TEXTURES",
    "Absence",
    "AbsentTime",
    "Flicker",
    "Path",
    "Pose",
    "Recipe",
    "Scene",
    "SensorConfig",
    "Sequence",
    "SimulationError",
    "Sprite",
    "Waypoint",
    "absent_times",
    "demo_scene",
    "extreme_scene",
    "make_scene",
    "random_scene",
    "random_seed_of",
    "random_sequence",
    "random_sequences",
    "sequence_named",
    "shelf_scene",
    "simulate",
    "thrown_scene",
    "true_boxes",
    "visible_shares",
]
