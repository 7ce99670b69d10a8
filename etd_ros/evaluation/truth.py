"""BOXES.csv: labelled boxes, `target,stamp_ns,x,y,w,h`, perhaps with a column `class`."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from etd_ros.boxes import Box
from etd_ros.evaluation.table import EvaluationError, read_rows
from etd_ros.output_files import written_beside

COLUMNS = ("target", "stamp_ns", "x", "y", "w", "h")
CLASS_COLUMN = "class"


@dataclass(frozen=True, slots=True)
class TimedBox:
    """A target's box at a time: stamp (ns) and box (pixels); and what it is said to be, "" if nothing is said."""

    stamp_ns: int
    box: Box
    class_id: str = ""


def read_boxes(path: Path) -> dict[str, list[TimedBox]]:
    """Labelled boxes of each target in order of time; targets in order of their first line.

    Raises:
        EvaluationError: the file cannot be read, holds no box, a line is wrong, or a target has two different boxes at
            one time; names file, line and cure.
    """
    boxes: dict[str, list[TimedBox]] = {}
    firsts: dict[tuple[str, int], TimedBox] = {}
    for row in read_rows(path, COLUMNS):
        name = row.name()
        label = TimedBox(row.stamp_ns(), row.box(), row.cells.get(CLASS_COLUMN, "").strip())
        if firsts.setdefault((name, label.stamp_ns), label) != label:
            msg = f"another line has {name!r} at {label.stamp_ns} ns, too: keep one, or name two targets apart"
            raise row.error(msg)
        boxes.setdefault(name, []).append(label)
    if not boxes:
        msg = f"{path}: holds no box: give a line target,stamp_ns,x,y,w,h for each labelled time"
        raise EvaluationError(msg)
    for labels in boxes.values():
        labels.sort(key=lambda label: label.stamp_ns)
    return boxes


def write_boxes(path: Path, boxes: Mapping[str, Iterable[TimedBox]]) -> None:
    """Write labelled boxes to 1/1000 of a pixel, target by target; with a column `class` where one has any.

    Raises:
        OutputError: the file cannot be written.
    """
    with written_beside(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        rows = [(target, row) for target, of_target in boxes.items() for row in of_target]
        has_classes = any(row.class_id for _, row in rows)
        writer.writerow((*COLUMNS, *([CLASS_COLUMN] if has_classes else [])))
        for target, row in rows:
            class_id = [row.class_id] if has_classes else []
            writer.writerow((target, row.stamp_ns, *(f"{value:.3f}" for value in row.box), *class_id))
