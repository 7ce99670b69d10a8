"""Cells on a Dask cluster of real processes on loopback: a scheduler and two workers, one of which is killed."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import dask
import pytest
from evaluation_sequences import blocked_sequence, tasks_of, when_read, write_sequence

from etd_ros.evaluation import EvaluationError
from etd_ros.evaluation.cluster import run_on_cluster
from etd_ros.evaluation.matrix import Workforce, fill_store, outstanding
from etd_ros.evaluation.store import Store


@contextmanager
def running(*command: str) -> Iterator[subprocess.Popen]:
    """A Dask process in a group of its own, all of which is ended in the end."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with subprocess.Popen(
        [sys.executable, "-m", *command], env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            yield process
        finally:
            os.killpg(process.pid, signal.SIGKILL)


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[str, int]]:
    """Address and process id of a scheduler with workers; every second one has a nanny, and so no children by
    `multiprocessing`."""
    here = ("--host", "127.0.0.1", "--no-dashboard")
    with ExitStack() as stack:
        scheduler = stack.enter_context(running("distributed.cli.dask_scheduler", *here, "--port", "0"))
        address = next(found[0] for line in scheduler.stderr if (found := re.search(r"tcp://127\.0\.0\.1:\d+", line)))
        for number in range(workers):
            nanny = "--nanny" if number % 2 else "--no-nanny"
            place = ("--nthreads", "1", "--local-directory", str(folder), nanny)
            stack.enter_context(running("distributed.cli.dask_worker", address, *here, *place))
        yield address, scheduler.pid


def reader_of(pipe: Path) -> int:
    """The process that has a pipe open to read."""
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            try:
                files = [str(file.readlink()) for file in (entry / "fd").iterdir()]
            except OSError:
                continue
            if str(pipe) in files:
                return int(entry.name)
    raise AssertionError(pipe)


def parent_of(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


def test_a_worker_that_is_killed_over_a_cell_costs_none(tmp_path):
    square = write_sequence(tmp_path, "square")
    blocked = blocked_sequence(tmp_path, square)
    tasks = [*tasks_of(blocked), *tasks_of(square, systems=("etd-nr", "kcf"), protocols=("one-pass", "restarts"))]
    killed = []

    def kill_worker() -> None:
        killed.append(parent_of(reader_of(blocked.recording)))
        # Who does the cell again finds a recording where the first one hung.
        whole = tmp_path / "whole.txt"
        whole.write_bytes((square.recording / "events.txt").read_bytes())
        whole.replace(blocked.recording)
        os.kill(killed[0], signal.SIGKILL)

    with cluster(tmp_path, 2) as (address, _), Store(tmp_path / "cells.sqlite") as store:
        killer = when_read(blocked.recording, kill_worker)
        results = list(fill_store(store, tasks, Workforce(scheduler=address)))
        killer.join()
        assert len(killed) == 1
        assert {result.cell for result in results} == {task.cell for task in tasks}
        assert [result.error for result in results] == [None] * 5
        assert outstanding(store, tasks) == []


def test_a_cell_that_hangs_or_fails_on_a_worker_leaves_it_fit_for_others(tmp_path):
    square = write_sequence(tmp_path, "square", video=False)
    (hanging,), (failing, good) = (
        tasks_of(blocked_sequence(tmp_path, square)),
        tasks_of(square, systems=("kcf", "etd-nr")),
    )
    with cluster(tmp_path, 1) as (address, _):
        (hung,) = run_on_cluster([hanging], address, 0.5)
        assert "was stopped after 0.5 s" in hung.error
        results = {result.cell: result.error for result in run_on_cluster([failing, good], address, None)}
    assert "needs video" in results[failing.cell]
    assert results[good.cell] is None


def test_a_scheduler_that_is_not_there_is_one_line():
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
    patience = dask.config.set({"distributed.comm.timeouts.connect": "200ms"})
    with patience, pytest.raises(EvaluationError, match="cannot be reached") as caught:
        list(run_on_cluster([], address, None))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("address", ["foo", "tcp://foo", "tcp://foo:", "foo bar:1", ""])
def test_what_is_no_address_is_refused(address):
    with pytest.raises(EvaluationError, match="is no address"):
        list(run_on_cluster([], address, None))


def test_a_scheduler_that_goes_is_one_line(tmp_path, capfd):
    square = write_sequence(tmp_path, "square")
    blocked = blocked_sequence(tmp_path, square)
    with cluster(tmp_path, 1) as (address, scheduler):
        killer = when_read(blocked.recording, lambda: os.kill(scheduler, signal.SIGKILL))
        patience = dask.config.set({"distributed.comm.timeouts.connect": "200ms"})
        with patience, pytest.raises(EvaluationError, match="has gone: start it and run evaluate again"):
            list(run_on_cluster(tasks_of(blocked), address, None))
        killer.join()
    assert capfd.readouterr().err == ""
