"""The two protocols: a single causal pass, and the paper's (Sec. 4.1), which starts a system again after a failure.

docs/evaluation.md says what was decided where the paper is silent. Not re-exported by `etd_ros.evaluation`: the
systems, which this runs, read truth files from there.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from etd_ros.boxes import Box
from etd_ros.evaluation.scoring import SUCCESS_IOU, boxes_at, overlap
from etd_ros.evaluation.table import EvaluationError
from etd_ros.evaluation.tracks import TrackRow
from etd_ros.evaluation.truth import TimedBox
from etd_ros.targets import TargetStart
from etd_ros.tracking import TargetReport, TargetState

FAILURE_IOU = SUCCESS_IOU
"""A label overlapped by less is a failure, after which `restarts` starts again: the only threshold below which the
paper speaks of a "tracking failure" (Sec. 4.1)."""
WARM_UP_NS = 1_000_000_000
"""How much of the recording a system is given before a re-start, so that frames and reconstructions are under way:
19 time constants of the high-pass filter (at 3 Hz), two of its grey range, ten of the longest ATSLTD frames."""
LABELS_MIN = 2
STARTED = "started"
"""State of the rows that hold the boxes a system was started from again."""


class Step(Protocol):
    """What a system says at a time, as `etd_ros.systems.running.SystemStep` does."""

    @property
    def stamp_ns(self) -> int: ...
    @property
    def reports(self) -> Sequence[TargetReport]: ...
    @property
    def seconds(self) -> float: ...


StartSystem = Callable[[TargetStart, int | None], Iterator[Step]]
"""Runs a system anew with one target, on the whole recording, or on what is in it from a time (ns) on."""


@dataclass(slots=True)
class Outcome:
    """What a protocol made of a system on one target.

    Attributes:
        stamps_ns: times of the labels scored.
        overlaps: IoU at each, 0 without a box.
        centre_errors_px: distance of the centres at each; infinite without a box.
        track: the system's answers.
        failures: labels that failed in `restarts`.
        frames: number of answers.
        seconds: the system's own time for them (s).
    """

    stamps_ns: list[int] = field(default_factory=list)
    overlaps: list[float] = field(default_factory=list)
    centre_errors_px: list[float] = field(default_factory=list)
    track: list[TrackRow] = field(default_factory=list)
    failures: int = 0
    frames: int = 0
    seconds: float = 0.0

    def add_label(self, label: TimedBox, box: Box | None) -> None:
        """Score the system's box at a label."""
        self.stamps_ns.append(label.stamp_ns)
        self.overlaps.append(overlap(box, label))
        self.centre_errors_px.append(centre_error_px(box, label.box))

    def add_answer(self, row: TrackRow, seconds: float) -> None:
        """Keep an answer, and the time that it took (s)."""
        self.track.append(row)
        self.frames += 1
        self.seconds += seconds


def centre_error_px(box: Box | None, truth: Box) -> float:
    """Distance between the boxes' centres (pixels); infinite without a box."""
    return float("inf") if box is None else float(np.hypot(*np.subtract(box.center, truth.center)))


def one_pass(start_system: StartSystem, target: str, labels: Sequence[TimedBox]) -> Outcome:
    """Causal, without re-starts: each label but the first, from which the system starts, is compared with the last
    answer at or before it. AP and AR are those of `score` on the track.

    Args:
        start_system: runs the system.
        target: the target's name.
        labels: two or more, in order of time.

    Raises:
        EvaluationError: fewer than two labels.
    """
    _check(target, labels)
    outcome = Outcome()
    with closing(_answers(start_system, target, labels[0], None)) as answers:
        for row, seconds in answers:
            if row.stamp_ns > labels[-1].stamp_ns:
                break
            outcome.add_answer(row, seconds)
    for label, box in zip(labels[1:], boxes_at(outcome.track, labels[1:]), strict=True):
        outcome.add_label(label, box)
    return outcome


def restarts(start_system: StartSystem, target: str, labels: Sequence[TimedBox]) -> Outcome:
    """The paper's protocol (Sec. 4.1): as one pass, but after a failure the system starts again.

    A label overlapped by less than 0.5 is a failure. It counts with its overlap; the system is started anew from the
    next label's box, which is not scored, as the first is not. Until its first answer that box is what it says:
    pictures may be further apart than labels.

    Args:
        start_system: runs the system.
        target: the target's name.
        labels: two or more, in order of time.

    Raises:
        EvaluationError: fewer than two labels.
    """
    _check(target, labels)
    outcome = Outcome()
    start = 0
    while start < len(labels) - 1:
        from_ns = max(0, labels[start].stamp_ns - WARM_UP_NS) if start else None
        with closing(_answers(start_system, target, labels[start], from_ns)) as answers:
            start += _score_until_failure(answers, target, labels[start:], outcome) + 1
    return outcome


def _answers(
    start_system: StartSystem, target: str, label: TimedBox, from_ns: int | None
) -> Generator[tuple[TrackRow, float], None, None]:
    """The system's answers from its start at the label on, each with the time that it took (s)."""
    steps = start_system(TargetStart(target, label.box, label.stamp_ns), from_ns)
    for step in steps:
        for report in step.reports:
            if report.state is not TargetState.IDLE:
                yield TrackRow(step.stamp_ns, target, report.box, report.score, report.state.value), step.seconds


def _score_until_failure(
    answers: Iterator[tuple[TrackRow, float]], target: str, labels: Sequence[TimedBox], outcome: Outcome
) -> int:
    """Score all labels but the first, from which the system started, up to one that fails.

    Returns:
        The index of the label that failed, else of the last one.
    """
    row = TrackRow(labels[0].stamp_ns, target, labels[0].box, float("nan"), STARTED)
    outcome.track.append(row)
    answer = next(answers, None)
    for index, label in enumerate(labels[1:], 1):
        while answer is not None and answer[0].stamp_ns <= label.stamp_ns:
            outcome.add_answer(*answer)
            row, answer = answer[0], next(answers, None)
        outcome.add_label(label, row.box)
        if outcome.overlaps[-1] < FAILURE_IOU:
            outcome.failures += 1
            return index
    return len(labels) - 1


def _check(target: str, labels: Sequence[TimedBox]) -> None:
    if len(labels) < LABELS_MIN:
        msg = f"target {target!r} has {len(labels)} labels: label it at two times or more"
        raise EvaluationError(msg)
