"""What outlives a tracker that is killed: where its targets were last, in a file that the user has named."""

from __future__ import annotations

import dataclasses
import os
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import NoReturn

from etd_ros.boxes import Box
from etd_ros.evaluation import CLASS_COLUMN, TRACKS_COLUMNS, EvaluationError, TrackRow, TracksWriter, read_tracks
from etd_ros.names import is_class
from etd_ros.output_files import OutputError, check_outputs
from etd_ros.tracking import TargetReport, TargetState

AGE_MAX_S = 10.0
"""A target is not taken back where it was longer ago (s): it will be somewhere else."""
COAST_S = 0.5
"""Its motion is believed for so long."""
PACE_NS = 100_000_000
"""Motion is measured over this time (ns)."""
ROWS_MAX = 2
"""Of a target, in the file."""
HEADERS = tuple(f"{','.join(columns)}\n".encode() for columns in ((*TRACKS_COLUMNS, CLASS_COLUMN), TRACKS_COLUMNS))
"""By which a node knows the file for one of its own: what it writes, and what was written before there were classes."""
DAMAGED = "damaged"
"""Suffix of a file that is set aside."""
NULS_MAX_BYTES = 2**20
"""A file of nothing but zeros was cut by a power cut; a larger one is something else."""


@dataclass(frozen=True, slots=True)
class Remembered:
    """A target of an earlier life.

    Attributes:
        name: of the target.
        box: where its motion has brought it (pixels).
        age_s: how long ago it was seen (s).
        was_lost: whether its place was not known any more.
        class_id: what it was said to be; "" if nothing was said.
    """

    name: str
    box: Box
    age_s: float
    was_lost: bool
    class_id: str


class TargetMemory:
    """Keeps each target's last box, one shortly before, and its class, in a TRACKS.csv. Any thread may call it.

    The file is not brought to the disk each time, which would hold up what else is written to it: after a power cut
    what it holds is too old to be taken back, and a damaged one keeps no node from starting.

    Args:
        path: of the file; None to keep nothing.
        inputs: files that are read and must not be overwritten.
        warn: told where a damaged file was set aside.

    Raises:
        OutputError: the file cannot be written, or there is one of that name that is not a memory.
    """

    def __init__(self, path: Path | None, inputs: Iterable[Path], warn: Callable[[str], object]) -> None:
        check_outputs(path)
        self._path = path
        self._lock = threading.Lock()
        self._rows = {} if path is None else _remembered(path, inputs, warn)
        self._is_saved = True

    def recall(self, stamp_ns: int) -> list[Remembered]:
        """The targets that were there shortly before `stamp_ns` (ns)."""
        with self._lock:
            recalled = [_recalled(rows, stamp_ns) for rows in self._rows.values()]
        return [target for target in recalled if 0 <= target.age_s <= AGE_MAX_S]

    def note(self, stamp_ns: int, reports: Iterable[TargetReport], class_of: Callable[[str], str]) -> None:
        """Where the targets are at `stamp_ns`, and what (`class_of` by name). Those that are not reported any more are
        forgotten."""
        if self._path is None:
            return
        with self._lock:
            self._rows = {
                report.name: self._with(stamp_ns, report, class_of(report.name))
                for report in reports
                if report.box is not None or report.name in self._rows
            }
            self._is_saved = False

    def save(self) -> None:
        """Write what was noted since the last time.

        Raises:
            OutputError: the file cannot be written.
        """
        if self._path is None:
            return
        with self._lock:
            if self._is_saved:
                return
            targets, self._is_saved = list(self._rows.values()), True
        with TracksWriter(self._path, outlives_power=False, has_classes=True) as writer:
            for rows in targets:
                for row in [*rows[:-1][: ROWS_MAX - 1], rows[-1]]:
                    writer.write(row)

    def _with(self, stamp_ns: int, report: TargetReport, class_id: str) -> list[TrackRow]:
        """A target's rows: where it is, or was seen last, after those of a short time before."""
        rows = self._rows.get(report.name, [])
        class_id = class_id if is_class(class_id) else ""
        if report.box is None:
            last = dataclasses.replace(rows[-1], score=report.score, state=report.state.value, class_id=class_id)
            return [*rows[:-1], last]
        before = [row for row in rows if 0 < stamp_ns - row.stamp_ns <= PACE_NS]
        return [*before, TrackRow(stamp_ns, report.name, report.box, report.score, report.state.value, class_id)]


