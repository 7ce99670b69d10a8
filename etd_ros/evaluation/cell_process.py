"""A process of its own for cells: one that crashes, hangs or eats all memory takes nothing else with it.

It is a child started by command, not a `multiprocessing.Process`: those may not be had by the daemonic processes that
workers of a Dask cluster are.
"""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from etd_ros.evaluation.cell_run import CellTask
    from etd_ros.evaluation.cells import CellResult

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Libraries read them when they are imported, so they are set before the process starts."""
ERROR_TAIL_BYTES = 4096
DEATH_S = 10.0
"""A process that has let go of its connection ends within this time, or is ended."""


class CellProcess:
    """A process that works out one cell after another, seen from the one that gives them out.

    A group of its own keeps Ctrl-C from it: it ends when its giver does, whose end of the connection closes then.

    Args:
        threads: how many threads libraries may use.

    Attributes:
        connection: readable when the task in work is done, or the process is dead.
        task: the one in work.
        started_s: when it was given (time.monotonic).
    """

    def __init__(self, threads: int = 1) -> None:
        self.connection, child = Pipe()
        self.task: CellTask | None = None
        self.started_s = 0.0
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the process
        variables = dict.fromkeys(THREAD_VARIABLES, str(threads))
        # A child finds the package where its parent did, whatever folder either is in.
        variables["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
        with child:
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__, str(child.fileno()), str(threads)],
                pass_fds=[child.fileno()],
                env={**os.environ, **variables},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=self._errors,
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def has_died(self) -> bool:
        """Whether it is there no more, whoever ended it."""
        return self._process.poll() is not None

    def give(self, task: CellTask) -> None:
        """Have it work out a cell."""
        self.task, self.started_s = task, time.monotonic()
        # One that dies while it is given a task is one that dies over it: `take` says how.
        with suppress(OSError):
            self.connection.send(task)

    def take(self) -> CellResult:
        """The result of the task in work, once the connection is readable. Of a process that died instead, the
        result's error says how."""
        task, self.task = self._task(), None
        try:
            result: CellResult = self.connection.recv()
        except (EOFError, OSError):
            return _failed(task, self._manner_of_death())
        return result

    def give_up(self, limit_s: float) -> CellResult:
        """Kill it over the task in work, which took longer than a limit (s); the result's error says so."""
        task, self.task = self._task(), None
        self._process.kill()
        self._process.wait()
        return _failed(task, f"was stopped after {limit_s:g} s: allow more with --cell-timeout")

    def close(self) -> None:
        """End the process, whatever it does, and let go of what it held."""
        self._process.kill()
        self._process.wait()
        self.connection.close()
        self._errors.close()

    def _manner_of_death(self) -> str:
        try:
            code = self._process.wait(DEATH_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        said = self._last_words()
        return _manner(code) + (f" ({said})" if said else "")

    def _task(self) -> CellTask:
        if self.task is None:
            msg = "no cell is in work in this process"
            raise RuntimeError(msg)
        return self.task

    def _last_words(self) -> str:
        """The last line that it wrote to standard error."""
        size = self._errors.seek(0, os.SEEK_END)
        self._errors.seek(max(0, size - ERROR_TAIL_BYTES))
        lines = self._errors.read().decode(errors="replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), "")


def _manner(code: int) -> str:
    """A return code of `Popen` in words."""
    if code >= 0:
        return f"its process ended by itself with exit code {code}"
    name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
    why = ", as where memory runs out" if -code == signal.SIGKILL else ""
    return f"its process was killed by {name}{why}"


def _failed(task: CellTask, error: str) -> CellResult:
    from etd_ros.evaluation.cell_run import failed_cell

    return failed_cell(task.cell, error)


def work(connection: Connection, threads: int) -> None:
    """Work out the cells that come, until the connection closes."""
    import cv2

    from etd_ros.evaluation.cell_run import Workplace, run_cell

    cv2.setNumThreads(threads)
    tasks: queue.SimpleQueue[CellTask] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(connection, tasks), daemon=True).start()
    workplace = Workplace()
    while True:
        connection.send(run_cell(tasks.get(), workplace))


def _receive(connection: Connection, tasks: queue.SimpleQueue[CellTask]) -> None:
    """Hand on what comes. When the giver is gone, end at once: nobody waits for the cell in work any more."""
    while True:
        try:
            tasks.put(connection.recv())
        except (EOFError, OSError):
            os._exit(0)


if __name__ == "__main__":
    work(Connection(int(sys.argv[1])), int(sys.argv[2]))
