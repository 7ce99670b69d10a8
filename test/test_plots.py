"""Plots are PNG files that show what they are given."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from etd_ros.evaluation import Score
from etd_ros.evaluation.overlaps import Spell, TargetOverlap
from etd_ros.plots import OVERLAP_COLOUR, PlotError, overlap_png

S = 1_000_000_000
RECOVERING, LOST = (255, 236, 178), (247, 178, 177)
"""The shades on white: red, green, blue."""


def overlap(value: float = 0.8, labels: int = 200, spells=()) -> TargetOverlap:
    """A second of labels with this overlap."""
    stamps_ns = np.linspace(0, S, labels).astype(np.int64)
    return TargetOverlap(stamps_ns, np.full(labels, value), tuple(spells), Score(value, 1.0, labels))


def pixels(overlaps, title: str = "tracks.csv") -> np.ndarray:
    png = np.frombuffer(overlap_png(overlaps, title), np.uint8)
    return cv2.cvtColor(cv2.imdecode(png, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def is_near(picture: np.ndarray, colour, tolerance: int = 6) -> np.ndarray:
    return (np.abs(picture.astype(int) - colour) <= tolerance).all(axis=2)


def is_curve(picture: np.ndarray) -> np.ndarray:
    return is_near(picture, [int(OVERLAP_COLOUR[start : start + 2], 16) for start in (1, 3, 5)], 40)


def lines(picture: np.ndarray) -> list[int]:
    """Rows that a long flat curve goes along, one for each curve."""
    rows = np.flatnonzero(is_curve(picture).sum(axis=1) > 300)
    return [int(row) for index, row in enumerate(rows) if index == 0 or row > rows[index - 1] + 1]


@pytest.mark.parametrize("count", [1, 3, 8])
def test_every_target_has_a_panel_with_its_curve(count):
    picture = pixels({f"target_{index}": overlap() for index in range(count)})
    assert len(lines(picture)) == count
    assert picture.shape[1] == 770
    assert picture.shape[0] > 100 * count


def test_many_targets_stand_in_columns():
    picture = pixels({f"target_{index}": overlap() for index in range(20)})
    assert len(lines(picture)) == 7
    assert picture.shape[1] == 3 * 770


def test_a_higher_overlap_is_drawn_higher_and_none_at_the_bottom_is_seen():
    high, low = (lines(pixels({"a": overlap(value)}))[0] for value in (1.0, 0.0))
    assert low - high > 80


@pytest.mark.parametrize("hidden_s", [0.2, 0.4])
def test_times_without_labels_have_no_curve(hidden_s):
    hidden = overlap()
    kept = (hidden.stamps_ns < 0.3 * S) | (hidden.stamps_ns > (0.3 + hidden_s) * S)
    hidden = TargetOverlap(hidden.stamps_ns[kept], hidden.values[kept], (), hidden.score)
    whole, broken = (pixels({"a": shown}) for shown in (overlap(), hidden))
    row = lines(whole)[0]
    drawn, expected = (is_curve(picture)[row].sum() for picture in (broken, whole))
    assert drawn / expected == pytest.approx(1 - hidden_s, abs=0.04)


def test_labels_that_lie_far_apart_one_and_all_have_one_curve():
    sparse = overlap(labels=6)
    row = lines(pixels({"a": overlap()}))[0]
    drawn, expected = (is_curve(pixels({"a": shown}))[row].sum() for shown in (sparse, overlap()))
    assert drawn >= expected
    one_missing = TargetOverlap(np.delete(sparse.stamps_ns, 2), np.delete(sparse.values, 2), (), sparse.score)
    assert is_curve(pixels({"a": one_missing}))[row].sum() / expected == pytest.approx(0.6, abs=0.04)


def test_times_of_recovery_and_loss_are_shaded():
    spells = [Spell(0, S // 4, "tracking"), Spell(S // 4, S // 2, "recovering"), Spell(S // 2, S, "lost")]
    shaded = pixels({"a": overlap(0.0, spells=spells)})
    widths = [is_near(shaded, colour).sum(axis=1).max() for colour in (RECOVERING, LOST)]
    assert widths[0] > 150
    assert widths[1] / widths[0] == pytest.approx(2, abs=0.1)
    plain = pixels({"a": overlap(0.0)})
    assert is_near(plain, RECOVERING).sum(axis=1).max() < 100, "shaded without a reason"


def test_scores_and_names_are_written():
    one, other = (pixels({"a": overlap()}, title) for title in ("one.csv", "other.csv"))
    assert (one[:60] != other[:60]).any()
    better = pixels({"a": dataclasses.replace(overlap(), score=Score(0.9, 1.0, 9))}, "one.csv")
    assert (one != better).any()


def test_the_name_of_a_matched_track_is_written_beside_that_of_the_labels():
    named, matched = (pixels({"a": dataclasses.replace(overlap(), matched=track)}) for track in ("", "auto_1"))
    assert (named != matched).any()
    alone = pixels({"a (auto_1)": overlap()})
    assert (alone == matched).all()


def test_no_targets_or_too_many_are_refused():
    for count in (0, 65):
        with pytest.raises(PlotError, match=f"{count} targets"):
            overlap_png({str(index): overlap(labels=2) for index in range(count)}, "")
