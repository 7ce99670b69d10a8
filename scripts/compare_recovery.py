#!/usr/bin/env python3
"""Recovery trackers side by side on simulated losses that training never saw: the table and the operating point of
docs/training.md. How to run it stands there."""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import tempfile
from collections import deque
from collections.abc import Callable, Iterator
from collections.abc import Sequence as Items
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import torch
from rich.progress import track

from etd_ros.boxes import iou
from etd_ros.commands.track import read_settings
from etd_ros.errors import EtdError
from etd_ros.evaluation import read_boxes
from etd_ros.reconstruction import HighPassFilter
from etd_ros.recordings import open_recording
from etd_ros.recovery import RecoveryConfig, RecoveryTracker, make_recovery
from etd_ros.recovery.compact import Compact
from etd_ros.recovery.siamese import SAME_PLACE_IOU, Candidate, SiameseRecovery
from etd_ros.recovery.training.comparison import (
    End,
    Row,
    is_right,
    outcome_of,
    row_of,
    searched_images,
    show_before_loss,
    table,
)
from etd_ros.recovery.training.episodes import IMAGES_MIN, Episode, episodes
from etd_ros.recovery.training.sequences import Sequence
from etd_ros.recovery.weights_file import SHIPPED, save_compact

CHOOSING_SEED, REPORTING_SEED = 50_000, 60_000
"""The operating point is chosen on losses from the first seed on, its figures are those of others."""
UNTRAINED = "compact before training"
THRESHOLDS = (0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8)
MARGINS = (0.0, 0.1, 0.2, 0.3, 0.4)
AGREEING = (1, 2, 3, 4, 5)
LOST_AT, GAP_IMAGES, GONE_IMAGES = (0.3, 0.45, 0.6), (5, 20, 60), 50
"""On recordings: after these shares of the labels, for so many images, and how long after the last label."""
IMAGE_NS = 10_000_000
WRONG_COST = 4.0
"""A wrong recovery undoes so many right ones."""
SHOWN_POINTS = 3
FOCUS_SCORE_MIN = 0.25
"""While searches are recorded, places of a larger score are looked at again on the next image."""


def main() -> None:
    """Print the table, or the operating points."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=60, help="simulated sequences (default: %(default)s)")
    parser.add_argument("--trackers", default=f"{UNTRAINED},compact,csrt,kcf", help="default: %(default)s")
    parser.add_argument("--weights", default=str(SHIPPED), help="of the compact network; default: those shipped")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="e.g. recovery.vit_model=FILE")
    parser.add_argument("--recording", type=Path, help="losses on a labelled recording instead of simulated ones")
    parser.add_argument("--boxes", type=Path, help="its labels (target,stamp_ns,x,y,w,h)")
    parser.add_argument("--choose", action="store_true", help="print the compact network's best operating points")
    try:
        compare(parser.parse_args())
    except EtdError as error:
        parser.error(str(error))


def compare(options: argparse.Namespace) -> None:
    """The same of what was asked for.

    Raises:
        EtdError: what was asked for cannot be made or read.
    """
    cv2.setNumThreads(1)
    config = dataclasses.replace(read_settings(None, options.set).recovery, compact_model=options.weights)
    if options.choose:
        print(operating_points(losses(options.seeds, CHOOSING_SEED), config))
        return
    makers = {name: maker(name, config) for name in options.trackers.split(",")}
    shown = (
        recorded_losses(options.recording, options.boxes)
        if options.recording
        else losses(options.seeds, REPORTING_SEED)
    )
    print(table([row(name, make_tracker, shown) for name, make_tracker in makers.items()]))


def losses(seeds: int, first_seed: int) -> list[Episode]:
    """The episodes of some seeds."""
    return [
        episode
        for seed in track(range(first_seed, first_seed + seeds), "simulating")
        for episode in episodes(1, first_seed=seed)
    ]


def recorded_losses(recording: Path, boxes: Path) -> list[Episode]:
    """Of each labelled target: losses in the course of its labels, and one where its labels end for good."""
    labels = read_boxes(boxes)
    first_ns = min(rows[0].stamp_ns for rows in labels.values())
    last_ns = max(rows[-1].stamp_ns for rows in labels.values())
    stamps_ns = np.arange(first_ns, last_ns, IMAGE_NS)
    images = np.array(list(images_at(recording, stamps_ns.tolist())))
    stamps_s = np.asarray(1e-9 * (stamps_ns - first_ns), np.float64)
    episodes_of = []
    for name, rows in labels.items():
        labelled_ns = [row.stamp_ns for row in rows]
        sides = [np.interp(stamps_ns, labelled_ns, values) for values in zip(*(row.box for row in rows), strict=True)]
        is_labelled = (stamps_ns >= labelled_ns[0]) & (stamps_ns <= labelled_ns[-1])
        sequence = Sequence(
            images,
            stamps_s,
            np.stack(sides, -1)[:, None].astype(np.float32),
            is_labelled[:, None].astype(np.float32),
        )
        start, *_, end = np.flatnonzero(is_labelled).tolist()
        for share, gap in itertools.product(LOST_AT, GAP_IMAGES):
            lost = start + int(share * (end + 1 - start))
            if lost + gap + IMAGES_MIN < end:
                episodes_of.append(Episode(f"{name} {gap}", sequence, 0, lost, lost + gap, True))
        if end + GONE_IMAGES + IMAGES_MIN < len(images):
            episodes_of.append(Episode(f"{name} gone", sequence, 0, end, end + GONE_IMAGES, False))
    return episodes_of


def images_at(path: Path, stamps_ns: list[int]) -> Iterator[npt.NDArray[np.uint8]]:
    """The images of a recording at stamps that it reaches."""
    waiting, high_pass = deque(stamps_ns), None
    with open_recording(path) as recording:
        for batch in recording.streams():
            events = batch.events
            if high_pass is None:
                high_pass = HighPassFilter(events.width, events.height)
            while waiting and len(events) and events.t[-1] >= waiting[0]:
                before = int(np.searchsorted(events.t, waiting[0]))
                high_pass.integrate(events[:before])
                events = events[before:]
                yield high_pass.image(waiting.popleft()).copy()
            high_pass.integrate(events)


def maker(name: str, config: RecoveryConfig) -> Callable[[], RecoveryTracker]:
    """Makes trackers of a name; before training, the network has the random weights that training starts from."""
    if name != UNTRAINED:
        return make_recovery(dataclasses.replace(config, tracker=name))
    torch.manual_seed(0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "untrained.safetensors")
        save_compact(Compact(), path, {})
        return make_recovery(dataclasses.replace(config, tracker="compact", compact_model=str(path)))


def row(name: str, make_tracker: Callable[[], RecoveryTracker], shown: Items[Episode]) -> Row:
    """A tracker's figures on all episodes."""
    return row_of(name, [outcome_of(make_tracker, episode) for episode in track(shown, name)])


