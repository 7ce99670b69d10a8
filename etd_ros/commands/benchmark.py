"""`benchmark`: how fast the parts of this package are, beside other packages that are installed."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from typing import TypeVar

from rich.console import Console

from etd_ros.benchmarking import (
    COMPARED,
    FULL,
    LIVE,
    QUICK,
    RECORDINGS,
    BenchmarkError,
    Effort,
    Report,
    Row,
    as_json,
    check_writable,
    event_path,
    live,
    missing_packages,
    missing_ros,
    print_table,
    scaling,
    scaling_png,
    tracker,
    write,
)
from etd_ros.output_files import check_outputs, check_pictures, write_beside
from etd_ros.plots import check_matplotlib

T = TypeVar("T")

GROUPS: dict[str, Callable[[Effort, Path | None], Iterator[Row]]] = {
    "event-path": event_path,
    "tracker": tracker,
    "live": live,
}
REPORTS: dict[str, Report] = {"event-path": COMPARED, "tracker": COMPARED, "live": LIVE}
DATA_VARIABLE = "ETD_DATA"
DATA_DEFAULT = Path("../shared/data")


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("benchmark", help="measure speed beside other packages", description=__doc__)
    parser.add_argument(
        "groups", nargs="*", type=_group, metavar="GROUP", help=f"what to measure: {', '.join(GROUPS)} (default: all)"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--quick", action="store_true", help="short streams, one round: a trial, not figures")
    parser.add_argument(
        "--data",
        type=Path,
        metavar="FOLDER",
        help=f"folder of real recordings (default: ${DATA_VARIABLE}, else {DATA_DEFAULT} if there)",
    )
    parser.add_argument(
        "--write", type=Path, metavar="FOLDER", help="also write the figures there as JSON and in its README.md"
    )
    parser.add_argument(
        "--scaling", type=Path, metavar="FILE.png", help="draw speed against rate, sensor, texture, messages instead"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Measure and print, or draw.

    Raises:
        BenchmarkError: the folder of recordings is missing, the options contradict each other, or the outputs of
            --write cannot be written.
        OutputError: the plot cannot be written, or its name is not that of a PNG file.
        PlotError: Matplotlib, which the plot needs, is missing.
        RecordingError: a recording is damaged.
    """
    effort = QUICK if options.quick else FULL
    if options.scaling is not None:
        if options.json or options.write is not None or options.groups:
            msg = "--scaling draws curves instead of measuring a table: leave out tables, --json and --write"
            raise BenchmarkError(msg)
        _draw_scaling(options.scaling, effort)
        return 0
    groups = list(dict.fromkeys(options.groups or all_groups()))
    reports = list(dict.fromkeys(REPORTS[group] for group in groups))
    if options.write is not None:
        for report in reports:
            check_writable(options.write, report)
    data = _data(options.data)
    measured: dict[Report, list[Row]] = {report: [] for report in reports}
    for group in groups:
        results = _shown(GROUPS[group](effort, data), lambda row: f"{row.what}, {row.sensor}, {row.stream}")
        measured[REPORTS[group]].extend(results)
    if options.write is not None:
        for report in reports:
            write(options.write, report, measured[report])
    rows = list(chain.from_iterable(measured.values()))
    if options.json:
        sys.stdout.write(as_json(rows))
    else:
        print_table(rows, Console())
    missing = missing_packages()
    if missing and COMPARED in reports:
        print(f"not installed, so not compared: {', '.join(missing)}; get them with: make bench", file=sys.stderr)
    return 0


def _draw_scaling(path: Path, effort: Effort) -> None:
    check_matplotlib()
    check_outputs(path)
    check_pictures(path)
    points = list(_shown(scaling(effort.events, effort.rounds), lambda point: f"{point.axis}, {point.part}"))
    write_beside(path, scaling_png(points))


def all_groups() -> Iterator[str]:
    """Every group that can be measured here."""
    missing = missing_ros()
    for group in GROUPS:
        if group == "live" and missing is not None:
            print(f"live is not measured: it needs ROS 2, and {missing} cannot be imported", file=sys.stderr)
        else:
            yield group


def _group(text: str) -> str:
    if text not in GROUPS:
        msg = f"{text!r} is no group of figures: choose of {', '.join(GROUPS)}"
        raise argparse.ArgumentTypeError(msg)
    return text


def _data(folder: Path | None) -> Path | None:
    """The folder of recordings: the one named, the environment's, or the default one where it is there.

    Raises:
        BenchmarkError: the folder named is none, or has no recording that is measured.
    """
    named = folder or (Path(os.environ[DATA_VARIABLE]) if os.environ.get(DATA_VARIABLE) else None)
    if named is not None and not named.is_dir():
        msg = f"{named}: no such folder of recordings: name another with --data or {DATA_VARIABLE}"
        raise BenchmarkError(msg)
    if named is not None and not any((named / path).exists() for path in RECORDINGS.values()):
        msg = f"{named} holds none of the recordings that are measured: it lacks {', '.join(RECORDINGS.values())}"
        raise BenchmarkError(msg)
    return named or (DATA_DEFAULT if DATA_DEFAULT.is_dir() else None)


def _shown(results: Iterator[T], describe: Callable[[T], str]) -> Iterator[T]:
    """The results as they come, with a line on standard error that says how far the measurement is."""
    with Console(stderr=True).status("measuring ...") as status:
        for result in results:
            status.update(f"measured {describe(result)}")
            yield result
