"""Overlap over time follows the rules of the scoring, with the states between."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.boxes import Box
from etd_ros.evaluation import EvaluationError, TimedBox, TrackRow
from etd_ros.evaluation.overlaps import Spell, overlaps, true_box

BOX, HALF = Box(10, 10, 20, 10), Box(10, 10, 10, 10)


def said(stamp_ns: int, box: Box | None, state: str = "tracking") -> TrackRow:
    return TrackRow(stamp_ns, "a", box, 1.0, state)


def labels(*stamps_ns: int) -> list[TimedBox]:
    return [TimedBox(stamp_ns, BOX) for stamp_ns in stamps_ns]


def test_each_label_is_held_against_the_last_row_at_or_before_it():
    found = overlaps({"a": [said(2, BOX), said(4, HALF), said(6, None)]}, {"a": labels(0, 1, 2, 3, 4, 5, 6, 7)})["a"]
    np.testing.assert_array_equal(found.stamps_ns, [1, 2, 3, 4, 5, 6, 7])
    np.testing.assert_allclose(found.values, [0, 1, 1, 0.5, 0.5, 0, 0])
    assert found.stamps_ns.dtype == np.int64


@settings(deadline=None, max_examples=50)
@given(st.lists(st.tuples(st.integers(0, 50), st.sampled_from([BOX, HALF, None])), max_size=20))
def test_its_mean_is_the_average_precision_and_its_successes_the_robustness(rows):
    track = [said(stamp_ns, box) for stamp_ns, box in sorted(rows, key=lambda row: row[0])]
    found = overlaps({"a": track}, {"a": labels(*range(0, 50, 7))})["a"]
    assert found.score.ap == pytest.approx(found.values.mean())
    assert found.score.ar == pytest.approx((found.values >= 0.5).mean())
    assert found.score.n == len(found.values)


def test_states_last_until_the_first_row_of_another():
    states = ["idle", "tracking", "tracking", "recovering", "lost", "lost", "tracking"]
    track = [said(10 * index, BOX, state) for index, state in enumerate(states)]
    assert overlaps({"a": track}, {"a": labels(0, 9)})["a"].spells == (
        Spell(0, 10, "idle"),
        Spell(10, 30, "tracking"),
        Spell(30, 40, "recovering"),
        Spell(40, 60, "lost"),
        Spell(60, 60, "tracking"),
    )


def test_tracks_without_states_or_rows_have_no_spells():
    truth = {"b": labels(0, 9), "a": labels(0, 9)}
    found = overlaps({"a": [said(0, BOX, ""), said(1, BOX, "")]}, truth)
    assert list(found) == ["b", "a"]
    assert found["a"].spells == found["b"].spells == ()
    assert found["b"].values.tolist() == [0]


def test_truth_that_cannot_be_scored_is_refused():
    for truth in ({}, {"a": labels(0)}):
        with pytest.raises(EvaluationError):
            overlaps({}, truth)


def test_a_true_box_lies_between_its_labels_unless_they_are_far_apart():
    truth = [
        TimedBox(100, Box(0, 0, 10, 10)),
        TimedBox(200, Box(10, 20, 20, 10)),
        TimedBox(300_000_000, Box(5, 5, 5, 5)),
    ]
    assert true_box(truth, 99) is None
    assert true_box(truth, 100) == Box(0, 0, 10, 10)
    assert true_box(truth, 150) == Box(5, 10, 15, 10)
    assert true_box(truth, 200) == Box(10, 20, 20, 10)
    assert true_box(truth, 201) is None
    assert true_box(truth, 300_000_000) == Box(5, 5, 5, 5)
    assert true_box(truth, 300_000_001) is None
    assert true_box([], 1) is None
