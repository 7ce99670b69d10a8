"""How well a tracking method does on simulated sequences, whose truth is exact.

Not re-exported by `etd_ros.evaluation`: the engine, which this runs, reads truth files from there.
"""

from __future__ import annotations

import csv
import multiprocessing
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from etd_ros.engine import track
from etd_ros.evaluation.scoring import SUCCESS_IOU, Score, score
from etd_ros.evaluation.tracks import TrackRow
from etd_ros.evaluation.truth import TimedBox
from etd_ros.events import concatenate
from etd_ros.output_files import written_beside
from etd_ros.settings import Settings
from etd_ros.simulation import Absence, AbsentTime, Scene, absent_times, true_boxes
from etd_ros.simulation import Sequence as Simulated
from etd_ros.stream import StreamGuard
from etd_ros.targets import TargetStart
from etd_ros.tracking import DEFAULT_METHOD, TargetState

T = TypeVar("T")

START_NS = 1_700_000_000_000_000_000
NS_PER_S = 1_000_000_000
LABEL_S = 0.01
FIRST_LABEL_S = 0.1
"""Targets start a little after the events do."""
OCCLUSION_MAX_S = 0.5
"""An occlusion that is to be survived hides more than half of its target for so long at most; longer ones are counted
apart."""
RECOVERY_S = 0.1
"""How soon after an occlusion a target must have its box again."""
SURVIVED_SHARE = 0.9
"""Of the labels from then on to the next absence, this share must be successes."""
LEFT_GRACE_S = 0.2
"""A box is false from this time after its target has left."""
WRONG_IOU = 0.2
"""A recovery whose box overlaps the truth less is a wrong one; while the target is occluded, less than a success."""


@dataclass(frozen=True, slots=True)
class TargetResult:
    """One target of one sequence.

    Attributes:
        sequence, target: names.
        ap, ar: average precision and robustness, as `score` has them, over the labels: times at 100 Hz at which at
            least half of the target can be seen; the first is what it was started from.
        labels: how many were scored.
        occlusions: absences by occlusion after which it is seen again; those of up to 0.5 s, from the last label before
            to the first one after.
        survived: those of them after which it was found: 0.1 s after it can be half seen again it has its box, and from
            then on to its next absence at least 90 % of the labels are successes (IoU >= 0.5).
        longer, longer_survived: the same of longer ones.
        left: times that it left the sensor.
        left_s: the longest time from its having left in full to the first report that it is not tracked (s); the whole
            absence where no report says so; 0 where it did not leave.
        false_share: share of the time (at 100 Hz) from 0.2 s after it had left at which it had a box; 0 where it did
            not leave.
        recoveries: times that it was tracked again after a failure.
        wrong_recoveries: those of them with an IoU below 0.2 with the truth, below 0.5 while it was occluded, or while
            it had left.
    """

    sequence: str
    target: str
    ap: float
    ar: float
    labels: int
    occlusions: int
    survived: int
    longer: int
    longer_survived: int
    left: int
    left_s: float
    false_share: float
    recoveries: int
    wrong_recoveries: int


COLUMNS = tuple(field.name for field in fields(TargetResult))


def evaluate(
    sequences: Iterable[Simulated],
    *,
    method: str = DEFAULT_METHOD,
    settings: Settings | None = None,
    jobs: int = 1,
    first_label_s: float = FIRST_LABEL_S,
) -> Iterator[list[TargetResult]]:
    """Results of the targets of each sequence, in order, as they come.

    Args:
        sequences: what to simulate.
        method: one of METHODS.
        settings: of all stages.
        jobs: processes at work at once.
        first_label_s: from when on targets start (s).
    """
    one = partial(evaluate_sequence, method=method, settings=settings, first_label_s=first_label_s)
    return of_each(one, sequences, jobs)


def of_each(one: Callable[[Simulated], T], sequences: Iterable[Simulated], jobs: int) -> Iterator[T]:
    """What `one` makes of each sequence, in order, as it comes, in `jobs` processes at once."""
    if jobs == 1:
        yield from map(one, sequences)
        return
    # Forked processes would inherit the state of OpenCV's and Numba's threads.
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(one, sequences)


def evaluate_sequence(
    sequence: Simulated,
    *,
    method: str = DEFAULT_METHOD,
    settings: Settings | None = None,
    first_label_s: float = FIRST_LABEL_S,
) -> list[TargetResult]:
    """Results of a sequence's targets, in the order of the scene; those of which half can be seen at one label
    at most are left out."""
    scene = sequence.scene()
    events = concatenate(list(sequence.events(scene, start_ns=START_NS)))
    truth = {name: labels for name in scene.targets if len(labels := _labels(scene, name, first_label_s)) > 1}
    starts = [TargetStart(name, labels[0].box, labels[0].stamp_ns) for name, labels in truth.items()]
    tracks: dict[str, list[TrackRow]] = {name: [] for name in truth}
    for step in track(StreamGuard().feed(events), starts, method=method, settings=settings, threads=False):
        stamp_ns = step.frame.stamp_ns
        for report in step.reports:
            tracks[report.name].append(TrackRow(stamp_ns, report.name, report.box, report.score, report.state.value))
    scores = score(tracks, truth) if truth else {}
    return [Judge(scene, name, tracks[name], truth[name]).result(sequence.name, scores[name]) for name in truth]


