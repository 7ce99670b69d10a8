"""Something thrown crosses the sensor once, in 0.1 to 0.9 s: what `etd-plus` makes of it.

    python docs/thrown_measures.py [FIRST LAST [BANDWIDTH_HZ]]     # seeds, 0 and 80 if none are given

Two minutes on two cores. With a bandwidth the sensor's pixels follow the light as late as that says, as real ones do.

Balls and other things of 12 px to 0.3 of the sensor's height in the middle of their flight, 1.2 to 8 widths of the
sensor a second, that up to double or halve on their way, turn and fall; the camera stands still, slides or shakes.
Labels: 500 a second, while 95 % of the thing can be seen; it starts from the third of them. "True boxes" are what true
boxes at the frames' stamps would have: each holds until the next one. Some backgrounds are photographs (extra
`simulate`).
"""

from __future__ import annotations

import dataclasses
import sys
from dataclasses import dataclass

import numpy as np
from seeded_scenes import SeededScene, seeds_asked_for, tracked

from etd_ros.evaluation.scoring import SUCCESS_IOU, label_overlaps
from etd_ros.evaluation.suite import START_NS, of_each
from etd_ros.evaluation.truth import TimedBox
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite, things, true_boxes
from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.motion import FloatArray
from etd_ros.targets import TargetStart

STREAM = 99
"""Beside the seed: no other list of scenes has these."""
KINDS = (things.ball, things.ball, things.plain, things.irregular, things.dartboard)
SENSOR_SIZES = ((240, 180), (346, 260), (640, 480))
LABEL_S, STARTS_AT = 0.002, 2
BEFORE_S = 0.05
"""The scene stands for so long before the flight, and twice as long after it."""
ROOM_PX = 40
"""What the background has beyond the sensor on each side, for the camera's motion."""


@dataclass(frozen=True)
class Thrown(SeededScene):
    """A thing that is thrown, before a sensor of a bandwidth (Hz; 0: without end)."""

    bandwidth_hz: float = 0.0

    def make(self) -> tuple[Scene, SensorConfig]:
        rng = np.random.default_rng([STREAM, self.seed])
        width, height = SENSOR_SIZES[int(rng.integers(len(SENSOR_SIZES)))]
        size_px = float(np.exp(rng.uniform(np.log(12), np.log(0.3 * height))))
        path, duration_s = _flight(rng, width, height)
        kind = KINDS[int(rng.integers(len(KINDS)))]
        sprite = Sprite(kind.__name__, *kind(rng, round(size_px)), path)
        background = BACKGROUNDS[str(rng.choice(["wall", "cloudy", "clutter", "tiles", "photo"]))](
            rng, height + 2 * ROOM_PX, width + 2 * ROOM_PX
        )
        view = _view(rng, width, duration_s)
        if view is None:
            background = np.ascontiguousarray(background[ROOM_PX:-ROOM_PX, ROOM_PX:-ROOM_PX])
        sensor = SensorConfig(
            contrast_threshold=float(rng.uniform(0.15, 0.35)),
            threshold_spread=0.03,
            bandwidth_hz=self.bandwidth_hz,
            noise_rate_hz=float(np.exp(rng.uniform(np.log(500), np.log(20_000)))),
            step_s=0.005,
            step_px=0.6,
        )
        return Scene(width, height, duration_s, background, (sprite,), view=view), sensor


def _flight(rng: np.random.Generator, width: int, height: int) -> tuple[Path, float]:
    """The way of what is thrown, and how long the scene lasts (s)."""
    speed_px_s = float(np.exp(rng.uniform(np.log(1.2 * width), np.log(8 * width))))
    side, angle = rng.choice([-1, 1]), rng.uniform(-0.5, 0.5)
    right_px_s, down_px_s = side * speed_px_s * np.cos(angle), speed_px_s * np.sin(angle)
    flight_s = 0.95 * width / abs(right_px_s)
    way_x, way_y = right_px_s * flight_s, down_px_s * flight_s
    x, y = (width - way_x) / 2, (height - way_y) / 2 + rng.uniform(-0.2, 0.2) * height
    fall_px, growth, spin_rad_s = rng.uniform(0, 0.6) * height, rng.uniform(-0.7, 0.7), rng.uniform(-6, 6)
    duration_s = flight_s + 3 * BEFORE_S

    def pose(times_s: FloatArray) -> tuple[FloatArray, ...]:
        # It comes from beyond the border, and goes on beyond it.
        part = np.clip((times_s - BEFORE_S) / flight_s, -0.2, 1.3)
        fallen_px = fall_px * (0.5 * part**2 - 0.25 * part)
        return x + way_x * part, y + way_y * part + fallen_px, np.exp(growth * (part - 0.5)), spin_rad_s * times_s

    return Path.of(pose, duration_s), duration_s


def _view(rng: np.random.Generator, width: int, duration_s: float) -> Path | None:
    """How the camera moves; None: it stands still."""
    camera = str(rng.choice(["still", "still", "slide", "shake"]))
    speed_px_s, angle = rng.uniform(20, 100) * width / 240, rng.uniform(0, 2 * np.pi)

    def slide(times_s: FloatArray) -> tuple[FloatArray, ...]:
        way_px = np.minimum(speed_px_s * times_s, ROOM_PX - 5)
        return way_px * np.cos(angle), way_px * np.sin(angle)

    def shake(times_s: FloatArray) -> tuple[FloatArray, ...]:
        return 3 * np.sin(8 * np.pi * times_s + angle), 3 * np.sin(10.6 * np.pi * times_s)

    if camera == "still":
        return None
    return Path.of(slide if camera == "slide" else shake, duration_s)


def overlaps_of(thrown: Thrown) -> tuple[list[float], list[float]]:
    """IoU with the truth, at each label, of the boxes, and of true boxes at the stamps of their frames."""
    scene = thrown.scene()
    (name,) = scene.targets
    times_s = np.arange(0.02, scene.duration_s, LABEL_S)
    truth = [
        TimedBox(START_NS + round(time_s * 1e9), box)
        for time_s, box in true_boxes(scene, name, times_s, visible_min=0.95)
    ][STARTS_AT:]
    start = TargetStart(name, truth[0].box, truth[0].stamp_ns)
    found = tracked(thrown, start)
    true = [dataclasses.replace(row, box=scene.box(name, (row.stamp_ns - START_NS) / 1e9)) for row in found]
    return label_overlaps(found, truth[1:]), label_overlaps(true, truth[1:])


def main() -> None:
    """Print the mean AP and AR, and the AP that true boxes would have."""
    bandwidth_hz = float(sys.argv[3]) if len(sys.argv) > 3 else 0.0
    thrown = (Thrown(seed, bandwidth_hz) for seed in seeds_asked_for(0, 80))
    of_all = list(of_each(overlaps_of, thrown, jobs=2))
    ap, true_ap = (np.array([np.mean(each) for each in kind]) for kind in zip(*of_all, strict=True))
    ar = np.mean([np.mean(np.array(found) >= SUCCESS_IOU) for found, _ in of_all])
    below = f"{np.count_nonzero(ap < SUCCESS_IOU)} below {SUCCESS_IOU}"
    sys.stdout.write(f"{len(ap)} thrown: {ap.mean():.3f}/{ar:.3f}, {below}; true boxes {true_ap.mean():.3f}\n")


if __name__ == "__main__":
    main()
