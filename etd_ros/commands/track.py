"""`track RECORDING`: boxes from a recording, as fast as it goes."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection, Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from pathlib import Path
from typing import Any

import yaml

from etd_ros.commands.progress import with_compile_notice
from etd_ros.commands.recording_options import add_recording_options
from etd_ros.commands.tracking_steps import TrackedStep, compared_steps, engine_steps
from etd_ros.evaluation import EvaluationError, TracksWriter, read_boxes, read_tracks
from etd_ros.evaluation.matching import Truth, matched_overlaps
from etd_ros.evaluation.overlaps import TargetOverlap
from etd_ros.output_files import check_outputs, check_pictures, write_beside
from etd_ros.overlay import OverlayError
from etd_ros.parameters import ParameterError
from etd_ros.plots import check_matplotlib, overlap_png
from etd_ros.recordings import open_recording, recording_files
from etd_ros.rerun_log import SPAWN, check_rerun, rerun_log
from etd_ros.settings import Settings, read_parameter_file, settings_from_mapping
from etd_ros.systems.interface import CompareError
from etd_ros.systems.registry import SYSTEMS, system_named
from etd_ros.targets import (
    TargetError,
    TargetStart,
    late_starts,
    parse_click,
    parse_target,
    targets_from_file,
    unique_targets,
)
from etd_ros.tracking import DEFAULT_METHOD, METHODS, Click
from etd_ros.tracking_video import FPS, TrackingVideo, tracking_video

PROPOSERS = ", ".join(name for name, method in METHODS.items() if not method.contours)


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("track", help="track targets through a recording", description=__doc__)
    add_recording_options(parser)
    parser.add_argument("--targets", type=Path, metavar="BOXES.csv", help="targets start at the first row of each name")
    parser.add_argument(
        "--target",
        action="append",
        default=[],
        metavar="NAME:X,Y,W,H[@STAMP_NS][=CLASS]",
        help="a target (may be repeated)",
    )
    parser.add_argument(
        "--click", action="append", default=[], metavar="NAME:X,Y[@STAMP_NS]", help="the object there (may be repeated)"
    )
    parser.add_argument("--auto", action="store_true", help="moving objects become targets auto_1, auto_2, ...")
    parser.add_argument("--output", type=Path, required=True, metavar="TRACKS.csv", help="where the boxes go")
    parser.add_argument("--method", default=DEFAULT_METHOD, help=f"one of {', '.join(SYSTEMS)} (default: %(default)s)")
    parser.add_argument(
        "--video",
        type=Path,
        metavar="V.mp4",
        help=f"also write a video of frames, boxes and states: {FPS} pictures/s in real time, each of the newest frame",
    )
    parser.add_argument("--slow", type=float, default=1.0, metavar="FACTOR", help="slow the video (default: 1)")
    parser.add_argument(
        "--proposals", action="store_true", help=f"draw proposals into the video (of {PROPOSERS}; others make none)"
    )
    parser.add_argument("--truth", type=Path, metavar="BOXES.csv", help="draw these boxes into the video, in grey")
    parser.add_argument(
        "--plot",
        type=Path,
        metavar="P.png",
        help="plot the overlap over time with the boxes of --truth, or those of --targets at later times; targets of "
        "other names, as auto_1, are held against the labelled ones that they overlap most",
    )
    parser.add_argument(
        "--rerun",
        nargs="?",
        const=SPAWN,
        metavar="FILE.rrd",
        help="also log to the Rerun viewer: to one that is started for it, to this file, or to the viewer at an "
        "address (rerun+http://HOST:9876/proxy)",
    )
    parser.add_argument(
        "--config", type=Path, metavar="PARAMETERS.yaml", help="a ROS 2 parameter file, as for the nodes"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="one parameter, e.g. tracking.failure_iou=0.4"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Track, write the tracks (and the video, the plot and the log)."""
    is_engines = system_named(options.method).feed == "engine"
    if not is_engines:
        _check_compared(options)
    inputs = (*recording_files(options.recording), options.targets, options.truth, options.config)
    check_outputs(options.output, options.video, options.plot, inputs=inputs)
    check_pictures(options.plot)
    if options.rerun is not None:
        check_rerun(options.rerun)
    if options.plot is not None:
        check_matplotlib()
    if options.video is None and (options.proposals or options.slow != 1):
        msg = "--proposals and --slow say how the video looks, but there is none: give --video V.mp4 too"
        raise OverlayError(msg)
    truth = read_boxes(options.truth) if options.truth else None
    settings = read_settings(options.config, options.set)
    targets = unique_targets(
        [*(targets_from_file(options.targets) if options.targets else []), *map(parse_target, options.target)]
    )
    clicks = [parse_click(text) for text in options.click]
    if not targets and not clicks and not options.auto:
        msg = (
            "nothing to track: give --targets BOXES.csv, --target NAME:X,Y,W,H@STAMP_NS, --click NAME:X,Y@STAMP_NS "
            "or --auto"
        )
        raise TargetError(msg)
    names = {target.name for target in targets}
    plotted = _plotted_truth(options, names) if options.plot else None
    _tell_no_proposals(options)
    with ExitStack() as stack:
        stack.enter_context(with_compile_notice())
        recording = stack.enter_context(open_recording(options.recording, topic=options.topic, size=options.size))
        tracks = stack.enter_context(TracksWriter(options.output))
        video = stack.enter_context(_video(options, truth)) if options.video else None
        log = stack.enter_context(rerun_log(options.rerun)) if options.rerun is not None else None
        # Its thread ends before the recording that it reads is closed.
        steps = stack.enter_context(
            engine_steps(
                recording,
                targets,
                clicks,
                auto=options.auto,
                method=options.method,
                settings=settings,
                searches=video is not None,
            )
            if is_engines
            else compared_steps(recording, targets, options.method, settings)
        )
        last_step = None
        for step in steps:
            last_step = step
            tracks.write_reports(step.stamp_ns, step.reports)
            for notice in step.notices:
                print(notice, file=sys.stderr)
            if video is not None:
                video.add(step.stamp_ns, step.picture, step.reports, step.image)
            if log is not None:
                log.add(step.stamp_ns, step.picture, step.reports, step.image, step.nzge)
        if last_step is not None:
            _tell_late([*targets, *clicks], last_step.stamp_ns, is_auto=options.auto)
            _tell_in_vain(clicks, last_step)
    if plotted is not None:
        of_targets = _plotted_overlaps(options, plotted, names)
        write_beside(options.plot, overlap_png(of_targets, f"{options.recording.name}, {options.method}"))
    return 0


