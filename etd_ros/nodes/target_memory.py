"""What outlives a tracker that is killed: where its targets were last, in a file that the user has named."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from etd_ros.boxes import Box
from etd_ros.evaluation import TrackRow, TracksWriter, read_tracks
from etd_ros.output_files import check_outputs
from etd_ros.tracking import TargetReport, TargetState

AGE_MAX_S = 10.0
"""A target is not taken back where it was longer ago (s): it will be somewhere else."""
COAST_S = 0.5
"""Its motion is believed for so long."""
PACE_NS = 100_000_000
"""Motion is measured over this time (ns)."""


@dataclass(frozen=True, slots=True)
class Remembered:
    """A target of an earlier life.

    Attributes:
        name: of the target.
        box: where its motion has brought it (pixels).
        age_s: how long ago it was seen (s).
        was_lost: whether its place was not known any more.
    """

    name: str
    box: Box
    age_s: float
    was_lost: bool


class TargetMemory:
    """Keeps each target's last box, and one shortly before, in a TRACKS.csv. Any thread may call it.

    Args:
        path: of the file; None to keep nothing.

    Raises:
        OutputError: the file cannot be written.
        EvaluationError: there is a file of that name that holds something else.
    """

    def __init__(self, path: Path | None) -> None:
        check_outputs(path)
        self._path = path
        self._lock = threading.Lock()
        found = read_tracks(path) if path is not None and path.is_file() else {}
        with_box = {name: [row for row in rows if row.box is not None] for name, rows in found.items()}
        self._rows = {name: rows for name, rows in with_box.items() if rows}
        self._is_saved = True

    def recall(self, stamp_ns: int) -> list[Remembered]:
        """The targets that were there shortly before `stamp_ns` (ns)."""
        with self._lock:
            recalled = [_recalled(rows, stamp_ns) for rows in self._rows.values()]
        return [target for target in recalled if 0 <= target.age_s <= AGE_MAX_S]

    def note(self, stamp_ns: int, reports: Iterable[TargetReport]) -> None:
        """Where the targets are at `stamp_ns`. Those that are not reported any more are forgotten."""
        if self._path is None:
            return
        with self._lock:
            self._rows = {
                report.name: self._with(stamp_ns, report)
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
        with TracksWriter(self._path) as writer:
            for rows in targets:
                for row in [*rows[:-1][:1], rows[-1]]:
                    writer.write(row)

    def _with(self, stamp_ns: int, report: TargetReport) -> list[TrackRow]:
        """A target's rows: where it is, or was seen last, after those of a short time before."""
        rows = self._rows.get(report.name, [])
        if report.box is None:
            last = dataclasses.replace(rows[-1], score=report.score, state=report.state.value)
            return [*rows[:-1], last]
        before = [row for row in rows if 0 < stamp_ns - row.stamp_ns <= PACE_NS]
        return [*before, TrackRow(stamp_ns, report.name, report.box, report.score, report.state.value)]


def _recalled(rows: list[TrackRow], stamp_ns: int) -> Remembered:
    first, last = rows[0], rows[-1]
    assert first.box is not None
    assert last.box is not None
    age_s, pace_s = (stamp_ns - last.stamp_ns) * 1e-9, (last.stamp_ns - first.stamp_ns) * 1e-9
    (x, y), (first_x, first_y) = last.box.center, first.box.center
    share = min(age_s, COAST_S) / pace_s if pace_s > 0 else 0.0
    box = Box(last.box.x + share * (x - first_x), last.box.y + share * (y - first_y), last.box.w, last.box.h)
    return Remembered(last.target, box, age_s, last.state == TargetState.LOST.value)
