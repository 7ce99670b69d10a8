"""How tracks agree with the truth over time, by the rules of the scoring."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.evaluation.scoring import Score, label_overlaps, score
from etd_ros.evaluation.tracks import TrackRow
from etd_ros.evaluation.truth import TimedBox

LABEL_GAP_MAX_NS = 250_000_000
"""Labels further apart than this say nothing about the time between them: the target may have been hidden."""


@dataclass(frozen=True, slots=True)
class Spell:
    """A time during which a target was in one state, from its first row to the first row in another state (ns)."""

    start_ns: int
    end_ns: int
    state: str


@dataclass(frozen=True, slots=True)
class TargetOverlap:
    """A target's overlap with the truth over time.

    Attributes:
        stamps_ns: the labelled times that are scored (ns), int64, shape (n,).
        values: IoU at each of them with the last row at or before it, float64, shape (n,).
        spells: the states that the target went through, in order; none where the tracks have no states.
        score: mean of the values, and the share of successes.
        matched: the track's name where it was found by its overlap; empty where it is that of the labels.
    """

    stamps_ns: npt.NDArray[np.int64]
    values: npt.NDArray[np.float64]
    spells: tuple[Spell, ...]
    score: Score
    matched: str = ""

    def heading(self, name: str) -> str:
        """The labelled target's name, and that of the track where it is another: `car_1 (auto_2)`."""
        return f"{name} ({self.matched})" if self.matched else name


def overlaps(
    tracks: Mapping[str, Sequence[TrackRow]], truth: Mapping[str, Sequence[TimedBox]]
) -> dict[str, TargetOverlap]:
    """Overlap over time of each labelled target, by name, in the truth's order.

    The rules are those of `score`: one pass, causal, and the first label is not counted. Both arguments hold rows in
    order of time.

    Raises:
        EvaluationError: no target, or one with fewer than two labels.
    """
    scores = score(tracks, truth)
    return {name: _overlap(tracks.get(name, ()), labels[1:], scores[name]) for name, labels in truth.items()}


def true_box(labels: Sequence[TimedBox], stamp_ns: int) -> Box | None:
    """Where a target is at a time (ns), interpolated between the labels before and after it.

    Args:
        labels: in order of time.
        stamp_ns: the time (ns).

    Returns:
        None outside the labels, and between labels that are more than 0.25 s apart.
    """
    after = bisect_right(labels, stamp_ns, key=lambda label: label.stamp_ns)
    if after == 0:
        return None
    before = labels[after - 1]
    if before.stamp_ns == stamp_ns:
        return before.box
    if after == len(labels) or labels[after].stamp_ns - before.stamp_ns > LABEL_GAP_MAX_NS:
        return None
    share = (stamp_ns - before.stamp_ns) / (labels[after].stamp_ns - before.stamp_ns)
    return Box(*(a + share * (b - a) for a, b in zip(before.box, labels[after].box, strict=True)))


def _overlap(track: Sequence[TrackRow], labels: Sequence[TimedBox], of_target: Score) -> TargetOverlap:
    stamps_ns = np.array([label.stamp_ns for label in labels], np.int64)
    return TargetOverlap(stamps_ns, np.array(label_overlaps(track, labels), np.float64), _spells(track), of_target)


def _spells(track: Sequence[TrackRow]) -> tuple[Spell, ...]:
    runs = [(state, [row.stamp_ns for row in rows]) for state, rows in groupby(track, lambda row: row.state)]
    ends_ns = [*(stamps_ns[0] for _, stamps_ns in runs[1:]), track[-1].stamp_ns] if track else []
    return tuple(
        Spell(stamps_ns[0], end_ns, state) for (state, stamps_ns), end_ns in zip(runs, ends_ns, strict=True) if state
    )