def _tell_no_proposals(options: argparse.Namespace) -> None:
    """Say that the method makes none of the proposals that are to be drawn."""
    if options.proposals and METHODS[options.method].contours:
        print(
            f"--proposals: {options.method!r} makes no proposals, so none are drawn: choose one of {PROPOSERS}",
            file=sys.stderr,
        )


def _tell_late(starts: Sequence[TargetStart | Click], last_frame_ns: int, *, is_auto: bool) -> None:
    """Say which targets start after the last frame (ns).

    Raises:
        TargetError: all do, so that nothing was tracked.
    """
    late = late_starts(starts, last_frame_ns)
    if late and len(late) == len(starts) and not is_auto:
        raise TargetError(late[0])
    for line in late:
        print(line, file=sys.stderr)


def _tell_in_vain(clicks: Sequence[Click], last_step: TrackedStep) -> None:
    """Say for which clicks nothing was found until the last step, which came before their time to wait was over."""
    for click in clicks:
        if click.name in last_step.waiting_clicks and click.stamp_ns <= last_step.stamp_ns:
            print(click.in_vain(), file=sys.stderr)


def _check_compared(options: argparse.Namespace) -> None:
    """Refuse what only the engine's methods offer.

    Raises:
        CompareError: an option asks for it.
    """
    asked = [("--auto", options.auto), ("--click", options.click)]
    if any(is_asked for _, is_asked in asked):
        names = " and ".join(name for name, is_asked in asked if is_asked)
        msg = f"system {options.method!r} starts from boxes only: give --targets or --target instead of {names}"
        raise CompareError(msg)
    asked = [("--proposals", options.proposals), ("--rerun", options.rerun is not None)]
    for name, is_asked in asked:
        if is_asked:
            msg = (
                f"system {options.method!r} has nothing to show for {name}: leave it out, or choose one of our methods"
            )
            raise CompareError(msg)


def _video(options: argparse.Namespace, truth: Truth | None) -> AbstractContextManager[TrackingVideo]:
    return tracking_video(options.video, slow=options.slow, proposals=options.proposals, truth=truth)


def _plotted_truth(options: argparse.Namespace, names: Collection[str]) -> Truth:
    """The labels of all targets, some of them after the start of one that is tracked or may be matched with a track.

    Raises:
        EvaluationError: there are none.
    """
    file = options.truth or options.targets
    truth = read_boxes(file) if file else {}
    labelled = {name for name, labels in truth.items() if len(labels) > 1}
    may_match = options.auto or options.click or not truth.keys() >= set(names)
    if not (labelled if may_match else labelled.intersection(names)):
        msg = (
            f"{file or '--plot'}: no target has boxes to be held against: give --truth BOXES.csv with boxes of the "
            "targets at several times"
        )
        raise EvaluationError(msg)
    return truth


def _plotted_overlaps(options: argparse.Namespace, truth: Truth, names: Collection[str]) -> dict[str, TargetOverlap]:
    """How the written tracks overlap with the labels: of the targets that were given by these names, and of those that
    a track is matched with; with `--auto` of all, as whatever moves was to be found. A track whose own target has one
    label only is not matched with another's.

    Raises:
        EvaluationError: no track is of a labelled target.
    """
    labelled = {name: labels for name, labels in truth.items() if len(labels) > 1}
    tracks = read_tracks(options.output)
    judged = {name: rows for name, rows in tracks.items() if name in labelled or name not in truth}
    of_all = matched_overlaps(judged, labelled)
    of_tracked = {name: of for name, of in of_all.items() if of.matched or name in tracks or name in names}
    if not of_tracked:
        msg = (
            f"{options.truth or options.targets}: no tracked target has boxes to be held against, by its name or by "
            f"overlap ({options.output} is written, {options.plot} is not): give the boxes of the same recording, on "
            "the same clock"
        )
        raise EvaluationError(msg)
    return of_all if options.auto else of_tracked


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
