"""The order in which the demo's processes leave: two at once, and Fast DDS may never let one go."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import pytest

from etd_ros.nodes import demo
from etd_ros.nodes.programs import LEAVE, handled, postponed


class Child:
    """Stands in for a node's process, and writes down what becomes of it."""

    def __init__(self, name: str, journal: list[str], *, leaves: bool) -> None:
        self.returncode: int | None = None
        self._name = name
        self._journal = journal
        self._leaves = leaves

    def poll(self) -> int | None:
        return self.returncode

    def send_signal(self, number: int) -> None:
        self._journal.append(f"{self._name} gets {signal.Signals(number).name}")

    def kill(self) -> None:
        self._leaves = True
        self._journal.append(f"{self._name} is killed")

    def wait(self, timeout_s: float | None = None) -> int:
        if not self._leaves:
            assert timeout_s is not None, "it would be waited for without end"
            raise subprocess.TimeoutExpired(self._name, timeout_s)
        self._journal.append(f"{self._name} is gone")
        self.returncode = 0
        return 0


@pytest.fixture
def stubborn() -> set[str]:
    """Names of the nodes that do not leave when they are told to."""
    return set()


@pytest.fixture
def journal(monkeypatch, stubborn) -> list[str]:
    """What becomes of the processes that the demo starts."""
    journal: list[str] = []

    def popen(command: list[str], *, start_new_session: bool = False, **_: object) -> Child:
        assert start_new_session, "a terminal's Ctrl-C would have all nodes leave at once"
        return Child(command[3], journal, leaves=command[3] not in stubborn)

    monkeypatch.setattr(demo.subprocess, "Popen", popen)
    return journal


def test_each_process_leaves_when_the_one_started_after_it_is_gone(tmp_path, journal):
    with demo.Processes(tmp_path) as processes:
        for name in ("accumulator", "tracker"):
            processes.start(name, [])
    assert journal == ["tracker gets SIGINT", "tracker is gone", "accumulator gets SIGINT", "accumulator is gone"]


def test_one_that_does_not_leave_is_killed_before_the_next_is_told(tmp_path, journal, stubborn):
    stubborn.add("tracker")
    with demo.Processes(tmp_path) as processes:
        for name in ("accumulator", "tracker"):
            processes.start(name, [])
    assert journal[:3] == ["tracker gets SIGINT", "tracker is killed", "tracker is gone"]
    assert journal[3:] == ["accumulator gets SIGINT", "accumulator is gone"]


def test_a_process_that_was_being_started_when_the_interrupt_came_leaves_too(tmp_path, monkeypatch, journal):
    popen = demo.subprocess.Popen

    def interrupted_popen(*arguments: Any, **options: Any) -> Child:
        signal.raise_signal(signal.SIGINT)
        return popen(*arguments, **options)

    monkeypatch.setattr(demo.subprocess, "Popen", interrupted_popen)
    with handled(LEAVE, demo._interrupt), pytest.raises(KeyboardInterrupt), demo.Processes(tmp_path) as processes:
        processes.start("tracker", [])
    assert journal == ["tracker gets SIGINT", "tracker is gone"]


def test_an_interrupt_while_it_looks_after_a_process_does_not_keep_that_one_from_leaving(tmp_path, monkeypatch):
    class InterruptedLock:
        """The lock of a process as `poll` takes it, with an interrupt at the moment at which it is held."""

        def __init__(self) -> None:
            self.is_held = False

        def acquire(self, _blocking: bool) -> bool:
            self.is_held = True
            signal.raise_signal(signal.SIGTERM)
            return True

        def release(self) -> None:
            self.is_held = False

    def look_after(processes: demo.Processes, lock: InterruptedLock) -> None:
        processes.start("accumulator", [])
        child = processes._children["accumulator"]
        plain, child._waitpid_lock = child._waitpid_lock, lock
        try:
            processes.check()
        finally:
            child._waitpid_lock = plain

    popen, plainly = subprocess.Popen, "import time; time.sleep(3600)"
    monkeypatch.setattr(
        demo.subprocess, "Popen", lambda _, **options: popen([sys.executable, "-c", plainly], **options)
    )
    lock = InterruptedLock()
    with handled(LEAVE, demo._interrupt), pytest.raises(KeyboardInterrupt), demo.Processes(tmp_path) as processes:
        look_after(processes, lock)
    assert not lock.is_held
    assert not processes.running("accumulator")


def test_the_monitor_leaves_when_every_node_is_gone(tmp_path, monkeypatch, journal):
    @contextmanager
    def monitor(_: object) -> Iterator[tuple[None, None]]:
        try:
            yield None, None
        finally:
            journal.append("the monitor is gone")

    def interrupt(*_: object) -> None:
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(demo, "_use_own_domain", lambda: None)
    monkeypatch.setattr(demo, "_monitor", monitor)
    monkeypatch.setattr(demo, "Live", lambda **_: nullcontext())
    monkeypatch.setattr(demo, "_wait", interrupt)
    (tmp_path / "logs").mkdir()
    with handled(demo.HEARD, signal.SIG_DFL), pytest.raises(KeyboardInterrupt):
        demo._play_and_record(Path("recording"), Path("truth"), tmp_path, 1.0)
    assert [line for line in journal if line.endswith("gone")] == [
        "tracker is gone",
        "reconstruction is gone",
        "accumulator is gone",
        "the monitor is gone",
    ]


def test_a_signal_that_is_ignored_does_not_keep_another_one_from_being_heard():
    def hear_both() -> None:
        with handled([signal.SIGHUP], signal.SIG_IGN), handled(LEAVE, demo._interrupt), postponed(demo.HEARD):
            signal.raise_signal(signal.SIGHUP)
            signal.raise_signal(signal.SIGTERM)

    with pytest.raises(KeyboardInterrupt):
        hear_both()
