"""How well `etd-plus` holds targets whose start boxes are too large, too small or askew, as hands and detectors draw.

    python docs/loose_measures.py [FIRST LAST]     # seeds, 0 and 6 if none are given; three minutes on two cores

A camera slides past things (those of `shelf_measures.py`), and recipes of the suite in which nothing hides a target.
Each line: how a start box differs from the true one, AP / AR against the true boxes, the mean of what the start box has
in common with the truth, and how many of the targets have an AR below .9.
"""

from __future__ import annotations

import sys

import numpy as np
import numpy.typing as npt
from seeded_scenes import SeededScene, seeds_asked_for, tracked_all
from shelf_measures import Shelf

from etd_ros.boxes import Box
from etd_ros.evaluation.scoring import label_overlaps, score_of
from etd_ros.evaluation.suite import START_NS, of_each
from etd_ros.evaluation.tracks import TrackRow
from etd_ros.evaluation.truth import TimedBox
from etd_ros.simulation import Sequence, true_boxes
from etd_ros.simulation.suite import SUITE
from etd_ros.targets import TargetStart

RECIPES = ("ball", "dartboard", "trio", "slide", "slide-clutter", "pan", "hand", "creep", "road")
FIRST_S, STEP_S = 0.1, 0.01
HELD_AR = 0.9
STARTS = {
    "true": (1.0, 0.0),
    "larger by 1.1": (1.1, 0.0),
    "larger by 1.2": (1.2, 0.0),
    "smaller by .85": (0.85, 0.0),
    "askew by .1": (1.0, 0.1),
}
"""Factor of the size, and what it is moved by along x and y, of its size."""


def main() -> None:
    """Print a line for each kind of start box."""
    seeds = seeds_asked_for(0, 6)
    scenes = [Shelf(seed) for seed in seeds]
    scenes += [SUITE[name].with_seed(seed) for seed in seeds if seed for name in RECIPES]
    found = np.concatenate(list(of_each(scores_of, scenes, jobs=2)), axis=1)
    for how, (ap, ar, first) in zip(STARTS, found.transpose(0, 2, 1), strict=True):
        low = np.count_nonzero(ar < HELD_AR)
        sys.stdout.write(
            f"{how:<16}{ap.mean():7.3f} / {ar.mean():.3f}  first {first.mean():.3f}  {low} of {len(ap)} low\n"
        )


def scores_of(sequence: Sequence | SeededScene) -> npt.NDArray[np.float64]:
    """AP, AR and the start box's own overlap of each target, each start on its own: shape (starts, targets, 3)."""
    scene = sequence.scene()
    times_s = np.arange(FIRST_S, scene.duration_s, STEP_S).tolist()
    truth = {
        name: [TimedBox(START_NS + round(time_s * 1e9), box) for time_s, box in true_boxes(scene, name, times_s)]
        for name in scene.targets
    }
    found = []
    for factor, shift in STARTS.values():
        starts = [
            TargetStart(name, _changed(labels[0].box, factor, shift), labels[0].stamp_ns)
            for name, labels in truth.items()
            if len(labels) > 1
        ]
        rows = tracked_all(sequence, starts)
        found.append(
            [
                _score([row for row in rows if row.target == start.name], truth[start.name], start.box)
                for start in starts
            ]
        )
    return np.array(found)


def _score(rows: list[TrackRow], labels: list[TimedBox], start: Box) -> tuple[float, float, float]:
    score = score_of(label_overlaps(rows, labels))
    return score.ap, score.ar, start.iou(labels[0].box)


def _changed(box: Box, factor: float, shift: float) -> Box:
    """A box as somebody might draw it."""
    w, h = factor * box.w, factor * box.h
    return Box(box.x + (box.w - w) / 2 + shift * box.w, box.y + (box.h - h) / 2 + shift * box.h, w, h)


if __name__ == "__main__":
    main()
