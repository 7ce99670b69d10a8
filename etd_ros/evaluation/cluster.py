"""Cells on the workers of a Dask cluster. Only this module imports Dask (extra `cluster`)."""

from __future__ import annotations

import logging
import queue
import re
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import wait
from typing import Any

from etd_ros.evaluation.cell_process import CellProcess
from etd_ros.evaluation.cell_run import CellTask, failed_cell
from etd_ros.evaluation.cells import CellResult
from etd_ros.evaluation.table import EvaluationError

SCHEDULER = re.compile(r"(\w+://)?[^\s/]+:\d+")
_idle: queue.LifoQueue[CellProcess] = queue.LifoQueue()
"""On a worker: its processes for cells that have nothing to do, each with the recording that it read last."""


def run_on_cluster(
    tasks: Sequence[CellTask], address: str, cell_timeout_s: float | None
) -> Generator[CellResult, None, None]:
    """The results of the cells, as they come.

    The workers need this package, and the recordings under the same paths. The cell in work on a worker that dies is
    done again by another one; Dask gives up a cell over which worker after worker dies (its setting
    `distributed.scheduler.allowed-failures`), and that is the cell's result then.

    Args:
        tasks: the cells.
        address: the scheduler's, as in tcp://10.0.0.7:8786.
        cell_timeout_s: a cell that takes longer (s) is stopped; None for no limit.

    Raises:
        EvaluationError: Dask is missing, or the scheduler cannot be reached or has gone.
    """
    client_of, as_completed = _dask()
    check_address(address)
    try:
        client = client_of(address, set_as_default=False)
    except (OSError, ValueError) as err:
        msg = f"--scheduler {address}: cannot be reached ({err}): give the address that dask scheduler prints"
        raise EvaluationError(msg) from err
    with _quiet(), client:
        of_future = {client.submit(run_in_process, task, cell_timeout_s, pure=False): task for task in tasks}
        for future in as_completed(of_future, loop=client.loop):
            # A future that nobody holds lets the cluster forget its result.
            yield _result(future, of_future.pop(future), address)


def check_address(address: str) -> None:
    """Refuse what can be no scheduler's address. Dask finds out, too, but then takes a minute to end.

    Raises:
        EvaluationError: it is none.
    """
    if not SCHEDULER.fullmatch(address):
        msg = f"--scheduler {address}: is no address: give the one that dask scheduler prints, as tcp://10.0.0.7:8786"
        raise EvaluationError(msg)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep what Dask logs of a connection that breaks, pages of it, from standard error: one line says it."""
    loggers = [logging.getLogger(name) for name in ("distributed", "distributed.client")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _dask() -> tuple[Any, Any]:
    try:
        from distributed import Client, as_completed
    except ImportError as err:
        msg = "--scheduler needs Dask: pip install 'etd_ros[cluster]', or pip install distributed"
        raise EvaluationError(msg) from err
    return Client, as_completed


def _result(future: Any, task: CellTask, address: str) -> CellResult:
    if future.status == "finished":
        result: CellResult = future.result()
        return result
    if future.status == "error":
        return failed_cell(task.cell, f"its worker failed: {future.exception()}")
    msg = f"--scheduler {address}: has gone: start it and run evaluate again, what is done is kept"
    raise EvaluationError(msg)


def run_in_process(task: CellTask, cell_timeout_s: float | None) -> CellResult:
    """On a worker: work out a cell in a process beside it, so that what crashes or hangs does not take the worker, and
    with it cells of others, along."""
    try:
        process = _idle.get_nowait()
    except queue.Empty:
        process = CellProcess()
    if process.has_died():
        process.close()
        process = CellProcess()
    process.give(task)
    if cell_timeout_s is not None and not wait([process.connection], cell_timeout_s):
        result = process.give_up(cell_timeout_s)
    else:
        result = process.take()
    _idle.put(process)
    return result
