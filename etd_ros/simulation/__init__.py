"""Simulated recordings with exact boxes, for the demo and the tests."""

from etd_ros.simulation.demo import demo_scene
from etd_ros.simulation.scene import Path, Scene, SimulationError, Sprite, Waypoint
from etd_ros.simulation.sensor import SensorConfig, simulate
from etd_ros.simulation.textures import TEXTURES

__all__ = [
    "TEXTURES",
    "Path",
    "Scene",
    "SensorConfig",
    "SimulationError",
    "Sprite",
    "Waypoint",
    "demo_scene",
    "simulate",
]
