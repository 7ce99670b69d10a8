"""Labelled targets and tracks that name them otherwise, such as `auto_1`: which belong together tells their overlap."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import replace

from etd_ros.evaluation.overlaps import TargetOverlap, overlaps
from etd_ros.evaluation.scoring import label_overlaps, score_of
from etd_ros.evaluation.tracks import TrackRow
from etd_ros.evaluation.truth import TimedBox

Tracks = Mapping[str, Sequence[TrackRow]]
Truth = Mapping[str, Sequence[TimedBox]]


def matched_overlaps(tracks: Tracks, truth: Truth) -> dict[str, TargetOverlap]:
    """Overlap over time of each labelled target, by name, in the truth's order, whatever its track is called.

    A labelled target is held against the track of its name. Those without one are held against the tracks that nothing
    is labelled as, one each: the pair with the highest AP belongs together first, so that what covers a target for long
    goes before what covers it well for a moment. A pair that never overlaps is none. A matched track that ends before
    the others has no box from then on.

    Args:
        tracks: rows in order of time.
        truth: labels in order of time.

    Raises:
        EvaluationError: no target, or one with fewer than two labels.
    """
    unlabelled = {name: _until_dropped(track, tracks) for name, track in tracks.items() if track and name not in truth}
    matches = _matches(unlabelled, {name: labels for name, labels in truth.items() if name not in tracks})
    held = {**tracks, **{name: unlabelled[matched] for name, matched in matches.items()}}
    return {name: replace(overlap, matched=matches.get(name, "")) for name, overlap in overlaps(held, truth).items()}


def _matches(tracks: Tracks, truth: Truth) -> dict[str, str]:
    """The track, by name, that each labelled target belongs to."""
    pairs = [
        (score_of(values).ap, name, tracked)
        for name, labels in truth.items()
        for tracked, track in tracks.items()
        if any(values := label_overlaps(track, labels[1:]))
    ]
    matches: dict[str, str] = {}
    for _, name, tracked in sorted(pairs, key=lambda pair: -pair[0]):
        if name not in matches and tracked not in matches.values():
            matches[name] = tracked
    return matches


def _until_dropped(track: Sequence[TrackRow], tracks: Tracks) -> list[TrackRow]:
    """The track; where others go on, it ends with a row without a box, so that its last box is not held for ever."""
    last = track[-1]
    later_ns = [
        rows[after].stamp_ns for rows in tracks.values() if (after := _first_after(rows, last.stamp_ns)) < len(rows)
    ]
    dropped = [TrackRow(min(later_ns), last.target, None, 0.0, "")] if later_ns else []
    return [*track, *dropped]


def _first_after(rows: Sequence[TrackRow], stamp_ns: int) -> int:
    return bisect_right(rows, stamp_ns, key=lambda row: row.stamp_ns)
