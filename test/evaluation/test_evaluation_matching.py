"""Labelled targets are held against the tracks of their names, or else those that overlap them most."""

from __future__ import annotations

import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.evaluation import EvaluationError, TimedBox, TrackRow
from etd_ros.evaluation.matching import matched_overlaps
from etd_ros.evaluation.overlaps import overlaps

CAR, VAN, AWAY = Box(10, 10, 20, 10), Box(80, 10, 20, 10), Box(200, 200, 5, 5)
HALF_CAR = Box(10, 10, 10, 10)


def track(box: Box | None, *stamps_ns: int) -> list[TrackRow]:
    return [TrackRow(stamp_ns, "any", box, 1.0, "tracking") for stamp_ns in stamps_ns or range(10)]


def labels(box: Box) -> list[TimedBox]:
    return [TimedBox(stamp_ns, box) for stamp_ns in range(10)]


def matches(tracks, truth) -> dict[str, str]:
    return {name: overlap.matched for name, overlap in matched_overlaps(tracks, truth).items()}


TRUTH = {"car": labels(CAR), "van": labels(VAN)}


def test_each_labelled_target_is_held_against_the_track_that_overlaps_it():
    found = matched_overlaps({"auto_1": track(VAN), "auto_2": track(HALF_CAR)}, TRUTH)
    assert [found[name].heading(name) for name in found] == ["car (auto_2)", "van (auto_1)"]
    np.testing.assert_allclose(found["car"].values, [0.5] * 9)
    np.testing.assert_allclose(found["van"].values, [1.0] * 9)
    assert (found["car"].score.ap, found["van"].score.ap) == (0.5, 1.0)
    assert [spell.state for spell in found["car"].spells] == ["tracking"]


def test_tracks_with_the_names_of_labels_are_held_against_those_whatever_overlaps_more():
    tracks = {"car": track(HALF_CAR), "auto_1": track(CAR), "van": track(AWAY)}
    found = matched_overlaps(tracks, TRUTH)
    assert found.keys() == overlaps(tracks, TRUTH).keys()
    for name, overlap in overlaps(tracks, TRUTH).items():
        assert found[name].heading(name) == name
        assert (found[name].values == overlap.values).all()
        assert (found[name].score, found[name].spells) == (overlap.score, overlap.spells)


def test_what_is_left_by_the_names_is_matched_among_itself():
    assert matches({"car": track(VAN), "auto_1": track(VAN)}, TRUTH) == {"car": "", "van": "auto_1"}


def test_a_track_belongs_to_one_target_and_a_target_to_one_track():
    beside = {"car": labels(CAR), "half": labels(HALF_CAR)}
    assert matches({"auto_1": track(CAR)}, beside) == {"car": "auto_1", "half": ""}
    assert matches({"auto_1": track(HALF_CAR), "auto_2": track(CAR)}, {"car": labels(CAR)}) == {"car": "auto_2"}


def test_what_covers_a_target_for_long_goes_before_what_covers_it_better_for_a_moment():
    tracks = {"auto_1": track(CAR, 0, 1), "auto_2": track(HALF_CAR, *range(2, 10))}
    found = matched_overlaps(tracks, {"car": labels(CAR)})["car"]
    assert found.matched == "auto_2"
    np.testing.assert_allclose(found.values, [0] + [0.5] * 8)


@pytest.mark.parametrize("tracks", [{}, {"auto_1": track(AWAY)}, {"auto_1": track(None)}, {"auto_1": track(CAR, 10)}])
def test_what_never_overlaps_is_no_pair(tracks):
    found = matched_overlaps(tracks, TRUTH)
    assert [found[name].heading(name) for name in found] == ["car", "van"]
    assert not any(overlap.values.any() for overlap in found.values())


def test_the_first_label_that_is_not_scored_makes_no_pair():
    moved_on = [*track(CAR, 0), *track(AWAY, 1)]
    assert matches({"auto_1": moved_on}, TRUTH) == {"car": "", "van": ""}


def test_a_track_that_was_dropped_while_others_go_on_has_no_box_any_more():
    found = matched_overlaps({"auto_1": track(CAR, 0, 1, 2, 3), "auto_2": track(VAN)}, TRUTH)["car"]
    np.testing.assert_allclose(found.values, [1, 1, 1, 0, 0, 0, 0, 0, 0])
    assert [(spell.start_ns, spell.end_ns) for spell in found.spells] == [(0, 4)]


def test_the_last_box_of_a_recording_holds_for_the_labels_after_it():
    found = matched_overlaps({"auto_1": track(CAR, 0, 8), "auto_2": track(VAN, 0, 8)}, TRUTH)
    assert all(overlap.values.all() for overlap in found.values())


def test_truth_that_cannot_be_scored_is_refused():
    for truth in ({}, {"car": labels(CAR)[:1]}):
        with pytest.raises(EvaluationError):
            matched_overlaps({"auto_1": track(CAR)}, truth)
