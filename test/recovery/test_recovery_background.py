"""The network is loaded and run in a thread of its own, and changes nothing for the process that it serves."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
import threading
from pathlib import Path

import numpy as np
import pytest
from recovery_scenes import picture, texture

from etd_ros.boxes import Box
from etd_ros.recovery import RecoveryConfig, RecoveryError, make_recovery, making, network_is_there
from etd_ros.recovery.matching import COMPACT_GEOMETRY, Answers, BackgroundMatcher
from etd_ros.recovery.siamese import SiameseRecovery
from etd_ros.recovery.weights_file import SHIPPED

START = Box(60, 70, 40, 36)


def run_alone(code: str) -> None:
    """Run statements in a process of their own."""
    subprocess.run([sys.executable, "-c", textwrap.dedent(code)], check=True, cwd=Path(__file__).parents[2])


def test_torch_is_imported_only_for_a_network():
    run_alone("""
        import sys
        import etd_ros.engine, etd_ros.cli
        from etd_ros.recovery import RecoveryConfig, make_recovery
        make_recovery(RecoveryConfig(tracker="csrt"))()
        assert "torch" not in sys.modules
        """)


def test_the_threads_of_torch_stay_those_of_the_process_that_uses_it():
    run_alone("""
        import threading
        import torch
        from etd_ros.recovery.making import _load
        torch.set_num_threads(3)
        inside, later = [], []
        def load():
            _load("compact", "")
            inside.append(torch.get_num_threads())
        for work in (load, lambda: later.append(torch.get_num_threads())):
            thread = threading.Thread(target=work)
            thread.start()
            thread.join()
        assert inside == [1], inside
        assert later == [3], later
        assert torch.get_num_threads() == 3
        """)


def test_no_garbage_is_looked_for_in_what_torch_brings():
    run_alone("""
        import gc
        from etd_ros.recovery.making import _load
        looked = []
        gc.callbacks.append(lambda phase, info: looked.append(info["generation"]))
        _load("compact", "")
        assert 2 not in looked, looked
        assert gc.isenabled()
        assert gc.get_freeze_count() > 100_000
        """)


class _Late:
    """A matcher that is there once it is let."""

    geometry = COMPACT_GEOMETRY

    def __init__(self, may_come: threading.Event) -> None:
        may_come.wait()
        self.thread = threading.current_thread()

    def template(self, exemplar, size):
        return threading.current_thread() is self.thread

    def match(self, window, templates, distractors=()):
        return Answers(np.zeros((len(templates), 1, 1), np.float32), np.zeros((len(templates), 4, 1, 1), np.float32))


def test_nobody_waits_for_the_network_but_who_asks_it():
    may_come = threading.Event()
    matcher = BackgroundMatcher(COMPACT_GEOMETRY, lambda: _Late(may_come))
    tracker = SiameseRecovery(matcher, RecoveryConfig())
    image = picture((texture(1, 40, 36), START))
    tracker.remember(image, START)
    may_come.set()
    assert tracker.search(image, START) is None
    assert matcher.template(image, (1.0, 1.0))


def test_whether_the_network_is_there_is_known_after_a_while_at_most(monkeypatch):
    may_come = threading.Event()
    matcher = BackgroundMatcher(COMPACT_GEOMETRY, lambda: _Late(may_come))
    monkeypatch.setattr(making, "_network", lambda *_: matcher)
    config = RecoveryConfig(tracker="compact")
    assert not network_is_there(config, 0.0)
    may_come.set()
    assert network_is_there(config, 60.0)
    assert network_is_there(RecoveryConfig(tracker="csrt"), 0.0)


def test_what_went_wrong_in_loading_is_told_to_who_asks():
    def load():
        msg = "no weights"
        raise RecoveryError(msg)

    tracker = SiameseRecovery(BackgroundMatcher(COMPACT_GEOMETRY, load), RecoveryConfig())
    image = picture((texture(1, 40, 36), START))
    tracker.remember(image, START)
    for _ in range(2):
        with pytest.raises(RecoveryError, match="no weights"):
            tracker.search(image, START)


def test_a_torch_that_cannot_be_imported_is_told_in_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "etd_ros.recovery.matchers", None)
    with pytest.raises(RecoveryError, match=r"'compact': torch or safetensors cannot be imported \(.*choose another"):
        making._load("compact", "")


def test_trackers_made_anew_share_a_network_until_its_file_is_written_again(tmp_path):
    path = tmp_path / "compact.safetensors"
    path.write_bytes(SHIPPED.read_bytes())
    config = RecoveryConfig(tracker="compact", compact_model=str(path))
    first, second = (make_recovery(config)()._matcher for _ in range(2))
    assert first is second
    os.utime(path, ns=(0, 0))
    assert make_recovery(config)()._matcher is not first
