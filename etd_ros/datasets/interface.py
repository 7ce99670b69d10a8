"""What a dataset is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from etd_ros.errors import EtdError
from etd_ros.evaluation.truth import TimedBox


class DatasetError(EtdError):
    """A dataset's folder that lacks what it should hold, or files in it that make no sense."""


@dataclass(frozen=True, slots=True)
class LabelledSequence:
    """One recording of a dataset and its labels.

    Attributes:
        dataset: the dataset's name, such as `ecd`.
        name: the sequence's name, such as `shapes_6dof`; unique within its dataset.
        recording: file or folder that `open_recording` opens.
        topic: the event topic, where the recording has several.
        boxes: each target's labels in order of time, two or more of them, on the recording's clock.
    """

    dataset: str
    name: str
    recording: Path
    topic: str | None
    boxes: Mapping[str, Sequence[TimedBox]]
