"""A cell of the comparison's table: one system on one target of one sequence, once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from etd_ros.evaluation.tracks import TrackRow

ProtocolName = Literal["one-pass", "restarts"]
"""`one-pass`: causal, without re-initialisation; `restarts`: the paper's, started again after each failure."""


@dataclass(frozen=True, slots=True)
class Cell:
    """What identifies a cell: its result is computed once and kept.

    Attributes:
        dataset, sequence, target: names.
        system: the system's name.
        protocol: how it is run.
        repetition: from 0; seeds whatever is random.
    """

    dataset: str
    sequence: str
    target: str
    system: str
    protocol: ProtocolName
    repetition: int


@dataclass(frozen=True, slots=True)
class CellResult:
    """What a cell's run brought.

    Attributes:
        cell: which one.
        ap, ar: mean IoU, and share of labels with an IoU of at least 0.5, over the labels scored.
        stamps_ns: the scored labels' times.
        overlaps: IoU at each of them, 0 without a box.
        centre_errors_px: distance between the box's centre and the label's at each of them; infinite without a box.
        failures: labels that failed, after each of which the system was started again if labels were left; 0 in
            `one-pass`.
        track: the system's answers, as in TRACKS.csv.
        frames: answers given.
        events: events read from the first start on.
        seconds: time that the system took for them (s), reading the recording left out.
        error: why there is no result, in one line; None where there is one. The figures are NaN and empty then.
    """

    cell: Cell
    ap: float
    ar: float
    stamps_ns: Sequence[int]
    overlaps: Sequence[float]
    centre_errors_px: Sequence[float]
    failures: int
    track: Sequence[TrackRow]
    frames: int
    events: int
    seconds: float
    error: str | None = None
