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
from etd_ros.simulation import Scene, SensorConfig, thrown_scene, true_boxes
from etd_ros.targets import TargetStart

STREAM = 99
"""Beside the seed: no other list of scenes has these."""
LABEL_S, STARTS_AT = 0.002, 2


@dataclass(frozen=True)
class Thrown(SeededScene):
    """A thing that is thrown, before a sensor of a bandwidth (Hz; 0: without end)."""

    bandwidth_hz: float = 0.0

    def make(self) -> tuple[Scene, SensorConfig]:
        return thrown_scene(np.random.default_rng([STREAM, self.seed]), self.bandwidth_hz)


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
