"""One SQLite file that holds the finished cells of all runs: their figures, labels scored and tracks.

A cell is written in one transaction, so that a process killed at any moment leaves whole cells only.
"""

from __future__ import annotations

import csv
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

from etd_ros.boxes import Box
from etd_ros.evaluation.cells import Cell, CellResult
from etd_ros.evaluation.table import EvaluationError
from etd_ros.evaluation.tracks import TrackRow
from etd_ros.output_files import written_beside

APPLICATION_ID = int.from_bytes(b"etdE", "big")
SCHEMA_VERSION = 1
BUSY_TIMEOUT_S = 60.0
SCHEMA = (
    """CREATE TABLE cells (
        id INTEGER PRIMARY KEY,
        dataset TEXT NOT NULL, sequence TEXT NOT NULL, target TEXT NOT NULL,
        system TEXT NOT NULL, protocol TEXT NOT NULL, repetition INTEGER NOT NULL,
        fingerprint TEXT NOT NULL,
        ap REAL, ar REAL, failures INTEGER NOT NULL, frames INTEGER NOT NULL, events INTEGER NOT NULL,
        seconds REAL, error TEXT,
        UNIQUE (dataset, sequence, target, system, protocol, repetition, fingerprint))""",
    """CREATE TABLE labels (
        cell INTEGER NOT NULL REFERENCES cells (id), number INTEGER NOT NULL,
        stamp_ns INTEGER NOT NULL, overlap REAL NOT NULL, centre_error_px REAL NOT NULL,
        PRIMARY KEY (cell, number)) WITHOUT ROWID""",
    """CREATE TABLE tracks (
        cell INTEGER NOT NULL REFERENCES cells (id), number INTEGER NOT NULL,
        stamp_ns INTEGER NOT NULL, x REAL, y REAL, w REAL, h REAL, score REAL, state TEXT NOT NULL,
        PRIMARY KEY (cell, number)) WITHOUT ROWID""",
)
CELL_COLUMNS = ("dataset", "sequence", "target", "system", "protocol", "repetition")
FIGURE_COLUMNS = ("ap", "ar", "failures", "frames", "events", "seconds", "error")
EXPORT_COLUMNS = (*CELL_COLUMNS, "ap", "ar", "labels", *FIGURE_COLUMNS[2:], "fingerprint")
IS_CELL = " AND ".join(f"{column} = ?" for column in (*CELL_COLUMNS, "fingerprint"))

CellKey = tuple[Cell, str]
"""A cell and the fingerprint of all that its result depends on."""


