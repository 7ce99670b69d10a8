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

from etd_ros.recovery import RecoveryConfig, RecoveryTracker, make_recovery
from etd_ros.recovery.compact import Compact
from etd_ros.recovery.training.comparison import Row, outcome_of, row_of, table
from etd_ros.recovery.training.episodes import Episode, episodes
from etd_ros.recovery.weights_file import save_compact

CHOOSING_SEED, REPORTING_SEED = 50_000, 60_000
"""The operating point is chosen on losses from the first seed on, its figures are those of others."""
UNTRAINED = "compact before training"
THRESHOLDS = (0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8)
AGREEING = (1, 2, 3)


def main() -> None:
    """Print the table, or draw the curve."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=60, help="simulated sequences (default: %(default)s)")
    parser.add_argument("--trackers", default=f"{UNTRAINED},compact,csrt,kcf", help="default: %(default)s")
    parser.add_argument("--weights", default="", help="of the compact network; default: those shipped")
    parser.add_argument("--curve", type=Path, help="draw right against wrong recoveries over the thresholds (PNG)")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
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

    figure, axes = plt.subplots(figsize=(6.4, 4.8))
    for agreeing in AGREEING:
        rows = []
        for threshold in THRESHOLDS:
            changed = dataclasses.replace(config, network_score_min=threshold, network_agreeing=agreeing)
            rows.append(row(f"{agreeing} agreeing, {threshold:g}", maker("compact", changed), shown))
            print(f"{agreeing} agreeing, score {threshold:g}: {rows[-1]}", flush=True)
        wrong = [share_wrong(item) for item in rows]
        axes.plot(wrong, [item.recovered for item in rows], "o-", ms=4, label=f"{agreeing} successive images agree")
        for x, item, threshold in zip(wrong, rows, THRESHOLDS, strict=True):
            axes.annotate(f"{threshold:g}", (x, item.recovered), fontsize=6, xytext=(2, 2), textcoords="offset points")
    for name in ("csrt", "kcf"):
        item = row(name, maker(name, config), shown)
        axes.plot(share_wrong(item), item.recovered, "x", label=f"{name}, score_min {config.score_min:g}")
    axes.set(xlabel="episodes with a wrong recovery", ylabel="losses recovered", xlim=(-0.01, None), ylim=(0, 1))
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=120, bbox_inches="tight")


def share_wrong(item: Row) -> float:
    """Of all episodes, those in which something else was taken for the target."""
    return float(np.average([item.wrong, item.false], weights=[item.losses, item.gone]))


if __name__ == "__main__":
    main()
