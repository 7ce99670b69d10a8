"""Opens a dataset's folder: its sequences, with the recordings and labels that belong together."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path

from etd_ros.datasets.box_columns import UnnamedObjectsError
from etd_ros.datasets.interface import DatasetError, LabelledSequence
from etd_ros.datasets.labels import CSV_NAME, labels_of
from etd_ros.datasets.sequences import FoundSequence, find_archives, find_sequences
from etd_ros.errors import EtdError
from etd_ros.evaluation import EvaluationError
from etd_ros.recordings import RecordingError

DATASETS: Mapping[str, str] = {
    "ecd": "Event Camera Dataset (Mueggler 2017): text folders and ROS 1 bags, with label files",
    "eed": "Extreme Event Dataset (Mitrokhin 2018): ROS 1 bags or text folders, with boundingbox.txt",
    "folder": "any recordings with a boxes.csv beside them",
}
"""What each name means."""

NAMES_SHOWN = 8


def open_dataset(
    name: str,
    path: Path | str,
    *,
    box_columns: str | None = None,
    only: Collection[str] = (),
    tell: Callable[[str], None] | None = None,
) -> list[LabelledSequence]:
    """The labelled sequences of a dataset as its publisher unpacks it, by name (docs/datasets.md).

    Nothing is read of the recordings but their beginning and end. What cannot be read is passed over while others can.

    Args:
        name: one of DATASETS.
        path: the folder.
        box_columns: for `eed`, what the columns of boundingbox.txt are, where that cannot be told from the numbers;
            see `read_columns`.
        only: names of the sequences that are opened, all of which have to be sound; all of the folder's if empty.
        tell: called with one line for what is passed over: sequences without labels or that cannot be read, archives
            not unpacked.

    Raises:
        DatasetError: unknown name, no labelled sequence, or labels that do not fit the only recording.
        EvaluationError: a line of the only label file is wrong.
        RecordingError: the only labelled recording cannot be opened.
    """
    path = Path(path)
    if name not in DATASETS:
        msg = f"dataset {name!r} is unknown: choose one of {', '.join(DATASETS)}"
        raise DatasetError(msg)
    if box_columns is not None and name != "eed":
        msg = f"--box-columns describes eed's boundingbox.txt: leave it out for {name}"
        raise DatasetError(msg)
    labelled, unlabelled = [], []
    notices: list[str] = []
    errors: list[EtdError] = []
    for sequence in find_sequences(path):
        if only and sequence.name not in only:
            continue
        try:
            labels = labels_of(sequence, name, box_columns, notices.append)
        except UnnamedObjectsError as err:
            notices.append(f"{sequence.name} is passed over: {err}")
            continue
        except (DatasetError, EvaluationError, RecordingError) as err:
            notices.append(f"{sequence.name} is passed over: {err}")
            errors.append(err)
            continue
        if labels is None:
            unlabelled.append(sequence)
        else:
            recording, boxes = labels
            labelled.append(LabelledSequence(name, sequence.name, recording, None, boxes))
    if errors and (only or not labelled):
        raise errors[0]
    notices += _what_is_missing(path, unlabelled)
    if not labelled:
        msg = f"{path}: no labelled sequence: {'; '.join(notices) or 'it holds no recording that is known'}"
        raise DatasetError(msg)
    if tell is not None:
        for notice in notices:
            tell(notice)
    return labelled


def _what_is_missing(path: Path, unlabelled: Sequence[FoundSequence]) -> list[str]:
    """A line for sequences without labels, and one for archives."""
    lines = []
    if unlabelled:
        first = unlabelled[0]
        output = first.stem.with_name(f"{first.stem.name}.{CSV_NAME}")
        lines.append(
            f"without labels: {_listed([sequence.name for sequence in unlabelled])}; make them with "
            f"`python -m etd_ros label {first.recordings[0]} --output {output}`"
        )
    archives = find_archives(path)
    if archives:
        lines.append(f"not unpacked: {_listed([archive.name for archive in archives])}; unzip each into its own folder")
    return lines


def _listed(names: Sequence[str]) -> str:
    more = len(names) - NAMES_SHOWN
    return ", ".join(names[:NAMES_SHOWN]) + (f" and {more} more" if more > 0 else "")
