"""How well trackers of pictures follow the targets of filmed scenes that training never saw.

`python -m etd_ros.recovery.training.following` prints the table of docs/training.md; with `--choose` how the compact
network's scoring was chosen, on other scenes.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np

from etd_ros.boxes import Box
from etd_ros.recovery.config import RecoveryConfig
from etd_ros.recovery.crops import Picture
from etd_ros.recovery.picture_trackers import compact_network, make_siamfc, make_siamrpn
from etd_ros.recovery.siamrpn_tracking import COMPACT, VOT, Scoring, SiamRpnTracker
from etd_ros.recovery.training.config import VALIDATION_SEEDS
from etd_ros.recovery.training.sequences import Sequence
from etd_ros.recovery.training.video import video_sequence

SHOWN_SEEDS = 2_000_000
"""Of the scenes for the table; those for choosing are the validation's."""
CLEAR_MIN, SEEN_MIN = 0.85, 0.5
"""So much of a target is seen where it is started, and where it is scored."""
SUCCESS_IOU = 0.5


class PictureFollower(Protocol):
    """A tracker of pictures, as those of `etd_ros.recovery.picture_trackers`."""

    def start(self, picture: Picture, box: Box) -> None: ...

    def update(self, picture: Picture) -> tuple[Box | None, float]: ...


@dataclass(frozen=True, slots=True)
class Following:
    """What became of one target.

    Attributes:
        overlaps: IoU with the truth wherever it can be seen, from the second picture on; 0 without a box.
        seconds: that the tracker took (processor time).
        pictures: that it was shown.
    """

    overlaps: tuple[float, ...]
    seconds: float
    pictures: int


def targets_of(sequence: Sequence) -> Iterator[int]:
    """The targets that can be seen well on the first picture, and often enough after it to be scored."""
    for target, seen in enumerate(sequence.visible.T):
        if seen[0] >= CLEAR_MIN and np.count_nonzero(seen[1:] >= SEEN_MIN) > len(seen) / 2:
            yield target


def follow(tracker: PictureFollower, sequence: Sequence, target: int) -> Following:
    """Start a tracker at the true box on the first picture and show it the others."""
    overlaps = []
    began = time.process_time()
    tracker.start(np.asarray(sequence.images[0]), _box(sequence, target, 0))
    for index in range(1, len(sequence.images)):
        box, _ = tracker.update(np.asarray(sequence.images[index]))
        if sequence.visible[index, target] >= SEEN_MIN:
            overlaps.append(box.iou(_box(sequence, target, index)) if box is not None else 0.0)
    return Following(tuple(overlaps), time.process_time() - began, len(sequence.images) - 1)


def figures(followings: Iterable[Following]) -> tuple[float, float, float]:
    """AP and AR, means over targets of mean IoU and of the share with an IoU of at least 0.5; and ms a picture."""
    followings = list(followings)
    ap = float(np.mean([np.mean(item.overlaps) for item in followings]))
    ar = float(np.mean([np.mean(np.array(item.overlaps) >= SUCCESS_IOU) for item in followings]))
    spent_s = sum(item.seconds for item in followings)
    return ap, ar, 1e3 * spent_s / sum(item.pictures for item in followings)


def followed(make: Callable[[], PictureFollower], sequences: Iterable[Sequence]) -> list[Following]:
    """A new tracker on each target of the sequences."""
    return [follow(make(), sequence, target) for sequence in sequences for target in targets_of(sequence)]


def _box(sequence: Sequence, target: int, index: int) -> Box:
    return Box(*sequence.boxes[index, target].tolist())


def _choices() -> Iterator[Scoring]:
    """What the compact network's scoring was chosen from: the published one, never lost, and one change at a time;
    then what is best of it together, and changes round that. The shipped one is among them."""
    published = COMPACT._replace(
        penalty=VOT.penalty, window_influence=VOT.window_influence, size_rate=VOT.size_rate, lost_score=0, found_score=0
    )
    yield published
    yield published._replace(distractor_weight=0.0)
    for lost, found in ((0.05, 0.2), (0.1, 0.3), (0.2, 0.3)):
        yield published._replace(lost_score=lost, found_score=found)
    yield from (published._replace(window_influence=influence) for influence in (0.1, 0.25, 0.6))
    yield from (published._replace(penalty=penalty) for penalty in (0.15, 0.4, 1.0))
    yield from (published._replace(size_rate=rate) for rate in (0.2, 0.8))
    together = published._replace(window_influence=0.1, lost_score=0.1, found_score=0.3)
    yield together
    yield from (together._replace(window_influence=influence) for influence in (0.05, 0.15))
    yield from (together._replace(lost_score=lost, found_score=found) for lost, found in ((0.1, 0.5), (0.15, 0.3)))
    yield together._replace(penalty=0.15)
    yield together._replace(size_rate=0.6)


def main() -> None:
    """Print the table, or what the scoring was chosen by."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=60, help="how many (default: %(default)s)")
    parser.add_argument("--siamfc-model", default="", help="file of SiamFC's weights; empty: those shipped")
    parser.add_argument("--siamrpn-model", default="", help="file of DaSiamRPN's weights; empty: the compact network's")
    parser.add_argument("--choose", action="store_true", help="weigh scorings of the compact network instead")
    options = parser.parse_args()
    first = VALIDATION_SEEDS if options.choose else SHOWN_SEEDS
    sequences = [video_sequence(seed) for seed in range(first, first + options.scenes)]
    sys.stdout.write("| tracker | AP | AR | ms a picture | targets |\n|-|-|-|-|-|\n")
    for name, make in _makers(options).items():
        followings = followed(make, sequences)
        ap, ar, cost_ms = figures(followings)
        sys.stdout.write(f"| {name} | {ap:.3f} | {ar:.3f} | {cost_ms:.1f} | {len(followings)} |\n")
        sys.stdout.flush()


def _makers(options: argparse.Namespace) -> dict[str, Callable[[], PictureFollower]]:
    """What is compared, by its name in the table."""
    if options.choose:
        network = compact_network("")
        return {_told(scoring): partial(SiamRpnTracker, network, scoring) for scoring in _choices()}
    config = RecoveryConfig(siamfc_model=options.siamfc_model, siamrpn_model=options.siamrpn_model)
    return {
        f"siamfc, {Path(options.siamfc_model).name or 'shipped'}": make_siamfc(config),
        f"dasiamrpn, {Path(options.siamrpn_model).name or 'compact'}": make_siamrpn(config),
    }


def _told(scoring: Scoring) -> str:
    """What can be chosen of a scoring."""
    names = ("penalty", "window_influence", "size_rate", "lost_score", "found_score", "distractor_weight")
    return ", ".join(f"{name} {getattr(scoring, name):g}" for name in names)


if __name__ == "__main__":
    main()
