"""What a cell's result depends on, as one short text: a result is taken for the cell's as long as it is the same."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import cv2

from etd_ros.evaluation.truth import TimedBox
from etd_ros.recordings import recording_files
from etd_ros.settings import Settings

PACKAGE = Path(__file__).resolve().parent.parent
BESIDE = ("benchmarking", "commands", "evaluation", "labelling", "nodes", "simulation")
"""Parts of the package on which no cell depends, but for `SCORED_BY`. A version number would say less than the sources:
it stands still during development."""
SCORED_BY = ("cell_run.py", "protocol.py", "scoring.py")
LIBRARIES = ("numba", "numpy", "rosbags", "safetensors", "scipy", "torch")
"""Other versions may bring other boxes; OpenCV says its own, since it is distributed under several names."""
DIGITS = 16


def fingerprint(recording: str, labels: Sequence[TimedBox], settings: Settings) -> str:
    """Of a cell, 16 hexadecimal digits.

    Args:
        recording: what `recording_state` says.
        labels: the target's.
        settings: of all stages; files that they name (models) count with size and time of change.
    """
    values = asdict(settings)
    parts = {
        "sources": _sources_digest(),
        "libraries": _library_versions(),
        "recording": recording,
        "labels": [(label.stamp_ns, *label.box) for label in labels],
        "settings": values,
        "files": [_state(Path(file)) for file in _named_files(values)],
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()[:DIGITS]


def recording_state(path: Path, topic: str | None) -> str:
    """Names, sizes and times of change of a recording's files, and the topic that is read: contents would take longer
    to read than many systems take to track."""
    return hashlib.sha256(json.dumps([topic, *map(_state, recording_files(path))]).encode()).hexdigest()


@cache
def _sources_digest() -> str:
    digest = hashlib.sha256()
    for file in source_files():
        digest.update(file.relative_to(PACKAGE).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def source_files() -> list[Path]:
    """The package's files that boxes and figures come from: code and shipped weights."""
    found = [file for part in sorted(PACKAGE.iterdir()) if part.name not in BESIDE for file in _files(part)]
    scoring = [PACKAGE / "evaluation" / name for name in SCORED_BY]
    return [file for file in (*found, *scoring) if file.suffix in (".py", ".safetensors")]


@cache
def _library_versions() -> dict[str, str | None]:
    return {"opencv": cv2.__version__, **{name: _version(name) for name in LIBRARIES}}


def _version(library: str) -> str | None:
    """None where it is not installed."""
    try:
        return version(library)
    except PackageNotFoundError:
        return None


def _files(path: Path) -> list[Path]:
    return sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]


def _state(file: Path) -> tuple[str, int, int]:
    found = file.stat()
    return file.name, found.st_size, found.st_mtime_ns


def _named_files(values: Mapping[str, Any]) -> Iterator[str]:
    for value in values.values():
        if isinstance(value, Mapping):
            yield from _named_files(value)
        elif isinstance(value, str) and value and Path(value).is_file():
            yield value