def operating_points(shown: Items[Episode], config: RecoveryConfig) -> str:
    """The points of the largest worth for each number of images that have to agree, as a Markdown table."""
    never = dataclasses.replace(config, tracker="compact", network_score_min=FOCUS_SCORE_MIN, network_agreeing=100)
    make_tracker = make_recovery(never)
    traces = [trace_of(make_tracker, episode) for episode in track(shown, "searching")]
    lines = ["| images agree | score | margin | recovered | wrong | false when gone | worth |", "|-|-|-|-|-|-|-|"]
    for agreeing in AGREEING:
        points = []
        for score, margin in itertools.product(THRESHOLDS, MARGINS):
            ends = [end_of(trace, score, margin, agreeing) for trace in traces]
            recovered, wrong, false = shares(ends, shown)
            points.append((recovered - WRONG_COST * (wrong + false) / 2, score, margin, recovered, wrong, false))
        for worth, score, margin, recovered, wrong, false in sorted(points, reverse=True)[:SHOWN_POINTS]:
            lines.append(
                f"| {agreeing} | {score:g} | {margin:g} | {recovered:.1%} | {wrong:.1%} | {false:.1%} | {worth:.3f} |"
            )
    return "\n".join(lines)


def trace_of(make_tracker: Callable[[], RecoveryTracker], episode: Episode) -> list[tuple[Candidate | None, bool]]:
    """The likeliest place of each search, and whether it is right, from a tracker that never believes itself."""
    tracker = make_tracker()
    assert isinstance(tracker, SiameseRecovery)
    show_before_loss(tracker, episode)
    trace = []
    for index, image in searched_images(episode):
        tracker.search(image, episode.last_box)
        trace.append((tracker.latest, tracker.latest is not None and is_right(tracker.latest.box, episode, index)))
    return trace


def end_of(trace: Items[tuple[Candidate | None, bool]], score: float, margin: float, agreeing: int) -> End:
    """How an episode would have ended with these limits, but for where a place found once is looked at again."""
    before: Candidate | None = None
    count = 0
    for candidate, right in trace:
        if candidate is None or candidate.score < score or candidate.margin < margin:
            before, count = None, 0
            continue
        is_same = before is not None and iou(np.array([candidate.box]), before.box)[0] >= SAME_PLACE_IOU
        before, count = candidate, count + 1 if is_same else 1
        if count == agreeing:
            return End.RIGHT if right else End.WRONG
    return End.NOT_FOUND


def shares(ends: Items[End], shown: Items[Episode]) -> tuple[float, float, float]:
    """Of the episodes in which the target comes back, those in which it was found rightly and those in which something
    else was taken for it; and those of the others in which anything was."""
    back = [end for end, episode in zip(ends, shown, strict=True) if episode.returns]
    gone = [end for end, episode in zip(ends, shown, strict=True) if not episode.returns]
    wrong, false = (float(np.mean([end is End.WRONG for end in part])) for part in (back, gone))
    return float(np.mean([end is End.RIGHT for end in back])), wrong, false


if __name__ == "__main__":
    main()
