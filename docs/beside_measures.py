"""Targets into whose boxes another target's reaches when both start.

    python docs/beside_measures.py [FIRST LAST]     # seeds, 0 and 40 if none are given; three minutes on two cores

A thing of 25 to 60 px that moves, and a second box that has 5 to 45 % of its width or height, or of both, in common
with it: "stray" is somebody's box round nothing but what lies behind, before a camera that slides; "another" is round a
second thing, which moves another way and counts as well. A line for each kind: mean IoU and share of successes of the
things, and how many of them have an IoU of .5 at the end.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace

import numpy as np
from long_measures import seen_before
from seeded_scenes import SeededScene, seeds_asked_for, tracked_all

from etd_ros.boxes import Box
from etd_ros.evaluation.scoring import SUCCESS_IOU
from etd_ros.evaluation.suite import START_NS
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite, Waypoint
from etd_ros.simulation.recipes import SENSOR, Recipe, make_scene
from etd_ros.targets import TargetStart

WIDTH, HEIGHT, DURATION_S = 240, 180, 1.0
STREAM = 91
"""Beside the seed and the kind: no other list of scenes has these."""
KINDS = "stray", "another"
THINGS = "ball", "dartboard", "car", "irregular", "panel"
BACKGROUNDS = "cloudy", "clutter", "tiles"


@dataclass(frozen=True)
class Beside(SeededScene):
    """A scene of one kind."""

    kind: str

    def make(self) -> tuple[Scene, SensorConfig]:
        rng = self._rng(0)
        camera = {"camera": "slide", "camera_px_s": float(rng.uniform(40, 150))} if self.kind == "stray" else {}
        recipe = Recipe(
            (str(rng.choice(THINGS)),),
            str(rng.choice(BACKGROUNDS)),
            size_px=(25.0, 60.0),
            speed_px_s=(40.0, 250.0),
            duration_s=DURATION_S,
            **camera,
        )
        scene = make_scene(recipe, WIDTH, HEIGHT, rng)
        if self.kind == "another":
            scene = replace(scene, sprites=(*scene.sprites, self._another(scene)))
        return scene, SENSOR

    def other_box(self, scene: Scene) -> Box:
        """The second box at the start."""
        rng, box = self._rng(1), scene.box(next(iter(scene.targets)), 0.0)
        side = float(rng.uniform(0.8, 1.3)) * max(box.w, box.h)
        shares, signs = rng.uniform(0.05, 0.45, 2), rng.choice((-1, 1), 2)
        # Beside it, above or below it, or at a corner.
        along = rng.integers(0, 3)
        off = [(own + side) / 2 - share * own for own, share in zip(box[2:], shares, strict=True)]
        if along < 2:
            off[along] = float(rng.uniform(0, 0.3)) * off[along]
        x, y = (middle + sign * by for middle, sign, by in zip(box.center, signs, off, strict=True))
        return Box(x - side / 2, y - side / 2, side, side)

    def _another(self, scene: Scene) -> Sprite:
        rng, box = self._rng(2), self.other_box(scene)
        (x, y), (angle, speed_px_s) = box.center, (rng.uniform(0, 2 * np.pi), rng.uniform(40, 250))
        to = x + speed_px_s * np.cos(angle) * DURATION_S, y + speed_px_s * np.sin(angle) * DURATION_S
        thing = seen_before(np.asarray(scene.background), rng, round(box.w))
        return Sprite("another", *thing, Path((Waypoint(0.0, x, y), Waypoint(DURATION_S, *to))))

    def _rng(self, part: int) -> np.random.Generator:
        return np.random.default_rng([STREAM, self.seed, KINDS.index(self.kind), part])


def overlaps_of(seeded: Beside) -> list[list[float]]:
    """The IoU of each thing's box, label by label, as long as half of it is on the sensor."""
    scene = seeded.scene()
    boxes = {name: scene.box(name, 0.0) for name in scene.targets} | {"another": seeded.other_box(scene)}
    rows = tracked_all(seeded, [TargetStart(name, box, START_NS) for name, box in boxes.items()])
    found = []
    for name in scene.targets:
        own = [row for row in rows if row.target == name]
        truths = [(row, scene.box(name, (row.stamp_ns - START_NS) * 1e-9)) for row in own]
        seen = [(row, truth) for row, truth in truths if 0 < truth.center[0] < WIDTH and 0 < truth.center[1] < HEIGHT]
        found.append([0.0 if row.box is None else row.box.iou(truth) for row, truth in seen])
    return found


def main() -> None:
    """Print the measures of the scenes that are asked for."""
    for kind in KINDS:
        things = [each for seed in seeds_asked_for(0, 40) for each in overlaps_of(Beside(seed, kind)) if each]
        ap = np.mean([np.mean(overlaps) for overlaps in things])
        ar = np.mean([np.mean(np.array(overlaps) > SUCCESS_IOU) for overlaps in things])
        kept = sum(overlaps[-1] > SUCCESS_IOU for overlaps in things)
        sys.stdout.write(f"{kind:10s} {ap:.3f} {ar:.3f}  {kept} of {len(things)}\n")


if __name__ == "__main__":
    main()
