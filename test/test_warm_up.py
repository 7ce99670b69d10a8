"""Kernels are compiled before the first real event."""

import numba.core.dispatcher

from etd_ros.warm_up import warm_up


def test_it_goes_through_every_stage_of_the_method():
    assert warm_up() > 1


def test_after_it_nothing_is_left_to_compile(monkeypatch):
    warm_up()
    compiled = []
    monkeypatch.setattr(
        numba.core.dispatcher._FunctionCompiler, "compile", lambda *arguments: compiled.append(arguments)
    )
    assert warm_up() > 1
    assert not compiled
