"""Cells in processes of this machine: none is lost, whoever dies, hangs or runs out of memory."""

from __future__ import annotations

import dataclasses
import os
import pickle
import resource
import select
import signal
import subprocess
import sys

import cv2
import pytest
from evaluation_sequences import blocked_sequence, tasks_of, when_read, write_sequence

from etd_ros.evaluation.cell_process import CellProcess
from etd_ros.evaluation.cell_run import CellTask, Workplace, run_cell
from etd_ros.evaluation.cells import CellResult
from etd_ros.evaluation.local import LocalProcesses, run_here


@pytest.fixture(scope="module")
def square(tmp_path_factory):
    return write_sequence(tmp_path_factory.mktemp("sequences"))


def without_time(result: CellResult) -> str:
    """As text, in which NaN equals NaN."""
    return repr(dataclasses.replace(result, seconds=0.0))


def cells_of(tasks: list[CellTask]) -> set:
    return {task.cell for task in tasks}


def test_two_processes_bring_what_one_call_after_the_other_does(square, tmp_path):
    other = write_sequence(tmp_path, "other")
    tasks = tasks_of(square, other, systems=("etd-nr", "kcf"), protocols=("one-pass", "restarts"))
    expected = {task.cell: without_time(run_cell(task, Workplace())) for task in tasks}
    found = {result.cell: without_time(result) for result in run_here(tasks, 2, None)}
    assert found == expected


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV])
def test_a_process_that_dies_over_a_cell_costs_that_cell_only(square, tmp_path, number):
    blocked = blocked_sequence(tmp_path, square)
    tasks = [*tasks_of(blocked), *tasks_of(square, systems=("etd-nr", "kcf"))]
    with LocalProcesses(jobs=1) as processes:
        killer = when_read(blocked.recording, lambda: os.kill(next(iter(processes.processes)).pid, number))
        results = {result.cell: result for result in processes.run(tasks)}
        killer.join()
    assert results.keys() == cells_of(tasks)
    errors = {cell.sequence: result.error for cell, result in results.items() if result.error}
    assert errors.keys() == {"blocked"}
    assert f"was killed by {number.name}" in errors["blocked"]


def test_a_process_that_dies_between_cells_costs_none(square):
    tasks = tasks_of(square, systems=("etd-nr", "kcf"))
    with LocalProcesses(jobs=1) as processes:
        results = processes.run(tasks)
        first = next(results)
        (process,) = processes.processes
        os.kill(process.pid, signal.SIGKILL)
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        (second,) = results
        assert process not in processes.processes
    assert (first.error, second.error) == (None, None)


def test_a_cell_that_hangs_is_stopped_and_its_process_replaced(square, tmp_path):
    blocked = blocked_sequence(tmp_path, square)
    with LocalProcesses(jobs=1, cell_timeout_s=0.5) as processes:
        (result,) = processes.run(tasks_of(blocked))
        assert "stopped after 0.5 s: allow more with --cell-timeout" in result.error
        assert all(process.has_died() for process in processes.processes)
    with LocalProcesses(jobs=1) as processes:
        (result,) = processes.run(tasks_of(square))
        assert result.error is None


def test_a_cell_that_runs_out_of_memory_costs_that_cell_only(square, tmp_path):
    large = write_sequence(tmp_path, "large", video=False)
    # Of a sensor so large that what the cell before it left in the process is not enough.
    events = large.recording / "events.txt"
    events.write_text("4096 3072\n" + events.read_text())
    (before,), (short_of_memory,) = tasks_of(square), tasks_of(large)
    process = CellProcess()
    try:
        errors = []
        for task, limit in ((before, resource.RLIM_INFINITY), (short_of_memory, 1), (before, resource.RLIM_INFINITY)):
            resource.prlimit(process.pid, resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))
            process.give(task)
            errors.append(process.take().error)
    finally:
        process.close()
    assert (errors[0], errors[2]) == (None, None)
    assert errors[1].startswith("MemoryError")


@pytest.mark.parametrize("reason", ["std::bad_alloc", "(-4:Insufficient memory) Failed to allocate 80000000 bytes"])
def test_too_little_memory_is_called_so_where_opencv_met_it_first(square, reason):
    class ShortOfMemory(Workplace):
        def recording(self, _path, _topic):
            raise cv2.error(reason)

    (task,) = tasks_of(square)
    assert run_cell(task, ShortOfMemory()).error == f"MemoryError: {reason}"


def test_a_process_that_cannot_start_says_why_in_its_cells(square, monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    (result,) = run_here(tasks_of(square), 1, None)
    assert "exit code 1" in result.error
    assert "\n" not in result.error


def test_a_process_ends_when_the_one_that_gave_it_a_cell_is_killed(square, tmp_path):
    blocked = blocked_sequence(tmp_path, square)
    program = """
import pickle, sys
from etd_ros.evaluation.cell_process import CellProcess
process = CellProcess()
process.give(pickle.load(sys.stdin.buffer))
print(process.pid, flush=True)
process.take()
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", program]
    with subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as parent:
        pickle.dump(tasks_of(blocked)[0], parent.stdin)
        parent.stdin.close()
        child = os.pidfd_open(int(parent.stdout.readline()))
        with blocked.recording.open("wb"):
            parent.kill()
            parent.wait()
            # A file descriptor of a process becomes readable when the process has ended.
            assert select.select([child], [], [], 60)[0]
    os.close(child)
