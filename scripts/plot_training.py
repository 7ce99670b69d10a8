#!/usr/bin/env python3
"""The curves of a training from its log.csv: python scripts/plot_training.py OUT/log.csv docs/training.png"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import matplotlib.pyplot as plt

LOSSES = {
    "score": "score",
    "box": "box (1 - GIoU)",
    "other": "other scenes",
    "validation_loss": "validation, whole loss",
}
SHARES = {
    "validation_overlap": "mean IoU of the likeliest box",
    "validation_found": "found: IoU of at least 0.5; SiamFC: within 2 cells",
    "validation_recall": "the same above 99 % of the windows without target",
}


def main() -> None:
    """Draw losses and validation figures over the steps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("log", type=Path)
    parser.add_argument("picture", type=Path)
    options = parser.parse_args()
    with options.log.open(newline="") as file:
        rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4))
    for axes, curves in ((left, LOSSES), (right, SHARES)):
        # Each network has losses and figures of its own.
        for name in (name for name in curves if name in rows[0]):
            axes.plot([row["step"] for row in rows], [row[name] for row in rows], "o-", ms=3, label=curves[name])
        axes.set(xlabel="step", ylim=(0, None))
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    left.set_ylabel("loss")
    right.set_ylabel("share of validation pairs")
    figure.savefig(options.picture, dpi=120, bbox_inches="tight")


if __name__ == "__main__":
    main()