def write_results(path: Path, results: Iterable[TargetResult]) -> None:
    """Write a CSV, a row for each target, numbers with 3 decimals.

    Raises:
        OutputError: the file cannot be written.
    """
    with written_beside(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for result in results:
            values = (getattr(result, name) for name in COLUMNS)
            writer.writerow(f"{value:.3f}" if isinstance(value, float) else value for value in values)


def _labels(scene: Scene, name: str, first_label_s: float) -> list[TimedBox]:
    steps = range(round(first_label_s / LABEL_S), round(scene.duration_s / LABEL_S))
    times_s = [step * LABEL_S for step in steps]
    return [TimedBox(_stamp_ns(time_s), box) for time_s, box in true_boxes(scene, name, times_s)]


def _stamp_ns(time_s: float) -> int:
    return START_NS + round(time_s * NS_PER_S)


class Judge:
    """What a target's track says at the times that matter.

    Args:
        scene: where the target is.
        name: its name.
        track: its rows, in order of time.
        labels: its truth at the times at which it can be seen, at least one, in order of time.
    """

    def __init__(self, scene: Scene, name: str, track: Sequence[TrackRow], labels: Sequence[TimedBox]) -> None:
        self._scene, self._name = scene, name
        self._track, self._labels = track, labels
        self._stamps = [row.stamp_ns for row in track]
        absences = absent_times(scene, name)
        self._absences = [absence for absence in absences if _stamp_ns(absence.start_s) > labels[0].stamp_ns]

    def result(self, sequence: str, of_labels: Score) -> TargetResult:
        """All figures of the target, with the score of its labels."""
        occlusions = [absence for absence in self._of(Absence.OCCLUDED) if self._after(absence)]
        survived = [self._survives(absence) for absence in occlusions if self._hidden_s(absence) <= OCCLUSION_MAX_S]
        longer = [self._survives(absence) for absence in occlusions if self._hidden_s(absence) > OCCLUSION_MAX_S]
        left = self._of(Absence.LEFT)
        recovered = self._recoveries()
        return TargetResult(
            sequence=sequence,
            target=self._name,
            ap=of_labels.ap,
            ar=of_labels.ar,
            labels=of_labels.n,
            occlusions=len(survived),
            survived=sum(survived),
            longer=len(longer),
            longer_survived=sum(longer),
            left=len(left),
            left_s=max((self._delay_s(absence) for absence in left), default=0.0),
            false_share=self._false_share(left),
            recoveries=len(recovered),
            wrong_recoveries=sum(self._is_wrong(row) for row in recovered),
        )

    def _of(self, reason: Absence) -> list[AbsentTime]:
        return [absence for absence in self._absences if absence.reason is reason]

    def _row_at(self, stamp_ns: int) -> TrackRow | None:
        """The last row at or before a time."""
        index = bisect_right(self._stamps, stamp_ns) - 1
        return self._track[index] if index >= 0 else None

    def _after(self, absence: AbsentTime) -> list[TimedBox]:
        """The labels between an absence and the next one."""
        end_ns = _stamp_ns(absence.end_s)
        next_ns = min(
            (_stamp_ns(other.start_s) for other in self._absences if other.start_s > absence.start_s), default=2**63
        )
        return [label for label in self._labels if end_ns <= label.stamp_ns < next_ns]

    def _hidden_s(self, absence: AbsentTime) -> float:
        """For how long less than half of it can be seen."""
        last_ns = max(label.stamp_ns for label in self._labels if label.stamp_ns < _stamp_ns(absence.start_s))
        return (self._after(absence)[0].stamp_ns - last_ns) / NS_PER_S

    def _survives(self, absence: AbsentTime) -> bool:
        labels = self._after(absence)
        due_ns = labels[0].stamp_ns + round(RECOVERY_S * NS_PER_S)
        successes = [self._is_success(label) for label in labels if label.stamp_ns >= due_ns]
        if not successes:
            return self._is_success(labels[-1])
        return successes[0] and sum(successes) >= SURVIVED_SHARE * len(successes)

    def _is_success(self, label: TimedBox) -> bool:
        row = self._row_at(label.stamp_ns)
        return row is not None and row.box is not None and row.box.iou(label.box) >= SUCCESS_IOU

    def _delay_s(self, absence: AbsentTime) -> float:
        start_ns, end_ns = _stamp_ns(absence.start_s), _stamp_ns(absence.end_s)
        first = self._row_at(start_ns)
        rows = [*([first] if first else []), *(row for row in self._track if start_ns < row.stamp_ns <= end_ns)]
        not_tracked = (row for row in rows if row.state != TargetState.TRACKING.value)
        said_ns = next((max(row.stamp_ns, start_ns) for row in not_tracked), end_ns)
        return (said_ns - start_ns) / NS_PER_S

    def _false_share(self, left: Sequence[AbsentTime]) -> float:
        times_s = [
            time_s
            for absence in left
            for time_s in np.arange(absence.start_s + LEFT_GRACE_S, absence.end_s, LABEL_S).tolist()
        ]
        rows = [self._row_at(_stamp_ns(time_s)) for time_s in times_s]
        return sum(row is not None and row.box is not None for row in rows) / len(rows) if rows else 0.0

    def _recoveries(self) -> list[TrackRow]:
        """The rows at which it is tracked after one at which it had failed."""
        failed = (TargetState.RECOVERING.value, TargetState.LOST.value)
        return [
            row
            for last, row in zip(self._track[:-1], self._track[1:], strict=True)
            if last.state in failed and row.state == TargetState.TRACKING.value
        ]

    def _is_wrong(self, row: TrackRow) -> bool:
        """Whether its box is not on the target; of one that is hidden a part may be seen already, so that it is found,
        but a box near it that happens to touch it is not."""
        time_s = (row.stamp_ns - START_NS) / NS_PER_S
        reasons = {absence.reason for absence in self._absences if absence.start_s <= time_s < absence.end_s}
        if row.box is None or Absence.LEFT in reasons:
            return True
        least = SUCCESS_IOU if reasons else WRONG_IOU
        return row.box.iou(self._scene.box(self._name, time_s)) < least
