"""Cells in parallel on this machine, each process with one recording in memory at a time."""

from __future__ import annotations

import os
import time
from collections import defaultdict, deque
from collections.abc import Generator, Iterable, Sequence
from contextlib import closing
from multiprocessing.connection import wait
from pathlib import Path
from types import TracebackType

from etd_ros.evaluation.cell_process import CellProcess
from etd_ros.evaluation.cell_run import CellTask
from etd_ros.evaluation.cells import CellResult

RecordingKey = tuple[Path, "str | None"]


class LocalProcesses:
    """Processes that work out cells, for the length of a `with` block.

    Args:
        jobs: how many at once.
        cell_timeout_s: a cell that takes longer (s) is stopped; None for no limit. Reading the recording counts for
            the cell that needs it first.

    Attributes:
        processes: those at work.
    """

    def __init__(self, jobs: int, cell_timeout_s: float | None = None) -> None:
        self._jobs = jobs
        self._threads = max(1, len(os.sched_getaffinity(0)) // jobs)
        self._cell_timeout_s = cell_timeout_s
        self.processes: dict[CellProcess, RecordingKey | None] = {}

    def __enter__(self) -> LocalProcesses:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for process in list(self.processes):
            self._end(process)

    def run(self, tasks: Sequence[CellTask]) -> Generator[CellResult, None, None]:
        """The results of the cells, as they come. A process that dies or is stopped costs the cell in work its result
        and is replaced."""
        waiting = _TasksByRecording(tasks)
        while waiting or any(process.task for process in self.processes):
            self._give_out(waiting)
            yield from self._next_results()

    def _give_out(self, waiting: _TasksByRecording) -> None:
        """Have every process work, as far as there is work; those that died are replaced."""
        for process in [process for process in self.processes if not process.task and process.has_died()]:
            self._end(process)
        for process in [process for process in self.processes if not process.task]:
            self._give(process, waiting)
        while waiting and len(self.processes) < self._jobs:
            process = CellProcess(self._threads)
            self.processes[process] = None
            self._give(process, waiting)

    def _give(self, process: CellProcess, waiting: _TasksByRecording) -> None:
        if waiting:
            task = waiting.take(self.processes[process], self.processes.values())
            self.processes[process] = _recording_of(task)
            process.give(task)

    def _next_results(self) -> list[CellResult]:
        """Wait for cells to be done, or to be over their time."""
        busy = {process.connection: process for process in self.processes if process.task}
        ready = [busy[connection] for connection in wait(list(busy), self._patience_s(busy.values()))]  # type: ignore[index]
        results = [process.take() for process in ready]
        if self._cell_timeout_s is not None:
            overdue = [process for process in busy.values() if process.task and self._time_left_s(process) <= 0]
            results += [process.give_up(self._cell_timeout_s) for process in overdue]
        return results

    def _patience_s(self, busy: Iterable[CellProcess]) -> float | None:
        if self._cell_timeout_s is None:
            return None
        return max(0.0, min(map(self._time_left_s, busy), default=0.0))

    def _time_left_s(self, process: CellProcess) -> float:
        return process.started_s + (self._cell_timeout_s or 0.0) - time.monotonic()

    def _end(self, process: CellProcess) -> None:
        del self.processes[process]
        process.close()


class _TasksByRecording:
    """Tasks that wait, so that a process gets those of the recording that it holds as long as there are any."""

    def __init__(self, tasks: Iterable[CellTask]) -> None:
        self._tasks: defaultdict[RecordingKey, deque[CellTask]] = defaultdict(deque)
        for task in tasks:
            self._tasks[_recording_of(task)].append(task)

    def __bool__(self) -> bool:
        return any(self._tasks.values())

    def take(self, held: RecordingKey | None, in_work: Iterable[RecordingKey | None]) -> CellTask:
        """The next task for a process that holds a recording: of that one, else of the one with the most tasks left
        for each process at work on it."""
        if held is not None and self._tasks[held]:
            return self._tasks[held].popleft()
        at_work = list(in_work)
        chosen = max(self._tasks, key=lambda key: len(self._tasks[key]) / (1 + at_work.count(key)))
        return self._tasks[chosen].popleft()


def _recording_of(task: CellTask) -> RecordingKey:
    return task.recording, task.topic


def run_here(tasks: Sequence[CellTask], jobs: int, cell_timeout_s: float | None) -> Generator[CellResult, None, None]:
    """The results of the cells, as they come, of processes that end with this iterator."""
    with LocalProcesses(jobs, cell_timeout_s) as processes, closing(processes.run(tasks)) as results:
        yield from results
