"""`plot TRACKS.csv BOXES.csv`: how tracks overlap with the truth over time."""

from __future__ import annotations

import argparse
from pathlib import Path

from etd_ros.evaluation import read_boxes, read_tracks
from etd_ros.evaluation.overlaps import overlaps
from etd_ros.output_files import check_outputs, write_beside
from etd_ros.plots import check_matplotlib, overlap_png


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("plot", help="overlap of tracks with the truth over time", description=__doc__)
    parser.add_argument("tracks", type=Path, metavar="TRACKS.csv", help="what `track` has written")
    parser.add_argument("boxes", type=Path, metavar="BOXES.csv", help="the labelled boxes")
    parser.add_argument("--output", type=Path, required=True, metavar="PLOT.png", help="a panel for each target")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Draw, and print the scores.

    Raises:
        EvaluationError: a file cannot be read, or there is nothing to score.
        PlotError: Matplotlib is missing, or there are too many targets.
        OutputError: the plot cannot be written.
    """
    check_outputs(options.output, inputs=(options.tracks, options.boxes))
    check_matplotlib()
    of_targets = overlaps(read_tracks(options.tracks), read_boxes(options.boxes))
    write_beside(options.output, overlap_png(of_targets, options.tracks.name))
    for name, overlap in of_targets.items():
        print(f"{name}: AP {overlap.score.ap:.3f}, AR {overlap.score.ar:.3f} at {overlap.score.n} labelled times")
    return 0
