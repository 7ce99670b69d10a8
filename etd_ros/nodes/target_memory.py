"""What outlives a tracker that is killed: where its targets were last, in a file that the user has named."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Iterable
from pathlib import Path

from etd_ros.evaluation import TrackRow, TracksWriter, read_tracks
from etd_ros.output_files import check_outputs
from etd_ros.tracking import TargetReport, TargetState

AGE_MAX_NS = 10_000_000_000
"""A target is not taken back where it was longer ago (ns): it will be somewhere else."""


class TargetMemory:
    """Keeps each target's last box in a TRACKS.csv of one row a target. Any thread may call it.

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
        self._rows = {name: rows[-1] for name, rows in found.items()}
        self._is_saved = True

    def recall(self, stamp_ns: int) -> list[TrackRow]:
        """Where targets were shortly before `stamp_ns` (ns); a lost one is where it was seen last."""
        with self._lock:
            rows = list(self._rows.values())
        return [row for row in rows if row.box is not None and 0 <= stamp_ns - row.stamp_ns <= AGE_MAX_NS]

    def note(self, stamp_ns: int, reports: Iterable[TargetReport]) -> None:
        """Where the targets are at `stamp_ns`. Those that are not reported any more are forgotten."""
        if self._path is None:
            return
        with self._lock:
            self._rows = {
                report.name: self._row(stamp_ns, report)
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
            rows, self._is_saved = list(self._rows.values()), True
        with TracksWriter(self._path) as writer:
            for row in rows:
                writer.write(row)

    def _row(self, stamp_ns: int, report: TargetReport) -> TrackRow:
        if report.box is not None:
            return TrackRow(stamp_ns, report.name, report.box, report.score, report.state.value)
        return dataclasses.replace(self._rows[report.name], score=report.score, state=report.state.value)


def was_lost(row: TrackRow) -> bool:
    """Whether a target's place was not known any more."""
    return row.state == TargetState.LOST.value
