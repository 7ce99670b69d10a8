"""A sequence's labels: where they lie, which of its recordings they belong to, and whether they can be true."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path

from etd_ros.boxes import BoxError
from etd_ros.datasets.box_columns import UnnamedObjectsError, read_columns
from etd_ros.datasets.box_text import read_box_text
from etd_ros.datasets.interface import DatasetError
from etd_ros.datasets.sequences import FoundSequence
from etd_ros.datasets.spans import Span, span_of
from etd_ros.evaluation.truth import TimedBox, read_boxes
from etd_ros.recordings import open_recording

CSV_NAME = "boxes.csv"
BOX_TEXT_NAME = "boundingbox.txt"
"""EED's name."""
OBJECT_COLUMNS = "t x y w h"
"""Of the files NAME_OBJECT.txt (github.com/nusneuromorphic/Object_Annotations, README)."""

Boxes = Mapping[str, Sequence[TimedBox]]


def labels_of(
    sequence: FoundSequence,
    dataset: str,
    columns: str | None = None,
    tell: Callable[[str], None] | None = None,
) -> tuple[Path, Boxes] | None:
    """The recording and each target's labels; None where there are none.

    Labels are read from `NAME.boxes.csv` beside the recording or `boxes.csv` in its folder; else, of `eed`, from its
    boundingbox.txt, and of `ecd` from files NAME_OBJECT.txt (Ramesh 2018). Of a sequence in several containers, the
    first on whose clock the labels are is taken.

    Args:
        sequence: the sequence.
        dataset: the dataset's name.
        columns: what the columns of boundingbox.txt are, see `read_columns`.
        tell: called with a line that says what they were found to be.

    Raises:
        DatasetError: two label files, or labels that do not fit the recording.
        EvaluationError: a line of the CSV is wrong.
        RecordingError: the recording cannot be opened.
    """
    csv = _only(sequence.companions(CSV_NAME))
    if csv is not None:
        return _labels_from_csv(csv, sequence)
    if dataset == "eed":
        path = _only(sequence.companions(BOX_TEXT_NAME))
        return None if path is None else _labels_from_text(path, sequence, columns, tell)
    objects = sequence.object_texts() if dataset == "ecd" else {}
    return _labels_of_objects(objects, sequence) if objects else None


def _only(files: Sequence[Path]) -> Path | None:
    if len(files) > 1:
        msg = f"{files[0]} and {files[1]} label the same sequence: remove one"
        raise DatasetError(msg)
    return files[0] if files else None


def _labels_from_csv(csv: Path, sequence: FoundSequence) -> tuple[Path, Boxes]:
    boxes = read_boxes(csv)
    stamps = [label.stamp_ns for labels in boxes.values() for label in labels]
    # The other containers need not even be readable where the preferred one fits.
    for recording in sequence.recordings:
        span = span_of(recording)
        if span.holds(min(stamps)) and span.holds(max(stamps)):
            check_labels(csv, boxes, span)
            return recording, boxes
    msg = (
        f"{csv}: its labels, {min(stamps)} to {max(stamps)} ns, are not on the clock of {span}: give stamps as the "
        "recording's events have them"
    )
    raise DatasetError(msg)


def _labels_from_text(
    path: Path, sequence: FoundSequence, columns: str | None, tell: Callable[[str], None] | None = None
) -> tuple[Path, Boxes]:
    """All objects of a box file."""
    text = read_box_text(path)
    misfits = []
    for recording in sequence.recordings:
        span = span_of(recording)
        try:
            boxes = read_columns(text, span, cache(partial(_image_stamps, recording)), columns, tell)
        except UnnamedObjectsError:
            raise
        except DatasetError as err:
            misfits.append(err)
            continue
        check_labels(path, boxes, span)
        return recording, boxes
    raise misfits[0]


def _labels_of_objects(objects: Mapping[str, Path], sequence: FoundSequence) -> tuple[Path, Boxes]:
    """The objects of a box file each."""
    found = {name: _labels_from_text(path, sequence, OBJECT_COLUMNS) for name, path in objects.items()}
    recordings = {recording for recording, _ in found.values()}
    if len(recordings) > 1:
        msg = f"{next(iter(objects.values()))}: not on the clock of the other objects' files: copy them again"
        raise DatasetError(msg)
    return recordings.pop(), {name: boxes["object"] for name, (_, boxes) in found.items()}


def check_labels(path: Path, boxes: Boxes, span: Span) -> None:
    """Refuse labels from which nothing can be tracked or scored.

    Raises:
        DatasetError: a target with a single label or with two at one time, or a box off the sensor.
    """
    for name, labels in boxes.items():
        if len(labels) < 2:
            msg = (
                f"{path}: target {name!r} has a single label, from which tracking starts: label it at two times or more"
            )
            raise DatasetError(msg)
        for before, after in itertools.pairwise(labels):
            if before.stamp_ns == after.stamp_ns:
                msg = f"{path}: two labels of {name!r} at {after.stamp_ns} ns: remove one"
                raise DatasetError(msg)
        for label in labels:
            try:
                label.box.check(span.width, span.height, f"{name!r} at {label.stamp_ns} ns")
            except BoxError as err:
                msg = f"{path}: {err}"
                raise DatasetError(msg) from err


def _image_stamps(recording: Path) -> list[int]:
    """Stamps of the video frames (ns)."""
    with open_recording(recording) as opened:
        return [image.stamp_ns for image in opened.images()]
