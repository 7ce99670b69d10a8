#!/usr/bin/env python3
"""Recovery trackers side by side on simulated losses that training never saw: the table and the curve of
docs/training.md. How to run it stands there."""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import torch
from rich.progress import track

from etd_ros.boxes import iou
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
from etd_ros.recovery.training.episodes import Episode, episodes
from etd_ros.recovery.weights_file import SHIPPED, save_compact

CHOOSING_SEED, REPORTING_SEED = 50_000, 60_000
"""The operating point is chosen on losses from the first seed on, its figures are those of others."""
UNTRAINED = "compact before training"
THRESHOLDS = (0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8)
AGREEING = (1, 2, 3)
FOCUS_SCORE_MIN = 0.25
"""While the curve's searches are recorded, places of a larger score are looked at again on the next image."""


def main() -> None:
    """Print the table, or draw the curve."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=60, help="simulated sequences (default: %(default)s)")
    parser.add_argument("--trackers", default=f"{UNTRAINED},compact,csrt,kcf", help="default: %(default)s")
    parser.add_argument("--weights", default=str(SHIPPED), help="of the compact network; default: those shipped")
    parser.add_argument("--curve", type=Path, help="draw right against wrong recoveries over the thresholds (PNG)")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    config = RecoveryConfig(compact_model=options.weights)
    if options.curve:
        draw_curve(options.curve, losses(options.seeds, CHOOSING_SEED), config)
        return
    shown = losses(options.seeds, REPORTING_SEED)
    rows = [row(name, maker(name, config), shown) for name in options.trackers.split(",")]
    print(table(rows))


def losses(seeds: int, first_seed: int) -> list[Episode]:
    """The episodes of some seeds."""
    return [
        episode
        for seed in track(range(first_seed, first_seed + seeds), "simulating")
        for episode in episodes(1, first_seed=seed)
    ]


def maker(name: str, config: RecoveryConfig) -> Callable[[], RecoveryTracker]:
    """Makes trackers of a name; before training, the network has the random weights that training starts from."""
    if name != UNTRAINED:
        return make_recovery(dataclasses.replace(config, tracker=name))
    torch.manual_seed(0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "untrained.safetensors")
        save_compact(Compact(), path, {})
        return make_recovery(dataclasses.replace(config, tracker="compact", compact_model=str(path)))


def row(name: str, make_tracker: Callable[[], RecoveryTracker], shown: Sequence[Episode]) -> Row:
    """A tracker's figures on all episodes."""
    return row_of(name, [outcome_of(make_tracker, episode) for episode in track(shown, name)])


def draw_curve(path: Path, shown: Sequence[Episode], config: RecoveryConfig) -> None:
    """Share of losses recovered rightly against the share of episodes with a wrong recovery, and print the points."""
    import matplotlib.pyplot as plt

    never = dataclasses.replace(config, tracker="compact", network_score_min=FOCUS_SCORE_MIN, network_agreeing=100)
    make_tracker = make_recovery(never)
    traces = [trace_of(make_tracker, episode) for episode in track(shown, "searching")]
    figure, axes = plt.subplots(figsize=(6.4, 4.8))
    for agreeing in AGREEING:
        ends = [[end_of(trace, score, config.network_margin_min, agreeing) for trace in traces] for score in THRESHOLDS]
        shares = [(wrong_share(answers), recovered_share(answers, shown)) for answers in ends]
        for score, (wrong, recovered) in zip(THRESHOLDS, shares, strict=True):
            print(f"{agreeing} agreeing, score {score:g}: recovered {recovered:.3f}, wrong {wrong:.3f}")
            axes.annotate(f"{score:g}", (wrong, recovered), fontsize=6, xytext=(2, 2), textcoords="offset points")
        axes.plot(*zip(*shares, strict=True), "o-", ms=4, label=f"compact, {agreeing} successive images agree")
    for name in ("csrt", "kcf"):
        answers = [outcome_of(maker(name, config), episode).end for episode in track(shown, name)]
        wrong, recovered = wrong_share(answers), recovered_share(answers, shown)
        axes.plot(wrong, recovered, "x", label=f"{name}, score_min {config.score_min:g}")
    axes.set(xlabel="episodes with a wrong recovery", ylabel="losses recovered", xlim=(-0.01, None), ylim=(0, 1))
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=120, bbox_inches="tight")


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


def end_of(trace: Sequence[tuple[Candidate | None, bool]], score: float, margin: float, agreeing: int) -> End:
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


def wrong_share(ends: Sequence[End]) -> float:
    """Of all episodes, those in which something else was taken for the target."""
    return float(np.mean([end is End.WRONG for end in ends]))


def recovered_share(ends: Sequence[End], shown: Sequence[Episode]) -> float:
    """Of the episodes in which the target comes back, those in which it was found rightly."""
    return float(np.mean([end is End.RIGHT for end, episode in zip(ends, shown, strict=True) if episode.returns]))


if __name__ == "__main__":
    main()