def _remembered(path: Path, inputs: Iterable[Path], warn: Callable[[str], object]) -> dict[str, list[TrackRow]]:
    """What the file has of each target, after it was made sure that it may be overwritten.

    Raises:
        OutputError: it may not.
    """
    if path.resolve() in {other.resolve() for other in inputs}:
        msg = f"{path}: is read as targets_file, and memory_file would overwrite it: name another file as memory_file"
        raise OutputError(msg)
    if not path.exists():
        return {}
    is_memory, is_whole = _look_at(path)
    if not is_memory:
        _refuse(path, f"its first line is not {HEADERS[0].decode().strip()}")
    if not is_whole:
        _set_aside(path, f"{path}: is cut short", warn)
        return {}
    try:
        found = read_tracks(path)
    except EvaluationError as err:
        _set_aside(path, " ".join(str(err).split()), warn)
        return {}
    for name, rows in found.items():
        if len(rows) > ROWS_MAX:
            _refuse(path, f"it has {len(rows)} boxes of {name}, a memory {ROWS_MAX} at most")
    with_box = {name: [row for row in rows if row.box is not None] for name, rows in found.items()}
    return {name: rows for name, rows in with_box.items() if rows}


def _look_at(path: Path) -> tuple[bool, bool]:
    """Whether a file was begun as a memory, and whether it was written to its end: a power cut leaves nothing, a part,
    or zeros in the place of what never reached the disk."""
    try:
        with path.open("rb") as file:
            head = file.read(NULS_MAX_BYTES)
            is_all = not file.read(1)
            file.seek(-1 if head else 0, os.SEEK_END)
            end = file.read()
    except OSError as err:
        msg = f"{path}: cannot be read ({err.strerror or err}): name a memory_file that you may read and write"
        raise OutputError(msg) from err
    is_zeros = is_all and not head.strip(b"\0")
    has_header = head.startswith(HEADERS)
    is_begun = has_header or is_zeros or any(header.startswith(head) for header in HEADERS)
    return is_begun, has_header and end == b"\n" and b"\0" not in head


def _refuse(path: Path, why: str) -> NoReturn:
    msg = f"{path}: no memory_file of a node ({why}) that may be overwritten: name another file, or move it away"
    raise OutputError(msg)


def _set_aside(path: Path, what: str, warn: Callable[[str], object]) -> None:
    """A damaged memory must not keep a robot from starting, again and again; what is in it stays to be looked at."""
    names = (path.with_name(f"{path.name}.{DAMAGED}{number or ''}") for number in count())
    aside = next(name for name in names if not name.exists())
    try:
        path.rename(aside)
    except OSError as err:
        msg = f"{what}, and cannot be renamed ({err.strerror or err}): name another memory_file"
        raise OutputError(msg) from err
    warn(f"memory_file {what}; it was set aside as {aside.name}, and targets start as the parameters say")


def _recalled(rows: list[TrackRow], stamp_ns: int) -> Remembered:
    first, last = rows[0], rows[-1]
    assert first.box is not None
    assert last.box is not None
    age_s, pace_s = (stamp_ns - last.stamp_ns) * 1e-9, (last.stamp_ns - first.stamp_ns) * 1e-9
    (x, y), (first_x, first_y) = last.box.center, first.box.center
    share = min(age_s, COAST_S) / pace_s if pace_s > 0 else 0.0
    box = Box(last.box.x + share * (x - first_x), last.box.y + share * (y - first_y), last.box.w, last.box.h)
    return Remembered(last.target, box, age_s, last.state == TargetState.LOST.value, last.class_id)
