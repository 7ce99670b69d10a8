"""Something thrown crosses the sensor once, in 0.1 to 0.9 s: what `etd-plus` makes of it.

    python docs/thrown_measures.py [FIRST LAST]     # seeds, 0 and 80 if none are given; two minutes on two cores

Balls and other things of 12 px to a third of the sensor's height, 1.2 to 8 widths of the sensor a second, that grow or
shrink by up to half, turn and fall; the camera stands still, slides or shakes. Labels: 500 a second, while 95 % of the
thing can be seen; it starts from the third of them. Some backgrounds are photographs (extra `simulate`).
"""

from __future__ import annotations

import sys
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from etd_ros.boxes import Box
from etd_ros.engine import track
from etd_ros.evaluation.scoring import SUCCESS_IOU
from etd_ros.evaluation.suite import START_NS, of_each
from etd_ros.events import Events
from etd_ros.simulation import Path, Scene, Sprite, simulate, things, true_boxes
from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.motion import FloatArray
from etd_ros.simulation.sensor import SensorConfig
from etd_ros.stream import StreamGuard
from etd_ros.targets import TargetStart

STREAM = 99
KINDS = (things.ball, things.ball, things.plain, things.irregular, things.dartboard)
SENSOR_SIZES = ((240, 180), (346, 260), (640, 480))
LABEL_S, STARTS_AT, LABELS_MIN = 0.002, 2, 10
BEFORE_S = 0.05
ROOM_PX = 40
"""What the background has beyond the sensor on each side, for the camera's motion."""


@dataclass(frozen=True)
class Thrown:
    """A thing that is thrown, as `evaluate` takes sequences."""

    seed: int

    @property
    def name(self) -> str:
        return f"thrown-{self.seed}"

    def scene(self) -> Scene:
        return self._made[0]

    def events(self, scene: Scene, *, start_ns: int = 0) -> Iterator[Events]:
        return simulate(scene, seed=self.seed, start_ns=start_ns, config=self._made[1])

    @cached_property
    def _made(self) -> tuple[Scene, SensorConfig]:
        rng = np.random.default_rng([STREAM, self.seed])
        width, height = SENSOR_SIZES[int(rng.integers(len(SENSOR_SIZES)))]
        size = float(np.exp(rng.uniform(np.log(12), np.log(0.3 * height))))
        path, duration_s = _flight(rng, width, height)
        kind = KINDS[int(rng.integers(len(KINDS)))]
        sprite = Sprite(kind.__name__, *kind(rng, round(size)), path)
        background = BACKGROUNDS[str(rng.choice(["wall", "cloudy", "clutter", "tiles", "photo"]))](
            rng, height + 2 * ROOM_PX, width + 2 * ROOM_PX
        )
        view = _view(rng, width, duration_s)
        if view is None:
            background = np.ascontiguousarray(background[ROOM_PX:-ROOM_PX, ROOM_PX:-ROOM_PX])
        sensor = SensorConfig(
            contrast_threshold=float(rng.uniform(0.15, 0.35)),
            threshold_spread=0.03,
            noise_rate_hz=float(np.exp(rng.uniform(np.log(500), np.log(20_000)))),
            step_s=0.005,
            step_px=0.6,
        )
        return Scene(width, height, duration_s, background, (sprite,), view=view), sensor


def _flight(rng: np.random.Generator, width: int, height: int) -> tuple[Path, float]:
    """The way of what is thrown, and how long the scene lasts (s)."""
    speed = float(np.exp(rng.uniform(np.log(1.2 * width), np.log(8 * width))))
    side, slope = rng.choice([-1, 1]), rng.uniform(-0.5, 0.5)
    right, down = side * speed * np.cos(slope), speed * np.sin(slope)
    flight_s = 0.95 * width / abs(right)
    x, y = (width - right * flight_s) / 2, (height - down * flight_s) / 2 + rng.uniform(-0.2, 0.2) * height
    fall, growth, spin = rng.uniform(0, 0.6) * height, rng.uniform(-0.7, 0.7), rng.uniform(-6, 6)
    duration_s = flight_s + 3 * BEFORE_S

    def pose(times_s: FloatArray) -> tuple[FloatArray, ...]:
        part = np.clip((times_s - BEFORE_S) / flight_s, -0.2, 1.3)
        fallen = fall * (0.5 * part**2 - 0.25 * part)
        return (
            x + right * flight_s * part,
            y + down * flight_s * part + fallen,
            np.exp(growth * (part - 0.5)),
            spin * times_s,
        )

    return Path.of(pose, duration_s), duration_s


def _view(rng: np.random.Generator, width: int, duration_s: float) -> Path | None:
    camera = str(rng.choice(["still", "still", "slide", "shake"]))
    speed, angle = rng.uniform(20, 100) * width / 240, rng.uniform(0, 2 * np.pi)
    if camera == "slide":
        most = ROOM_PX - 5
        return Path.of(
            lambda times: tuple(np.clip(speed * times * way, -most, most) for way in (np.cos(angle), np.sin(angle))),
            duration_s,
        )
    if camera == "shake":
        return Path.of(
            lambda times: (3 * np.sin(8 * np.pi * times + angle), 3 * np.sin(10.6 * np.pi * times)), duration_s
        )
    return None


def overlaps_of(thrown: Thrown) -> list[tuple[float, float]]:
    """IoU with the truth of the boxes, and of true boxes at the frames' stamps, at each label."""
    scene = thrown.scene()
    (name,) = scene.targets
    labels = list(true_boxes(scene, name, np.arange(0.02, scene.duration_s, LABEL_S), visible_min=0.95))[STARTS_AT:]
    if len(labels) < LABELS_MIN:
        return []
    start = TargetStart(name, labels[0][1], START_NS + round(labels[0][0] * 1e9))
    stamps: list[int] = []
    boxes: list[Box | None] = []
    guard = StreamGuard()
    batches = (batch for events in thrown.events(scene, start_ns=START_NS) for batch in guard.feed(events))
    for step in track(batches, [start], threads=False):
        stamps.append(step.frame.stamp_ns)
        boxes.append(step.reports[0].box)
    overlaps = []
    for time_s, truth in labels[1:]:
        last = bisect_right(stamps, START_NS + round(time_s * 1e9)) - 1
        found, held = boxes[last], scene.box(name, (stamps[last] - START_NS) / 1e9)
        overlaps.append((0.0 if found is None else found.iou(truth), held.iou(truth)))
    return overlaps


def main() -> None:
    """Print the mean AP and AR, and the AP that true boxes would have."""
    first, last = (int(argument) for argument in sys.argv[1:3]) if len(sys.argv) > 2 else (0, 80)
    of_all = [np.array(overlaps) for overlaps in of_each(overlaps_of, map(Thrown, range(first, last)), 2) if overlaps]
    ap, held = np.mean([overlaps.mean(axis=0) for overlaps in of_all], axis=0)
    ar = np.mean([(overlaps[:, 0] >= SUCCESS_IOU).mean() for overlaps in of_all])
    lost = sum(overlaps[:, 0].mean() < SUCCESS_IOU for overlaps in of_all)
    sys.stdout.write(f"{len(of_all)} thrown: {ap:.3f}/{ar:.3f}, {lost} below {SUCCESS_IOU}; true boxes {held:.3f}\n")


if __name__ == "__main__":
    main()
