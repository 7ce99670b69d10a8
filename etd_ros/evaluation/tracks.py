"""TRACKS.csv: what a tracker said, `stamp_ns,target,x,y,w,h,score,state`, a row per target and frame."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from etd_ros.boxes import Box
from etd_ros.evaluation.table import Row, read_rows
from etd_ros.evaluation.truth import CLASS_COLUMN
from etd_ros.output_files import written_beside

if TYPE_CHECKING:
    from etd_ros.tracking import TargetReport

REQUIRED_COLUMNS = ("stamp_ns", "target", "x", "y", "w", "h")
TRACKS_COLUMNS = (*REQUIRED_COLUMNS, "score", "state")


@dataclass(frozen=True, slots=True)
class TrackRow:
    """What a tracker said of one target on one frame.

    Attributes:
        stamp_ns: the frame's time (ns).
        target: the target's name.
        box: where it is (pixels), None while there is no box.
        score: the tracker's confidence; NaN where the file has none.
        state: the target's state; empty where the file has none.
        class_id: what the target is said to be; empty where the file does not say.
    """

    stamp_ns: int
    target: str
    box: Box | None
    score: float
    state: str
    class_id: str = ""


class TracksWriter:
    """Writes a TRACKS.csv; the file appears under its name only when the `with` block succeeds.

    Args:
        path: of the file.
        outlives_power: as `written_beside` has it.
        has_classes: whether a last column says what each target is.

    Raises:
        OutputError: on entry or exit, the file cannot be written.
    """

    def __init__(self, path: Path, *, outlives_power: bool = True, has_classes: bool = False) -> None:
        self._path = path
        self._outlives_power = outlives_power
        self._has_classes = has_classes
        self._stack = ExitStack()
        self._writer: Any = None

    def __enter__(self) -> TracksWriter:
        file = self._stack.enter_context(written_beside(self._path, outlives_power=self._outlives_power))
        self._writer = csv.writer(file, lineterminator="\n")
        self._writer.writerow((*TRACKS_COLUMNS, *([CLASS_COLUMN] if self._has_classes else [])))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, traceback)

    def write(self, row: TrackRow) -> None:
        """Add a row; its numbers are read back unchanged."""
        box = ("", "", "", "") if row.box is None else tuple(repr(float(value)) for value in row.box)
        class_id = [row.class_id] if self._has_classes else []
        self._writer.writerow((row.stamp_ns, row.target, *box, repr(float(row.score)), row.state, *class_id))

    def write_reports(self, stamp_ns: int, reports: Iterable[TargetReport]) -> None:
        """Add a row for each target's report on the frame at `stamp_ns`."""
        for report in reports:
            self.write(TrackRow(stamp_ns, report.name, report.box, report.score, report.state.value))


def read_tracks(path: Path) -> dict[str, list[TrackRow]]:
    """Rows of each target in order of time. The columns score, state and class may be missing, others are passed over.

    Raises:
        EvaluationError: the file cannot be read, or a line is wrong; names file, line and cure.
    """
    tracks: dict[str, list[TrackRow]] = {}
    for row in read_rows(path, REQUIRED_COLUMNS):
        tracks.setdefault(row.name(), []).append(_track_row(row))
    for rows in tracks.values():
        rows.sort(key=lambda row: row.stamp_ns)
    return tracks


def _track_row(row: Row) -> TrackRow:
    return TrackRow(
        stamp_ns=row.stamp_ns(),
        target=row.name(),
        box=row.box() if row.has_box() else None,
        score=_score_of(row),
        state=row.cells.get("state", ""),
        class_id=row.cells.get(CLASS_COLUMN, "").strip(),
    )


def _score_of(row: Row) -> float:
    text = row.cells.get("score", "")
    return row.number("score") if text.strip() and text != "nan" else float("nan")
