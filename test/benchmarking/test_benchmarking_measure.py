"""Times taken by turns, and what is made of them."""

import numpy as np
import pytest

from etd_ros.benchmarking.comparing import MS, rows
from etd_ros.benchmarking.measure import Comparison, Subject, compare
from etd_ros.benchmarking.streams import synthetic


def logging(name: str, log: list[str]) -> Subject:
    return Subject(name, lambda: log.append(f"run {name}"), prepare=lambda: log.append(f"prepare {name}"))


def test_both_are_prepared_and_run_by_turns_and_each_goes_first_in_turn():
    log: list[str] = []
    compare(logging("a", log), logging("b", log), rounds=2)
    order = ["a", "b", *"ab", *"ba"]
    assert log == [f"{step} {name}" for name in order for step in ("prepare", "run")]


def test_the_ratio_is_the_median_of_pairs_not_of_all():
    times = Comparison(np.array([1.0, 2.0, 4.0]), np.array([3.0, 2.0, 2.0]))
    assert times.ratio == 1.0
    assert Comparison(np.array([1.0])).ratio is None


def test_the_spread_is_the_interquartile_range_over_the_median():
    assert Comparison(np.array([1.0, 2.0, 3.0, 4.0, 5.0])).spread == pytest.approx(2 / 3)


def test_a_row_a_peer_and_one_without_where_there_is_none():
    stream = synthetic("uniform", 64, 48, 100, 1e6)
    ours, peers = Subject("ours", lambda: None, 100), [Subject(name, lambda: None, 100) for name in "ab"]
    assert [row.peer for row in rows("readout", stream, ours, peers, 1)] == ["a", "b"]
    (alone,) = rows("readout", stream, ours, [], 1)
    assert (alone.peer, alone.peer_value, alone.ratio) == (None, None, None)


def test_figures_are_per_unit_and_frames_per_second_of_computing():
    stream = synthetic("uniform", 64, 48, 100, 1e6)
    ours = Subject("ours", lambda: sum(range(100_000)), 1000)
    (speed,) = rows("conversion", stream, ours, [], 3, frames=4, events=900)
    assert speed.frames_per_s == pytest.approx(speed.value * 1e6 / 1000 * 4)
    assert speed.events_per_frame == 225
    (time_ms,) = rows("readout", stream, Subject("one", ours.run), [], 1, unit=MS)
    assert time_ms.unit == "ms"
    assert time_ms.value > 0
