"""`track RECORDING`: boxes from a recording, as fast as it goes."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any

import yaml

from etd_ros.commands.progress import with_progress
from etd_ros.commands.recording_options import add_recording_options
from etd_ros.engine import track as track_streams
from etd_ros.evaluation import TracksWriter
from etd_ros.output_files import check_outputs
from etd_ros.overlay import VideoWriter, draw_overlay
from etd_ros.parameters import ParameterError
from etd_ros.recordings import open_recording
from etd_ros.settings import Settings, read_parameter_file, settings_from_mapping
from etd_ros.targets import TargetError, parse_target, targets_from_file, unique_targets
from etd_ros.tracking import METHODS, method_named

VIDEO_FPS = 30.0


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("track", help="track targets through a recording", description=__doc__)
    add_recording_options(parser)
    parser.add_argument("--targets", type=Path, metavar="BOXES.csv", help="targets start at the first row of each name")
    parser.add_argument(
        "--target", action="append", default=[], metavar="NAME:X,Y,W,H[@STAMP_NS]", help="a target (may be repeated)"
    )
    parser.add_argument("--output", type=Path, required=True, metavar="TRACKS.csv", help="where the boxes go")
    parser.add_argument("--method", default="etd", help=f"one of {', '.join(METHODS)} (default: %(default)s)")
    parser.add_argument("--video", type=Path, metavar="V.mp4", help="also write a video of frames, boxes and states")
    parser.add_argument(
        "--config", type=Path, metavar="PARAMETERS.yaml", help="a ROS 2 parameter file, as for the nodes"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="one parameter, e.g. tracking.failure_iou=0.4"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Track, write the tracks (and the video)."""
    method_named(options.method)
    check_outputs(options.output, options.video)
    settings = read_settings(options.config, options.set)
    targets = unique_targets(
        [*(targets_from_file(options.targets) if options.targets else []), *map(parse_target, options.target)]
    )
    if not targets:
        msg = "nothing to track: give --targets BOXES.csv or --target NAME:X,Y,W,H@STAMP_NS"
        raise TargetError(msg)
    with ExitStack() as stack:
        recording = stack.enter_context(open_recording(options.recording, topic=options.topic, size=options.size))
        tracks = stack.enter_context(TracksWriter(options.output))
        video = stack.enter_context(VideoWriter(options.video, VIDEO_FPS)) if options.video else None
        batches = stack.enter_context(with_progress(recording.streams(settings.stream), "tracking"))
        # Its thread ends before the recording that it reads is closed.
        steps = stack.enter_context(closing(track_streams(batches, targets, method=options.method, settings=settings)))
        for step in steps:
            tracks.write_reports(step.frame.stamp_ns, step.reports)
            if video is not None:
                video.write(draw_overlay(step.frame.data, step.reports, image=step.image, stamp_ns=step.frame.stamp_ns))
    return 0


def read_settings(config: Path | None, assignments: Sequence[str]) -> Settings:
    """Settings from a parameter file and `NAME=VALUE` assignments, which win.

    Raises:
        ParameterError: the file or an assignment is wrong.
    """
    values: dict[str, Any] = read_parameter_file(config) if config else {}
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        if not equals:
            msg = f"--set {assignment!r} is not NAME=VALUE, as in tracking.failure_iou=0.4"
            raise ParameterError(msg)
        values[name] = _value(assignment, text)
    return settings_from_mapping(values)


def _value(assignment: str, text: str) -> Any:
    """The value as YAML has it, but 1e-3 is a number here too."""
    try:
        value = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as err:
        msg = f"--set {assignment!r}: {text!r} is no value: give a number, a word or a list as in [1, 2]"
        raise ParameterError(msg) from err
    if isinstance(value, str):
        with suppress(ValueError):
            return float(value)
    return value
