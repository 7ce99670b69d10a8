"""The whole comparison: recordings x targets x systems x protocols x repetitions, kept cell by cell."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass

from etd_ros.datasets import LabelledSequence
from etd_ros.evaluation.cell_run import CellTask
from etd_ros.evaluation.cells import Cell, CellResult, ProtocolName
from etd_ros.evaluation.cluster import run_on_cluster
from etd_ros.evaluation.fingerprint import fingerprint, recording_state
from etd_ros.evaluation.local import run_here
from etd_ros.evaluation.store import CellKey, Store
from etd_ros.settings import Settings
from etd_ros.systems.registry import system_named

REPETITIONS = 5
"""N_rep of the paper (Sec. 4.1)."""


@dataclass(frozen=True, slots=True)
class Workforce:
    """What works out the cells.

    Attributes:
        jobs: processes on this machine.
        cell_timeout_s: a cell that takes longer (s) is stopped; None for no limit.
        scheduler: address of a Dask scheduler whose workers take the place of the processes here.
    """

    jobs: int = 1
    cell_timeout_s: float | None = None
    scheduler: str | None = None

    def run(self, tasks: Sequence[CellTask]) -> Generator[CellResult, None, None]:
        """The results of the cells, as they come.

        Raises:
            EvaluationError: the scheduler cannot be reached.
        """
        if self.scheduler is None:
            return run_here(tasks, self.jobs, self.cell_timeout_s)
        return run_on_cluster(tasks, self.scheduler, self.cell_timeout_s)


def cell_tasks(
    sequences: Iterable[LabelledSequence],
    systems: Sequence[str],
    protocols: Sequence[ProtocolName],
    repetitions: int,
    settings: Settings,
) -> list[CellTask]:
    """All cells of the comparison, those of a recording together. A system without randomness says the same each time,
    so that one repetition stands for all.

    Raises:
        CompareError: an unknown system.
    """
    tasks = []
    runs = {name: repetitions if system_named(name).is_random else 1 for name in systems}
    for sequence in sequences:
        state = recording_state(sequence.recording, sequence.topic)
        for target, labels in sequence.boxes.items():
            mark = fingerprint(state, labels, settings)
            tasks += [
                CellTask(
                    Cell(sequence.dataset, sequence.name, target, system, protocol, repetition),
                    sequence.recording.resolve(),
                    sequence.topic,
                    tuple(labels),
                    settings,
                    mark,
                )
                for protocol in protocols
                for system in systems
                for repetition in range(runs[system])
            ]
    return tasks


def key_of(task: CellTask) -> CellKey:
    """What its result is kept under."""
    return task.cell, task.fingerprint


def fill_store(store: Store, tasks: Sequence[CellTask], workforce: Workforce) -> Generator[CellResult, None, None]:
    """Work out cells. Each is kept before it is handed on, so that whoever stops here, or is stopped, loses those in
    work only.

    Raises:
        EvaluationError: the store cannot be written, or the scheduler cannot be reached.
    """
    marks = {task.cell: task.fingerprint for task in tasks}
    with closing(workforce.run(tasks)) as results:
        for result in results:
            store.add(result, marks[result.cell])
            yield result


def outstanding(store: Store, tasks: Iterable[CellTask], *, retry_errors: bool = False) -> list[CellTask]:
    """The cells that the store lacks; with `retry_errors` also those that brought an error last time."""
    done = store.done(with_errors=not retry_errors)
    return [task for task in tasks if key_of(task) not in done]