class Store:
    """Cells that are done, for the length of a `with` block. Several processes may use one file.

    Args:
        path: the file, made where there is none.

    Attributes:
        path: the file.

    Raises:
        EvaluationError: not a file of this kind and version, damaged, or one that cannot be written; also from the
            methods.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._one_line_errors():
            # Every transaction is begun in so many words: the module's own rules changed with Python 3.12.
            self._database = sqlite3.connect(path, timeout=BUSY_TIMEOUT_S, isolation_level=None)
        try:
            with self._one_line_errors():
                self._open_schema()
        except EvaluationError:
            self._database.close()
            raise

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the file."""
        self._database.close()

    def add(self, result: CellResult, fingerprint: str) -> None:
        """Keep a result, in the place of an earlier one of the same cell and fingerprint."""
        with self._one_line_errors(), self._transaction():
            for number in self._ids((result.cell, fingerprint)):
                for statement in ("tracks WHERE cell", "labels WHERE cell", "cells WHERE id"):
                    self._database.execute(f"DELETE FROM {statement} = ?", (number,))
            self._insert(result, fingerprint)

    def done(self, *, with_errors: bool = True) -> set[CellKey]:
        """What need not be done again: all cells kept, or only those that brought a result."""
        query = f"SELECT {', '.join(CELL_COLUMNS)}, fingerprint FROM cells"
        with self._one_line_errors():
            rows = self._database.execute(query if with_errors else f"{query} WHERE error IS NULL").fetchall()
        return {(Cell(*row[:-1]), row[-1]) for row in rows}

    def results(self, keys: Iterable[CellKey]) -> Iterator[CellResult]:
        """The results of those of the cells that are done, in the order given."""
        for key in keys:
            with self._one_line_errors():
                found = [self._result(key[0], number) for number in self._ids(key)]
            yield from found

    def export_csv(self, path: Path, keys: Iterable[CellKey]) -> None:
        """Write a row for each of the cells that is done: names, figures, number of labels scored, error, fingerprint.

        Raises:
            OutputError: the file cannot be written.
        """
        columns = ", ".join(
            "(SELECT COUNT(*) FROM labels WHERE cell = id)" if column == "labels" else column
            for column in EXPORT_COLUMNS
        )
        query = f"SELECT {columns} FROM cells WHERE id = ?"
        with self._one_line_errors():
            rows = [self._database.execute(query, (number,)).fetchone() for key in keys for number in self._ids(key)]
        with written_beside(path) as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(EXPORT_COLUMNS)
            writer.writerows(rows)

    def _open_schema(self) -> None:
        with self._transaction():
            application_id, version, tables = (
                self._database.execute(query).fetchone()[0]
                for query in ("PRAGMA application_id", "PRAGMA user_version", "SELECT COUNT(*) FROM sqlite_master")
            )
            if application_id == 0 and tables == 0:
                for statement in SCHEMA:
                    self._database.execute(statement)
                self._database.execute(f"PRAGMA application_id = {APPLICATION_ID}")
                self._database.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
            elif application_id != APPLICATION_ID:
                msg = f"{self.path}: is another program's database: name another file"
                raise EvaluationError(msg)
            elif version != SCHEMA_VERSION:
                msg = f"{self.path}: has schema version {version}, not {SCHEMA_VERSION}: name another file"
                raise EvaluationError(msg)

    def _ids(self, key: CellKey) -> list[int]:
        cell, fingerprint = key
        values = (*(getattr(cell, column) for column in CELL_COLUMNS), fingerprint)
        return [number for (number,) in self._database.execute(f"SELECT id FROM cells WHERE {IS_CELL}", values)]

    def _insert(self, result: CellResult, fingerprint: str) -> None:
        columns = (*CELL_COLUMNS, "fingerprint", *FIGURE_COLUMNS)
        values = (
            *(getattr(result.cell, column) for column in CELL_COLUMNS),
            fingerprint,
            *(getattr(result, column) for column in FIGURE_COLUMNS),
        )
        places = ", ".join("?" * len(columns))
        number = self._database.execute(f"INSERT INTO cells ({', '.join(columns)}) VALUES ({places})", values).lastrowid
        labels = zip(result.stamps_ns, result.overlaps, result.centre_errors_px, strict=True)
        self._database.executemany(
            "INSERT INTO labels VALUES (?, ?, ?, ?, ?)", ((number, i, *label) for i, label in enumerate(labels))
        )
        self._database.executemany(
            "INSERT INTO tracks VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (
                (number, i, row.stamp_ns, *(row.box or (None,) * 4), row.score, row.state)
                for i, row in enumerate(result.track)
            ),
        )

    def _result(self, cell: Cell, number: int) -> CellResult:
        figures = self._database.execute(f"SELECT {', '.join(FIGURE_COLUMNS)} FROM cells WHERE id = ?", (number,))
        ap, ar, failures, frames, events, seconds, error = figures.fetchone()
        labels = self._database.execute(
            "SELECT stamp_ns, overlap, centre_error_px FROM labels WHERE cell = ? ORDER BY number", (number,)
        ).fetchall()
        rows = self._database.execute(
            "SELECT stamp_ns, x, y, w, h, score, state FROM tracks WHERE cell = ? ORDER BY number", (number,)
        )
        return CellResult(
            cell=cell,
            ap=_number(ap),
            ar=_number(ar),
            stamps_ns=[label[0] for label in labels],
            overlaps=[label[1] for label in labels],
            centre_errors_px=[label[2] for label in labels],
            failures=failures,
            track=[
                TrackRow(stamp_ns, cell.target, None if box[0] is None else Box(*box), _number(score), state)
                for stamp_ns, *box, score, state in rows
            ],
            frames=frames,
            events=events,
            seconds=_number(seconds),
            error=error,
        )

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._database.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            self._database.execute("ROLLBACK")
            raise
        self._database.execute("COMMIT")

    @contextmanager
    def _one_line_errors(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as err:
            msg = f"{self.path}: cannot be used ({err}): name a store that evaluate has made, or a new file"
            raise EvaluationError(msg) from err


def _number(value: float | None) -> float:
    """SQLite keeps NaN as NULL."""
    return float("nan") if value is None else value
