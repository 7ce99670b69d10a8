"""Scenes of the kind of the Extreme Event Dataset (Mitrokhin 2018): what `etd-plus` makes of them.

    python docs/extreme_measures.py [FIRST LAST]     # seeds, 0 and 120 if none are given; two minutes on two cores

By turns, before a hand-held camera of 240x180 pixels: a ball thrown behind a dense net (`net`), a ball thrown past
something that hides it for a moment, in the dark (`hidden`), a small drone in the dark (`drone`), and the same while
light flashes (`flash`). Labels: 200 a second, while .45 of the thing can be seen. Some backgrounds are photographs
(extra `simulate`).
"""

from __future__ import annotations

import sys
from collections import defaultdict
from typing import Any

import numpy as np
from seeded_scenes import SeededScene, seeds_asked_for, tracked

from etd_ros.evaluation.scoring import SUCCESS_IOU, label_overlaps
from etd_ros.evaluation.suite import START_NS, of_each
from etd_ros.evaluation.truth import TimedBox
from etd_ros.simulation import Scene, SensorConfig, extreme_scene, visible_shares
from etd_ros.simulation.extreme_scenes import KINDS, TARGET
from etd_ros.targets import TargetStart

STREAM = 123
"""Beside the seed: no other list of scenes has these."""
LABEL_S, STARTS_AT = 0.005, 2
ON_SENSOR_MIN, VISIBLE_MIN = 0.95, 0.45


class Extreme(SeededScene):
    """A thing in one of the scenes."""

    @property
    def kind(self) -> str:
        return KINDS[self.seed % len(KINDS)]

    def make(self) -> tuple[Scene, SensorConfig]:
        return extreme_scene(np.random.default_rng([STREAM, self.seed]), self.kind)


def overlaps_of(extreme: Extreme) -> tuple[str, list[float]]:
    """The kind of scene, and the IoU with the truth at each label."""
    scene = extreme.scene()
    times_s = np.arange(0.02, scene.duration_s, LABEL_S)
    shares = visible_shares(scene, TARGET, times_s)
    is_labelled = (shares.on_sensor > ON_SENSOR_MIN) & (shares.visible > VISIBLE_MIN)
    truth = [
        TimedBox(START_NS + round(time_s * 1e9), scene.box(TARGET, time_s)) for time_s in times_s[is_labelled].tolist()
    ][STARTS_AT:]
    start = TargetStart(TARGET, truth[0].box, truth[0].stamp_ns)
    return extreme.kind, label_overlaps(tracked(extreme, start), truth[1:])


def main() -> None:
    """Print the mean AP and AR of each kind of scene and of all."""
    kinds: Any = defaultdict(list)
    for kind, overlaps in of_each(overlaps_of, map(Extreme, seeds_asked_for(0, 120)), jobs=2):
        for group in (kind, "all"):
            kinds[group].append((np.mean(overlaps), np.mean(np.array(overlaps) >= SUCCESS_IOU)))
    for kind in (*KINDS, "all"):
        ap, ar = np.array(kinds[kind]).T
        below = np.count_nonzero(ap < SUCCESS_IOU)
        sys.stdout.write(f"{kind:<8}{len(ap):>4}{ap.mean():>7.3f}/{ar.mean():.3f}{below:>4} below {SUCCESS_IOU}\n")


if __name__ == "__main__":
    main()
