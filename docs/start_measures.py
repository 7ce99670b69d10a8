"""How good the first 0.3 s of a target are, wherever in a random scene it starts, with messages lost or not.

    python docs/start_measures.py [--lost SHARE] [FIRST LAST]    # seeds, 61 and 91 if none are given; a minute

Each target starts at its true box, at four times of its scene. Events come in messages of 4 ms, each of which is lost
with the probability SHARE, which the sequence numbers tell.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import zlib
from collections.abc import Iterator
from functools import partial

import numpy as np

from etd_ros.engine import track
from etd_ros.evaluation.scoring import SUCCESS_IOU, label_overlaps
from etd_ros.evaluation.suite import START_NS, of_each
from etd_ros.evaluation.tracks import TrackRow
from etd_ros.evaluation.truth import TimedBox
from etd_ros.events import Events, concatenate
from etd_ros.simulation import Scene, Sequence, random_sequences, true_boxes
from etd_ros.stream import StreamBatch, StreamGuard
from etd_ros.targets import TargetStart

STARTS_S = (0.1, 0.4, 0.7, 1.0)
STEP_S, STEPS = 0.01, 30
BEFORE_NS, AFTER_NS = 30_000_000, 5_000_000
MESSAGE_NS = 4_000_000


def starts_of(sequence: Sequence, lost: float) -> list[list[float]]:
    """IoU with the truth, every 10 ms, of each target that is seen all that time, at each of the starts."""
    scene = sequence.scene()
    events = concatenate(list(sequence.events(scene, start_ns=START_NS)))
    return [overlaps for start_s in STARTS_S for overlaps in _overlaps(scene, events, start_s, lost)]


def _overlaps(scene: Scene, events: Events, start_s: float, lost: float) -> Iterator[list[float]]:
    times_s = [start_s + step * STEP_S for step in range(STEPS)]
    truth = {name: _labels(scene, name, times_s) for name in scene.targets}
    truth = {name: labels for name, labels in truth.items() if len(labels) == STEPS}
    if not truth:
        return
    start_ns, end_ns = (START_NS + round(times_s[index] * 1e9) for index in (0, -1))
    first, last = np.searchsorted(events.t, [start_ns - BEFORE_NS, end_ns + AFTER_NS]).tolist()
    starts = [TargetStart(name, labels[0].box, labels[0].stamp_ns) for name, labels in truth.items()]
    rows: dict[str, list[TrackRow]] = {name: [] for name in truth}
    for step in track(_arriving(events[first:last], lost), starts, threads=False):
        for report in step.reports:
            row = TrackRow(step.frame.stamp_ns, report.name, report.box, report.score, report.state.value)
            rows[report.name].append(row)
    for name, labels in truth.items():
        yield label_overlaps(rows[name], labels[1:])


def _labels(scene: Scene, name: str, times_s: list[float]) -> list[TimedBox]:
    return [TimedBox(START_NS + round(time_s * 1e9), box) for time_s, box in true_boxes(scene, name, times_s)]


def _arriving(events: Events, lost: float) -> Iterator[StreamBatch]:
    guard = StreamGuard()
    rng = np.random.default_rng(zlib.crc32(events.t[:1].tobytes()))
    cuts = np.flatnonzero(np.diff((events.t - events.t[0]) // MESSAGE_NS)) + 1
    edges = [0, *cuts.tolist(), len(events)]
    for seq, (first, last) in enumerate(itertools.pairwise(edges)):
        if rng.random() >= lost:
            yield from guard.feed(events[first:last], seq)


def main() -> None:
    """Print the mean IoU of all starts, and how many have none of 0.5 left after 0.3 s."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lost", type=float, default=0.0, metavar="SHARE")
    parser.add_argument("seeds", type=int, nargs="*", default=[61, 91], metavar="SEED")
    options = parser.parse_args()
    first, last = options.seeds
    of_scenes = of_each(partial(starts_of, lost=options.lost), random_sequences(range(first, last)), jobs=2)
    overlaps = np.array([start for scene in of_scenes for start in scene])
    bad = int((overlaps[:, -1] < SUCCESS_IOU).sum())
    figures = f"mean IoU {overlaps.mean():.3f}, {bad} below {SUCCESS_IOU} after 0.3 s"
    sys.stdout.write(f"{len(overlaps)} starts: {figures}\n")


if __name__ == "__main__":
    main()
