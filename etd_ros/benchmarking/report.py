"""Rows of figures, as a table, as JSON, and as Markdown."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from itertools import compress
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from etd_ros.benchmarking.peers import PACKAGES
from etd_ros.benchmarking.streams import BenchmarkError
from etd_ros.output_files import write_beside

README_NAME = "README.md"
TABLE_START, TABLE_END = "<!-- table: written by the benchmark -->", "<!-- end of table -->"
LIVE_START, LIVE_END = "<!-- live table: written by the benchmark -->", "<!-- end of live table -->"
PACKAGES_USED = ("numpy", "numba", "opencv-contrib-python-headless", *PACKAGES.values())

HEADINGS = ("what", "sensor", "stream", "ours", "unit", "peer", "peer's", "ratio", "spread", "frames/s", "ev/frame")
WIDTH_MAX = 1000
"""Of a table, in characters: more than any has."""
LEFT_ALIGNED = ("what", "sensor", "stream", "unit", "peer")


@dataclass(frozen=True)
class Row:
    """One figure, beside a peer's where there is one.

    Attributes:
        what: the part of the event path.
        sensor: WIDTHxHEIGHT.
        value: our figure, the median over the rounds.
        unit: Mev/s, ms, ...
        peer: what it is held against; None if nothing is.
        peer_value: the peer's figure in the same unit.
        ratio: how many times as fast as the peer we are, the median over pairs of runs.
        stream: what was measured on.
        spread: interquartile range over median of our times; None of what was measured once.
        frames_per_s: frames made per second of computing; None where none are made.
        events_per_frame: their mean; None where none are made.
    """

    what: str
    sensor: str
    value: float
    unit: str
    peer: str | None
    peer_value: float | None
    ratio: float | None
    stream: str
    spread: float | None
    frames_per_s: float | None = None
    events_per_frame: float | None = None


@dataclass(frozen=True)
class Report:
    """Where figures are written in a folder: those of some groups are replaced without those of the others.

    Attributes:
        json_name: file of the JSON object.
        start, end: lines in README.md between which the table stands.
    """

    json_name: str
    start: str
    end: str


COMPARED = Report("last.json", TABLE_START, TABLE_END)
"""Of the parts, beside other packages."""

LIVE = Report("live.json", LIVE_START, LIVE_END)
"""Of the live node, which is measured in an environment with ROS."""


def table(rows: Sequence[Row]) -> Table:
    """The rows for a terminal, without columns that none fills."""
    of_rows = [_cells(row) for row in rows]
    filled = [any(cells[column] for cells in of_rows) for column in range(len(HEADINGS))]
    shown = Table(title="figures")
    for heading in compress(HEADINGS, filled):
        shown.add_column(heading, justify="left" if heading in LEFT_ALIGNED else "right", no_wrap=True)
    previous: tuple[str, ...] = ()
    for cells in of_rows:
        is_new_part = bool(previous) and cells[0] != previous[0]
        if is_new_part:
            shown.add_section()
        # What is the same as in the row above is left out: the peers stand out.
        same = 0 if is_new_part or not previous else next((i for i in range(3) if cells[i] != previous[i]), 3)
        shown.add_row(*compress([*[""] * same, *cells[same:]], filled))
        previous = cells
    return shown


def print_table(rows: Sequence[Row], console: Console) -> None:
    """Print the rows as wide as they are: names that are cut would not be told apart."""
    shown = table(rows)
    needed = Measurement.get(console, console.options.update(width=WIDTH_MAX), shown).maximum
    console.width = max(console.width, needed)
    console.print(shown)


def as_json(rows: Sequence[Row]) -> str:
    """The rows, and what they were measured with, as one JSON object."""
    return json.dumps({"rows": [asdict(row) for row in rows], "machine": machine()}, indent=2) + "\n"


def markdown(rows: Sequence[Row]) -> str:
    """The rows as a Markdown table, after a line on what they were measured with; without columns that none fills."""
    facts = machine()
    versions = ", ".join(f"{name} {version}" for name, version in facts["packages"].items())
    columns = [column for column in zip(HEADINGS, *map(_cells, rows), strict=True) if any(column[1:])]
    headings, *cells = zip(*columns, strict=True)
    lines = [f"{facts['processor']}, {facts['cores']} cores, Python {facts['python']}; {versions}.", ""]
    lines += ["| " + " | ".join(headings) + " |"]
    lines += ["|" + "|".join("-" if heading in LEFT_ALIGNED else "-:" for heading in headings) + "|"]
    lines += ["| " + " | ".join(row) + " |" for row in cells]
    return "\n".join(lines) + "\n"


def check_writable(folder: Path, report: Report) -> None:
    """Refuse a folder that `write` would fail on.

    Raises:
        BenchmarkError: README.md is missing or lacks the marks.
    """
    _readme_parts(folder, report)


def write(folder: Path, report: Report, rows: Sequence[Row]) -> None:
    """Replace the report's JSON in the folder, and the table between its marks in README.md.

    Raises:
        BenchmarkError: README.md is missing or lacks the marks.
        OutputError: the folder cannot be written.
    """
    before, after = _readme_parts(folder, report)
    write_beside(folder / README_NAME, f"{before}{report.start}\n{markdown(rows)}{report.end}{after}")
    write_beside(folder / report.json_name, as_json(rows))


def machine() -> dict[str, Any]:
    """What the figures were measured with: processor, cores, Python, versions of the packages that are installed."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "packages": {name: version for name in PACKAGES_USED if (version := _version(name))},
    }


def _readme_parts(folder: Path, report: Report) -> tuple[str, str]:
    """What stands before and after the marks of the table."""
    readme = folder / README_NAME
    try:
        text = readme.read_text()
    except (OSError, UnicodeDecodeError) as err:
        msg = f"{readme}: cannot be read ({err}): name the folder whose {README_NAME} shall hold the table"
        raise BenchmarkError(msg) from err
    before, start, rest = text.partition(report.start)
    _, end, after = rest.partition(report.end)
    if not (start and end):
        msg = f"{readme}: lacks the lines {report.start} and {report.end}: put them where the table shall be"
        raise BenchmarkError(msg)
    return before, after


def _cells(row: Row) -> tuple[str, ...]:
    return (
        row.what,
        row.sensor,
        row.stream,
        _number(row.value),
        row.unit,
        row.peer or "",
        _number(row.peer_value),
        "" if row.ratio is None else f"{row.ratio:.2f}",
        "" if row.spread is None else f"{row.spread:.0%}",
        _number(row.frames_per_s),
        _number(row.events_per_frame),
    )


def _number(value: float | None) -> str:
    """Three digits that count."""
    if value is None:
        return ""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _processor() -> str:
    facts = Path("/proc/cpuinfo")
    lines = facts.read_text().splitlines() if facts.is_file() else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
