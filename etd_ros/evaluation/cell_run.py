"""One cell of the comparison, from its recording to its result."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from etd_ros.errors import EtdError
from etd_ros.evaluation.cells import Cell, CellResult, ProtocolName
from etd_ros.evaluation.protocol import Outcome, Step, one_pass, restarts
from etd_ros.evaluation.scoring import score_of
from etd_ros.evaluation.truth import TimedBox
from etd_ros.recordings import RecordingError, open_recording
from etd_ros.recordings.loaded import LoadedRecording
from etd_ros.settings import Settings
from etd_ros.systems.running import run_system
from etd_ros.targets import TargetStart
from etd_ros.tracking import TargetState

PROTOCOLS = {"one-pass": one_pass, "restarts": restarts}
PROTOCOL_NAMES: tuple[ProtocolName, ...] = ("one-pass", "restarts")
NAN = float("nan")
WARM_UP_ANSWERS = 5


@dataclass(frozen=True, slots=True)
class CellTask:
    """All that a process needs to work out a cell.

    Attributes:
        cell: which one.
        recording: file or folder that `open_recording` opens.
        topic: its event topic, where it has several.
        labels: the target's, in order of time.
        settings: of all stages.
        fingerprint: of all that the result depends on.
    """

    cell: Cell
    recording: Path
    topic: str | None
    labels: tuple[TimedBox, ...]
    settings: Settings
    fingerprint: str


class Workplace:
    """What a process keeps from cell to cell: the recording that was asked for last, in memory, since the cells of one
    recording follow each other, which ones are damaged, and which systems have run.

    Attributes:
        warm: systems whose libraries and kernels are loaded.
    """

    def __init__(self) -> None:
        self._key: tuple[Path, str | None] | None = None
        self._recording: LoadedRecording | None = None
        self._damaged: dict[tuple[Path, str | None], str] = {}
        self.warm: set[str] = set()

    def recording(self, path: Path, topic: str | None) -> LoadedRecording:
        """The recording.

        Raises:
            RecordingError: it cannot be opened, is damaged, or holds no events.
        """
        key = path, topic
        if key in self._damaged:
            raise RecordingError(self._damaged[key])
        if self._recording is None or self._key != key:
            # Let go first: two large recordings may not fit.
            self._key = self._recording = None
            try:
                with open_recording(path, topic=topic) as recording:
                    self._recording = LoadedRecording.load(recording)
            except RecordingError as err:
                self._damaged[key] = str(err)
                raise
            self._key = key
        return self._recording


def run_cell(task: CellTask, workplace: Workplace) -> CellResult:
    """The cell's result. Whatever goes wrong in it stays in it: it is the result's error then."""
    try:
        return _run(task, workplace)
    except EtdError as err:
        return failed_cell(task.cell, str(err))
    except Exception as err:
        return failed_cell(task.cell, f"{_kind(err)}: {err}")


def _kind(err: Exception) -> str:
    """Its class; what OpenCV says of too little memory is of a class of its own."""
    has_no_memory = any(sign in str(err) for sign in ("std::bad_alloc", "Insufficient memory"))
    return MemoryError.__name__ if has_no_memory else type(err).__name__


def failed_cell(cell: Cell, error: str) -> CellResult:
    """A cell that brought nothing, and why."""
    return CellResult(cell, NAN, NAN, (), (), (), 0, (), 0, 0, NAN, " ".join(error.split()))


def _run(task: CellTask, workplace: Workplace) -> CellResult:
    cell, labels = task.cell, task.labels
    recording = workplace.recording(task.recording, task.topic)
    events, last_event_ns = _extent(recording, task.settings, labels[0].stamp_ns, labels[-1].stamp_ns)

    def start_system(start: TargetStart, from_ns: int | None) -> Iterator[Step]:
        if from_ns is not None and from_ns > last_event_ns:
            return iter(())
        return run_system(cell.system, recording, [start], task.settings, from_ns=from_ns, seed=cell.repetition)

    if cell.system not in workplace.warm:
        _warm_up(start_system(TargetStart(cell.target, labels[0].box, labels[0].stamp_ns), None))
        workplace.warm.add(cell.system)
    outcome = PROTOCOLS[cell.protocol](start_system, cell.target, labels)
    return _result(cell, outcome, events)


def _warm_up(steps: Iterator[Step]) -> None:
    """Let a system's first answers go by: with them come libraries and kernels, whose loading is not its speed."""
    answers = (step for step in steps for report in step.reports if report.state is not TargetState.IDLE)
    for _ in islice(answers, WARM_UP_ANSWERS):
        pass


def _extent(recording: LoadedRecording, settings: Settings, first_ns: int, last_ns: int) -> tuple[int, int]:
    """(Number of events from one time to another, time of the recording's last event), times in ns."""
    count, latest_ns = 0, 0
    for batch in recording.streams(settings.stream):
        times_ns = batch.events.t
        count += int(np.searchsorted(times_ns, last_ns, "right") - np.searchsorted(times_ns, first_ns))
        latest_ns = int(times_ns[-1])
    return count, latest_ns


def _result(cell: Cell, outcome: Outcome, events: int) -> CellResult:
    found = score_of(outcome.overlaps)
    return CellResult(
        cell=cell,
        ap=found.ap,
        ar=found.ar,
        stamps_ns=outcome.stamps_ns,
        overlaps=outcome.overlaps,
        centre_errors_px=outcome.centre_errors_px,
        failures=outcome.failures,
        track=outcome.track,
        frames=outcome.frames,
        events=events,
        seconds=outcome.seconds,
    )
