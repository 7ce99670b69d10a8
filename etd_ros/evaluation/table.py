"""CSV tables with named columns: every cell is checked, and an error says in which line it stands."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from etd_ros.boxes import Box
from etd_ros.errors import EtdError

STAMP_NS_MAX = 2**63 - 1


class EvaluationError(EtdError):
    """A truth or track file that cannot be read, written or scored."""


@dataclass(frozen=True, slots=True)
class Row:
    """One line of a table: its cells by column, and where it stands for error messages."""

    path: Path
    line: int
    cells: dict[str, str]

    def error(self, what: str) -> EvaluationError:
        """An error at this line."""
        msg = f"{self.path}, line {self.line}: {what}"
        return EvaluationError(msg)

    def name(self) -> str:
        """The target's name.

        Raises:
            EvaluationError: it is empty.
        """
        name = self.cells["target"].strip()
        if not name:
            msg = "the target has no name: give one in the column target"
            raise self.error(msg)
        return name

    def stamp_ns(self) -> int:
        """The time (ns).

        Raises:
            EvaluationError: not a whole number that fits 63 bits.
        """
        text = self.cells["stamp_ns"]
        try:
            stamp_ns = int(text)
        except ValueError as err:
            msg = f"stamp_ns {text!r} is not a whole number: give nanoseconds"
            raise self.error(msg) from err
        if not 0 <= stamp_ns <= STAMP_NS_MAX:
            msg = f"stamp_ns {stamp_ns} is out of range [0, {STAMP_NS_MAX}]: give nanoseconds"
            raise self.error(msg)
        return stamp_ns

    def number(self, column: str) -> float:
        """A finite number.

        Raises:
            EvaluationError: it is none.
        """
        text = self.cells[column]
        try:
            number = float(text)
        except ValueError as err:
            msg = f"{column} {text!r} is not a number: give one"
            raise self.error(msg) from err
        if not math.isfinite(number):
            msg = f"{column} is {text}: give a finite number"
            raise self.error(msg)
        return number

    def box(self) -> Box:
        """The box (pixels).

        Raises:
            EvaluationError: a number is missing, or the box has no area.
        """
        box = Box(*(self.number(column) for column in ("x", "y", "w", "h")))
        if box.w <= 0 or box.h <= 0:
            msg = f"the box of {box.w:g} x {box.h:g} pixels has no area: w and h must be above 0"
            raise self.error(msg)
        return box

    def has_box(self) -> bool:
        """Whether all four numbers are there; as for the scoring, one that is empty means "no box"."""
        return all(self.cells[column].strip() for column in ("x", "y", "w", "h"))


def read_rows(path: Path, columns: Sequence[str]) -> Iterator[Row]:
    """The lines of a table that has at least these columns; blank lines and a byte-order mark are passed over.

    Raises:
        EvaluationError: the file cannot be read, a column is missing, or a line has too few or too many cells.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            yield from _rows(path, file, columns)
    except (OSError, UnicodeDecodeError) as err:
        msg = f"{path}: cannot be read ({err}): name a CSV file with the columns {','.join(columns)}"
        raise EvaluationError(msg) from err


def _rows(path: Path, file: TextIO, columns: Sequence[str]) -> Iterator[Row]:
    reader = csv.reader(file, strict=True)
    header: list[str] | None = None
    try:
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            if header is None:
                header = _checked_header(path, reader.line_num, cells, columns)
                continue
            row = Row(path, reader.line_num, dict(zip(header, cells, strict=False)))
            if len(cells) != len(header):
                msg = f"has {len(cells)} cells, not {len(header)}: give {','.join(header)}"
                raise row.error(msg)
            yield row
    except csv.Error as err:
        msg = f"{path}, line {reader.line_num}: is not CSV ({err}): give {','.join(columns)}"
        raise EvaluationError(msg) from err
    if header is None:
        msg = f"{path}: is empty: the first line must be {','.join(columns)}"
        raise EvaluationError(msg)


def _checked_header(path: Path, line: int, cells: Sequence[str], columns: Sequence[str]) -> list[str]:
    header = [cell.strip() for cell in cells]
    missing = [column for column in columns if column not in header]
    if missing or len(set(header)) != len(header):
        problem = f"lacks the column {missing[0]}" if missing else "names a column twice"
        msg = f"{path}, line {line}: the header {problem}: it must be {','.join(columns)}"
        raise EvaluationError(msg)
    return header
