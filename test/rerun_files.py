"""Reads what was logged for the Rerun viewer, with whichever version of its SDK is installed."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import pyarrow as pa

OLDER_NAMES = {
    "Position2D": "centers",
    "HalfSize2D": "half_sizes",
    "Color": "colors",
    "Scalar": "scalars",
    "Text": "text",
    "TextLogLevel": "level",
    "Blob": "blob",
}
"""Components as SDKs before 0.24 name them, which NumPy 1 needs."""

Rows = list[tuple[int, dict[str, Any]]]


def logged(path: Path) -> dict[str, Rows]:
    """For each entity what it was when, in order of time: stamps (ns), and values by component."""
    try:
        from rerun.dataframe import load_recording
    except ModuleNotFoundError:
        return _of_chunks(path)
    recording = load_recording(path)
    entities = {column.entity_path for column in recording.schema().component_columns()}
    return {
        entity.strip("/"): _rows(recording.view(index="stamp", contents=entity).select().read_all())
        for entity in entities
    }


def _of_chunks(path: Path) -> dict[str, Rows]:
    try:
        from rerun.chunk import RrdReader
    except ModuleNotFoundError:
        from rerun.experimental import RrdReader
    rows: dict[str, Rows] = defaultdict(list)
    for chunk in RrdReader(path).stream():
        if "stamp" in chunk.timeline_names:
            rows[chunk.entity_path.strip("/")] += _rows(chunk.to_record_batch())
    return {entity: sorted(found, key=lambda row: row[0]) for entity, found in rows.items()}


def _rows(table: Any) -> Rows:
    stamps = table.column("stamp").cast(pa.int64()).to_pylist()
    short = {name: name.rpartition(":")[2] for name in table.schema.names if ":" in name}
    columns = {OLDER_NAMES.get(after, after): table.column(name).to_pylist() for name, after in short.items()}
    return [(stamp, {name: values[row] for name, values in columns.items()}) for row, stamp in enumerate(stamps)]
