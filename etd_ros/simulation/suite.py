"""The fixed list of simulated sequences that trackers are compared on, and random ones of the same families."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from etd_ros.errors import named
from etd_ros.events import Events
from etd_ros.simulation.motion import SimulationError
from etd_ros.simulation.recipes import SENSOR, Recipe, make_scene
from etd_ros.simulation.scene import Scene
from etd_ros.simulation.sensor import simulate

SUITE_STREAM = 1
QVGA, DAVIS, VGA, HD = (240, 180), (346, 260), (640, 480), (1280, 720)
ROUND = ("ball", "dartboard", "irregular")


@dataclass(frozen=True, slots=True)
class Sequence:
    """A simulated sequence: scene and events follow from it alone.

    Attributes:
        name: unique.
        description: what it tests, in a line.
        seed: of the scene, the pixels' thresholds and the noise.
        width, height: sensor size (pixels).
        recipe: of the scene, and its sensor.
        stream: keeps the fixed suite's generators apart from those of random sequences.
    """

    name: str
    description: str
    seed: int
    width: int
    height: int
    recipe: Recipe
    stream: int = SUITE_STREAM

    def scene(self) -> Scene:
        """The scene."""
        return make_scene(self.recipe, self.width, self.height, np.random.default_rng([self.stream, self.seed]))

    def events(self, scene: Scene | None = None, *, start_ns: int = 0) -> Iterator[Events]:
        """Its events, lazily, a batch per rendering step.

        Args:
            scene: what `scene()` returned, if that is there already.
            start_ns: time of its start on the ROS clock (ns).
        """
        return simulate(scene or self.scene(), seed=self.seed, start_ns=start_ns, config=self.recipe.sensor)

    def with_seed(self, seed: int) -> Sequence:
        """The same recipe with another seed."""
        return dataclasses.replace(self, seed=seed)


_SEQUENCES = (
    Sequence("ball", "one ball before a plain wall", 1000, *QVGA, Recipe(("ball",), "wall")),
    Sequence(
        "dartboard", "a dartboard before clutter", 1001, *QVGA, Recipe(("dartboard",), "clutter", size_px=(45, 55))
    ),
    Sequence(
        "trio",
        "three things of 30 to 50 px on wandering ways",
        1002,
        *DAVIS,
        Recipe(ROUND, "cloudy", targets=3, duration_s=2.0),
    ),
    Sequence(
        "crowd",
        "eight things that pass by each other",
        1103,
        *DAVIS,
        Recipe((*ROUND, "panel"), "wall", targets=8, size_px=(24, 40), duration_s=1.5),
    ),
    Sequence(
        "swarm",
        "20 things of 28 to 50 px",
        1004,
        *VGA,
        Recipe((*ROUND, "panel", "car"), "cloudy", targets=20, size_px=(28, 50), speed_px_s=(60, 250), duration_s=1.2),
    ),
    Sequence(
        "tiny",
        "two things of 12 to 16 px",
        1005,
        *QVGA,
        Recipe(("ball", "panel"), "wall", targets=2, size_px=(12, 16), speed_px_s=(60, 150)),
    ),
    Sequence(
        "huge",
        "a thing of 200 px",
        1006,
        *DAVIS,
        Recipe(("irregular",), "clutter", size_px=(195, 200), speed_px_s=(60, 100)),
    ),
    Sequence(
        "creep",
        "two things at 10 to 15 px/s",
        1007,
        *QVGA,
        Recipe(("dartboard", "car"), "wall", targets=2, speed_px_s=(10, 15), duration_s=2.5),
    ),
    Sequence(
        "throw",
        "a ball at 1000 px/s",
        1008,
        *DAVIS,
        Recipe(("ball",), "cloudy", speed_px_s=(1000, 1000), duration_s=1.2),
    ),
    Sequence(
        "whirl",
        "a thing at 3000 px/s",
        1009,
        *VGA,
        Recipe(("irregular",), "wall", size_px=(60, 70), speed_px_s=(3000, 3000), duration_s=0.8),
    ),
    Sequence(
        "slide",
        "a camera slides past four things that stand still",
        1010,
        *QVGA,
        Recipe(
            ("dartboard", "ball", "irregular", "panel"),
            "cloudy",
            targets=4,
            motion="rest",
            camera="slide",
            camera_px_s=60.0,
            duration_s=2.0,
        ),
    ),
    Sequence(
        "slide-clutter",
        "a camera slides past three plain things before clutter",
        1011,
        *DAVIS,
        Recipe(("plain", "ball", "plain"), "clutter", targets=3, motion="rest", camera="slide", camera_px_s=100.0),
    ),
    Sequence(
        "pan",
        "a panning camera and two moving things",
        1012,
        *DAVIS,
        Recipe(("ball", "car"), "clutter", targets=2, camera="wander", camera_px_s=150.0, duration_s=2.0),
    ),
    Sequence(
        "hand",
        "a hand-held camera and two moving things",
        1013,
        *QVGA,
        Recipe(("irregular", "ball"), "tiles", targets=2, camera="shake", camera_px_s=80.0),
    ),
    Sequence(
        "zoom",
        "a zooming, panning camera past things that stand still",
        1714,
        *DAVIS,
        Recipe(
            ("dartboard", "irregular"),
            "clutter",
            targets=2,
            motion="rest",
            camera="zoom",
            camera_px_s=60.0,
            duration_s=2.0,
        ),
    ),
    Sequence(
        "spin",
        "a panel and an irregular thing that turn by 180 deg/s",
        1015,
        *QVGA,
        Recipe(("panel", "irregular"), "wall", targets=2, spin_deg_s=180.0, size_px=(40, 50)),
    ),
    Sequence(
        "breathe",
        "things that shrink to 0.6 and grow to 1.7 of their size",
        1016,
        *DAVIS,
        Recipe(("ball", "irregular"), "cloudy", targets=2, scale=(0.6, 1.7), speed_px_s=(60, 120), duration_s=2.5),
    ),
    Sequence(
        "blink",
        "hidden for 0.1 s behind a pillar",
        1017,
        *QVGA,
        Recipe(("ball",), "cloudy", motion="cross", occlusion_s=0.1, speed_px_s=(140, 140)),
    ),
    Sequence(
        "pillar",
        "hidden behind a pillar, for more than half of it for 0.57 s",
        1018,
        *DAVIS,
        Recipe(("dartboard",), "clutter", motion="cross", occlusion_s=0.32, speed_px_s=(140, 140), duration_s=2.0),
    ),
    Sequence(
        "panel",
        "two things hidden for 0.3 s by panels that pass by; one is then covered by the other panel, for 1 s in all",
        1319,
        *DAVIS,
        Recipe(("irregular", "ball"), "wall", targets=2, occlusion_s=0.25, speed_px_s=(50, 90), duration_s=2.0),
    ),
    Sequence(
        "slide-hidden",
        "hidden for 0.3 s while the camera slides",
        1020,
        *DAVIS,
        Recipe(
            ("dartboard",), "clutter", motion="rest", camera="slide", camera_px_s=70.0, occlusion_s=0.25, duration_s=2.0
        ),
    ),
    Sequence(
        "exit",
        "a ball leaves and stays away",
        1021,
        *QVGA,
        Recipe(("ball",), "cloudy", leaves_s=0.35, duration_s=2.0),
    ),
    Sequence(
        "return",
        "a thing leaves and comes back",
        1122,
        *DAVIS,
        Recipe(("irregular",), "cloudy", leaves_s=0.3, away_s=0.3, duration_s=2.5),
    ),
    Sequence(
        "exit-pan",
        "two things leave before a panning camera",
        1023,
        *DAVIS,
        Recipe(("car", "ball"), "clutter", targets=2, camera="wander", camera_px_s=100.0, leaves_s=0.4, duration_s=2.0),
    ),
    Sequence(
        "twins",
        "a ball among two that look alike",
        1024,
        *QVGA,
        Recipe(("ball",), "wall", look_alikes=2, duration_s=2.0),
    ),
    Sequence(
        "twins-hidden",
        "a dartboard is hidden for 0.3 s while one like it goes on",
        1025,
        *DAVIS,
        Recipe(("dartboard",), "cloudy", look_alikes=1, occlusion_s=0.25, speed_px_s=(60, 100), duration_s=2.0),
    ),
    Sequence(
        "mains",
        "light that flickers by 10 % at 100 Hz",
        1026,
        *QVGA,
        Recipe(("irregular", "ball"), "cloudy", targets=2, flicker_hz=100.0, flicker_depth=0.1),
    ),
    Sequence(
        "lamp",
        "a lamp that flickers by 40 % at 100 Hz, and a ball",
        1027,
        *QVGA,
        Recipe(("lamp", "ball"), "wall", targets=2, flicker_hz=100.0, flicker_depth=0.4),
    ),
    Sequence(
        "noise",
        "50,000 noise events/s",
        1028,
        *QVGA,
        Recipe(("ball", "irregular"), "wall", targets=2, sensor=dataclasses.replace(SENSOR, noise_rate_hz=50_000.0)),
    ),
    Sequence(
        "dusk",
        "light that falls by 12 over the sensor, low contrast",
        1029,
        *DAVIS,
        Recipe(("irregular", "car"), "cloudy", targets=2, contrast=0.55, gradient=12.0),
    ),
    Sequence(
        "road",
        "three cars cross a street",
        1430,
        *VGA,
        Recipe(("car",), "clutter", targets=3, size_px=(60, 110), motion="cross", speed_px_s=(150, 400)),
    ),
    Sequence(
        "hd",
        "four things of 60 to 200 px, still camera",
        1031,
        *HD,
        Recipe(
            ("ball", "irregular", "panel", "car"),
            "clutter",
            targets=4,
            size_px=(60, 200),
            speed_px_s=(200, 600),
            duration_s=0.8,
        ),
    ),
    Sequence(
        "hd-pan",
        "three things of 60 to 150 px before a panning camera",
        1032,
        *HD,
        Recipe(
            ("dartboard", "car", "irregular"),
            "cloudy",
            targets=3,
            size_px=(60, 150),
            speed_px_s=(150, 300),
            camera="wander",
            camera_px_s=150.0,
            duration_s=0.8,
        ),
    ),
)

SUITE: dict[str, Sequence] = {sequence.name: sequence for sequence in _SEQUENCES}
"""The fixed sequences by name."""


def sequence_named(name: str) -> Sequence:
    """The sequence of the fixed suite that has this name.

    Raises:
        SimulationError: there is none; the message lists the known ones.
    """
    return named(SUITE, name, "sequence", SimulationError)
