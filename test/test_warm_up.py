"""Kernels are ready before the first real event; test/nodes shows it with messages in fresh processes."""

import numba.core.ccallback
import numba.core.dispatcher
import pytest

from etd_ros import warm_up as module
from etd_ros.settings import STAGES
from etd_ros.warm_up import warm_up


def test_a_second_one_finds_nothing_to_compile_or_load(monkeypatch):
    warm_up()
    compiled = []
    for kind in (numba.core.dispatcher.Dispatcher, numba.core.ccallback.CFunc):
        monkeypatch.setattr(kind, "compile", lambda *arguments: compiled.append(arguments))
    warm_up()
    assert not compiled


@pytest.mark.parametrize(
    ("stages", "expected"),
    [
        (("stream", "noise_filter", "atsltd"), {"_decode", "_convert"}),
        (("stream", "reconstruction"), {"_decode", "_reconstruct"}),
        (("detection", "tracking", "contours", "recovery"), {"_track"}),
        (("discovery",), {"_discover"}),
        (tuple(STAGES), {"_decode", "_convert", "_reconstruct", "_track", "_discover"}),
        ((), set()),
    ],
)
def test_only_the_stages_asked_for_are_run(stages, expected, monkeypatch):
    ran = set()
    runs = tuple((names, lambda run=run: ran.add(run.__name__)) for names, run in module._RUNS)
    monkeypatch.setattr(module, "_RUNS", runs)
    warm_up(stages)
    assert ran == expected


def test_every_stage_is_run_by_something():
    assert frozenset().union(*(names for names, _ in module._RUNS)) == set(STAGES)
