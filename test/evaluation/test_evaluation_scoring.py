"""AP and AR, against hand values and against their definition in plain Python."""

from __future__ import annotations

import bisect
import random

import pytest

from etd_ros.boxes import Box
from etd_ros.evaluation import EvaluationError, Score, TimedBox, TrackRow, mean_score, score

BOX = Box(10, 10, 20, 10)


def said(stamp_ns: int, box: Box | None, target: str = "a") -> TrackRow:
    return TrackRow(stamp_ns, target, box, 1.0, "tracking")


def labels(*stamps_ns: int, box: Box = BOX) -> list[TimedBox]:
    return [TimedBox(stamp_ns, box) for stamp_ns in stamps_ns]


def test_the_first_label_is_not_scored():
    assert score({"a": [said(2, BOX)]}, {"a": labels(1, 2)}) == {"a": Score(1.0, 1.0, 1)}


def test_a_label_is_compared_with_the_last_row_at_or_before_it():
    half = Box(10, 10, 10, 10)
    track = [said(2, BOX), said(3, half), said(3, BOX), said(5, half)]
    assert score({"a": track}, {"a": labels(1, 2, 3, 4, 5)}) == {"a": Score(3.5 / 4, 1.0, 4)}


def test_no_row_yet_and_no_box_score_zero():
    track = [said(3, BOX), said(4, None)]
    assert score({"a": track}, {"a": labels(1, 2, 3, 4)}) == {"a": Score(1 / 3, 1 / 3, 3)}


def test_a_target_that_was_not_tracked_scores_zero_and_counts_in_the_mean():
    scores = score({"a": [said(0, BOX)]}, {"a": labels(1, 2), "b": labels(1, 2, 3)})
    assert scores["b"] == Score(0.0, 0.0, 2)
    assert mean_score(scores) == Score(0.5, 0.5, 3)


def test_overlaps_below_one_half_are_no_success():
    third = Box(20, 10, 20, 10)
    assert score({"a": [said(0, third)]}, {"a": labels(1, 2)}) == {"a": Score(1 / 3, 0.0, 1)}


def test_boxes_that_do_not_touch_score_zero():
    assert score({"a": [said(0, Box(100, 100, 5, 5))]}, {"a": labels(1, 2)}) == {"a": Score(0.0, 0.0, 1)}


def test_nothing_to_score_is_refused():
    with pytest.raises(EvaluationError, match="no target"):
        score({}, {})
    with pytest.raises(EvaluationError, match="'a' has a single label"):
        score({}, {"a": labels(1)})
    with pytest.raises(EvaluationError, match="no scores"):
        mean_score({})


def literal_score(track: list[TrackRow], truth: list[TimedBox]) -> tuple[float, float]:
    """The definition in plain Python: one label after another."""
    overlaps = []
    for label in truth[1:]:
        index = bisect.bisect_right([row.stamp_ns for row in track], label.stamp_ns) - 1
        box = track[index].box if index >= 0 else None
        if box is None:
            overlaps.append(0.0)
            continue
        w = min(box.x + box.w, label.box.x + label.box.w) - max(box.x, label.box.x)
        h = min(box.y + box.h, label.box.y + label.box.h) - max(box.y, label.box.y)
        area = w * h if w > 0 and h > 0 else 0.0
        overlaps.append(area / (box.w * box.h + label.box.w * label.box.h - area))
    return sum(overlaps) / len(overlaps), sum(value >= 0.5 for value in overlaps) / len(overlaps)


@pytest.mark.parametrize("seed", range(5))
def test_scores_equal_the_plain_definition_to_the_last_bit(seed):
    rng = random.Random(seed)

    def near() -> Box:
        return Box(rng.uniform(0, 9), rng.uniform(0, 9), rng.uniform(5, 30), rng.uniform(5, 30))

    names = ["a", "b", "c"]
    stamps = {name: sorted(rng.randrange(1000) for _ in range(200)) for name in names}
    tracks = {
        name: [said(stamp_ns, None if rng.random() < 0.2 else near(), name) for stamp_ns in stamps[name]]
        for name in names
    }
    truth = {name: [TimedBox(stamp_ns, near()) for stamp_ns in range(0, 1100, 7)] for name in names}
    for name, value in score(tracks, truth).items():
        assert (value.ap, value.ar) == literal_score(tracks[name], truth[name])
