"""Box files that are lines of numbers, whatever the numbers mean."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from etd_ros.datasets.interface import DatasetError

FILE_BYTES_MAX = 64 << 20
SEPARATORS = re.compile(r"[\s,;]+")


@dataclass(frozen=True, slots=True)
class BoxText:
    """A table of finite numbers, kept as they are written, since a float would lose some of a time.

    Attributes:
        path: the file.
        columns: how many numbers each line has.
        lines: each row's line number in the file, from 1.
        rows: each row's numbers.
    """

    path: Path
    columns: int
    lines: Sequence[int]
    rows: Sequence[Sequence[str]]


def read_box_text(path: Path) -> BoxText:
    """Lines of numbers separated by blanks, tabs, commas or semicolons. Blank lines, comments (#) and a first line
    without any number are passed over.

    Raises:
        DatasetError: too large, unreadable, empty, or a line that is not as many finite numbers as the first one.
    """
    lines: list[int] = []
    rows: list[list[str]] = []
    for number, fields in _lines(path):
        if not rows and not any(_is_number(field) for field in fields):
            continue
        wrong = next((field for field in fields if not _is_number(field)), None)
        if wrong is not None or (rows and len(fields) != len(rows[0])):
            what = f"{wrong[:40]!r} is no finite number" if wrong is not None else f"{len(fields)} numbers"
            expected = f", not {len(rows[0])} as before" if wrong is None else ""
            msg = f"{path}, line {number}: {what}{expected}: mend or remove it"
            raise DatasetError(msg)
        lines.append(number)
        rows.append(fields)
    if not rows:
        msg = f"{path}: holds no box: copy it again"
        raise DatasetError(msg)
    return BoxText(path, len(rows[0]), lines, rows)


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    """(number, fields) of each line that has some."""
    try:
        if path.stat().st_size > FILE_BYTES_MAX:
            msg = f"{path}: {path.stat().st_size} bytes are too many for boxes ({FILE_BYTES_MAX}): is it another file?"
            raise DatasetError(msg)
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as err:
        msg = f"{path}: cannot be read ({err.strerror or err}): check its permissions"
        raise DatasetError(msg) from err
    split = ((number, SEPARATORS.split(line.strip())) for number, line in enumerate(text.splitlines(), 1))
    return [(number, fields) for number, fields in split if fields[0] and not fields[0].startswith("#")]


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
