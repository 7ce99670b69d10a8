"""Average precision and average robustness (paper Sec. 4.1), for boxes that come at times of their own."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from etd_ros.boxes import Box
from etd_ros.evaluation.table import EvaluationError
from etd_ros.evaluation.tracks import TrackRow
from etd_ros.evaluation.truth import TimedBox

SUCCESS_IOU = 0.5
"""A labelled time is a success from this IoU on (paper Sec. 4.1)."""


@dataclass(frozen=True, slots=True)
class Score:
    """How well a target was tracked.

    Attributes:
        ap: average precision, the mean IoU over the labelled times.
        ar: average robustness, the share of them with an IoU of at least 0.5.
        n: number of labelled times scored.
    """

    ap: float
    ar: float
    n: int


def score(tracks: Mapping[str, Sequence[TrackRow]], truth: Mapping[str, Sequence[TimedBox]]) -> dict[str, Score]:
    """Score of each labelled target, by name.

    One pass, causal, no re-initialisation: a label is compared with the target's last row at or before it; no row
    yet, or a row without a box, is an IoU of 0. The first label is what the tracker started from and is not scored.
    Both arguments hold rows in order of time.

    Raises:
        EvaluationError: no target, or one with fewer than two labels.
    """
    if not truth:
        msg = "the truth holds no target: there is nothing to score"
        raise EvaluationError(msg)
    return {name: _score_target(name, tracks.get(name, ()), truth[name]) for name in sorted(truth)}


def boxes_at(track: Sequence[TrackRow], labels: Sequence[TimedBox]) -> list[Box | None]:
    """The box in the track's last row at or before each label; None without a row, or without a box in it. Both
    arguments hold rows in order of time."""
    stamps = [row.stamp_ns for row in track]
    rows = (bisect_right(stamps, label.stamp_ns) - 1 for label in labels)
    return [track[row].box if row >= 0 else None for row in rows]


def label_overlaps(track: Sequence[TrackRow], labels: Sequence[TimedBox]) -> list[float]:
    """IoU of each label with the track's last row at or before it; 0 without a row, or without a box in it. Both
    arguments hold rows in order of time."""
    return [overlap(box, label) for box, label in zip(boxes_at(track, labels), labels, strict=True)]


def overlap(box: Box | None, label: TimedBox) -> float:
    """IoU of a box with a label; 0 without a box."""
    return 0.0 if box is None else box.iou(label.box)


def score_of(overlaps: Sequence[float]) -> Score:
    """AP and AR of one target from its overlaps at the labelled times, one or more."""
    n = len(overlaps)
    return Score(ap=sum(overlaps) / n, ar=sum(value >= SUCCESS_IOU for value in overlaps) / n, n=n)


def mean_score(scores: Mapping[str, Score]) -> Score:
    """Mean over the targets, each with the same weight; n is the sum.

    Raises:
        EvaluationError: no scores.
    """
    if not scores:
        msg = "no scores to average: score at least one target"
        raise EvaluationError(msg)
    values = scores.values()
    return Score(
        ap=sum(value.ap for value in values) / len(scores),
        ar=sum(value.ar for value in values) / len(scores),
        n=sum(value.n for value in values),
    )


def _score_target(name: str, track: Sequence[TrackRow], truth: Sequence[TimedBox]) -> Score:
    labels = truth[1:]
    if not labels:
        msg = f"target {name!r} has a single label, from which the tracker starts: label it at two times or more"
        raise EvaluationError(msg)
    return score_of(label_overlaps(track, labels))
