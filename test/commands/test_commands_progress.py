"""The progress line: what it counts, and that logs are spared it."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from etd_ros.commands.progress import with_compile_notice, with_image_progress, with_progress
from etd_ros.events import Events
from etd_ros.recordings.interface import RecordedImage
from etd_ros.stream import StreamBatch

SECOND_NS = 1_000_000_000


def batch(start_ns: int, count: int) -> StreamBatch:
    times_ns = np.linspace(start_ns, start_ns + SECOND_NS, count).astype(np.int64)
    column = np.zeros(count, np.uint16)
    events = Events(x=column, y=column, t=times_ns, p=column.astype(np.uint8), width=1, height=1)
    return StreamBatch(events, None)


BATCHES = [batch(0, 60_000), batch(SECOND_NS, 40_000)]
IMAGES = [RecordedImage(number * SECOND_NS, "camera", np.zeros((1, 1), np.uint8)) for number in (5, 6, 8)]
PROGRESS = [(with_progress, BATCHES, "0.10 M events, 2.0 s"), (with_image_progress, IMAGES, "3 video frames, 3.0 s")]


@pytest.mark.parametrize(("progress", "items", "said"), PROGRESS)
def test_what_is_taken_is_counted_where_somebody_watches(monkeypatch, capsys, progress, items, said):
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress(items, "tracking") as counted:
        assert list(counted) == items
    assert f"tracking: {said} recorded" in capsys.readouterr().err


@pytest.mark.parametrize(("progress", "items", "said"), PROGRESS)
def test_a_log_is_spared_it(capsys, progress, items, said):
    with progress(items, "tracking") as counted:
        assert list(counted) == items
    assert capsys.readouterr().err == ""


def compile_two():
    for kernel in (lambda: 1, lambda: 2):
        njit(kernel)()


def test_who_watches_is_told_once_that_kernels_are_compiled(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    with with_compile_notice():
        assert capsys.readouterr().err == ""
        compile_two()
    assert capsys.readouterr().err.count("Compiling") == 1
    compile_two()
    assert capsys.readouterr().err == ""


def test_a_log_is_not_told_that_kernels_are_compiled(capsys):
    with with_compile_notice():
        compile_two()
    assert capsys.readouterr().err == ""
