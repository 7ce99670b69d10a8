"""`plot TRACKS.csv BOXES.csv`: how tracks overlap with the truth over time."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Sequence
from pathlib import Path

from etd_ros.evaluation import EvaluationError, TimedBox, TrackRow, read_boxes, read_tracks
from etd_ros.evaluation.matching import Tracks, Truth, matched_overlaps
from etd_ros.output_files import check_outputs, check_pictures, write_beside
from etd_ros.plots import check_matplotlib, overlap_png

NAMES_MAX = 5


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
        OutputError: the plot cannot be written, or its name is not that of a PNG file.
    """
    check_outputs(options.output, inputs=(options.tracks, options.boxes))
    check_pictures(options.output)
    check_matplotlib()
    tracks, truth = read_tracks(options.tracks), read_boxes(options.boxes)
    of_targets = matched_overlaps(tracks, truth)
    if not any(overlap.matched for overlap in of_targets.values()):
        _check_comparable(options, tracks, truth)
    write_beside(options.output, overlap_png(of_targets, options.tracks.name))
    for name, overlap in of_targets.items():
        of_target = overlap.score
        print(f"{overlap.heading(name)}: AP {of_target.ap:.3f}, AR {of_target.ar:.3f} at {of_target.n} labelled times")
    return 0


def _check_comparable(options: argparse.Namespace, tracks: Tracks, truth: Truth) -> None:
    """Refuse files of two recordings, whose score would be 0 without a word.

    Raises:
        EvaluationError: they name no target in common, or are of times that do not overlap. Not to be asked where
            tracks of other names overlap with the boxes.
    """
    common = tracks.keys() & truth.keys()
    if not common:
        msg = (
            f"{options.tracks} and {options.boxes} name no target in common ({_some(tracks)}; {_some(truth)}), and no "
            "boxes of theirs overlap: give the boxes of the same recording, on the same clock"
        )
        raise EvaluationError(msg)
    if not any(_meet(tracks[name], truth[name]) for name in common):
        name = min(common)
        msg = (
            f"{options.tracks} and {options.boxes} have no time in common ({name} from {tracks[name][0].stamp_ns} ns, "
            f"and from {truth[name][0].stamp_ns} ns): give the boxes of the same recording, on the same clock"
        )
        raise EvaluationError(msg)


def _meet(track: Sequence[TrackRow], labels: Sequence[TimedBox]) -> bool:
    return track[0].stamp_ns <= labels[-1].stamp_ns and labels[0].stamp_ns <= track[-1].stamp_ns


def _some(names: Collection[str]) -> str:
    """The first names, as many as a line can hold."""
    return ", ".join([*list(names)[:NAMES_MAX], *(["..."] if len(names) > NAMES_MAX else [])]) or "none"
