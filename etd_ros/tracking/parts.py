"""Targets that started by themselves on parts of one object.

A wheel or a shadow is often seen before the car is: its target would follow it for ever, and keep the car from being
started. So what is seen larger there, look after look, takes its place.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from etd_ros.boxes import Box
from etd_ros.tracking.auto_candidates import Candidate
from etd_ros.tracking.discovery import shared
from etd_ros.tracking.own_targets import OwnTarget

AGE_MAX_S = 1.5
"""What was followed for longer by itself is no part: it would have been seen as a whole by then."""
INSIDE, LARGER = 0.7, 1.4
"""A part lies in the whole by so much of its area, and the whole is so many times larger."""
LOOKS_MIN, SEEN_MIN_S = 4, 0.08
"""It has lain there in so many looks in a row, over so long: things that pass one another are one for a moment."""
BESIDE_SHARED = 0.5
"""What overlaps the whole by this share of the smaller box, and is no part, is another object: there is no whole."""
STRAY_PX, STRAY_SHARE = 6.0, 0.25
"""Parts of a whole stay as far from one another as they were, to this and this share of its longer side."""
ALIKE_PX_S, ALIKE_SHARE = 25.0, 0.3
"""Any two of them move alike, to this and this share of the fastest of all."""


@dataclass(frozen=True, slots=True)
class Whole:
    """What targets are parts of.

    Attributes:
        names: of those targets, the oldest first.
        box: where it is (pixels).
    """

    names: list[str]
    box: Box


def wholes(candidates: Iterable[Candidate], own: Sequence[OwnTarget], others: Sequence[Box]) -> list[Whole]:
    """What targets that started by themselves have turned out to be parts of, each target in one of them at most.

    Args:
        candidates: what the last look has seen.
        own: those targets, as far as they are tracked, in the order of their start.
        others: the boxes (pixels) of the targets that started otherwise.
    """
    found: list[Whole] = []
    free = list(own)
    for candidate in sorted(candidates, key=lambda candidate: -candidate.looks):
        parts = _parts(candidate, free, own, others)
        if parts:
            found.append(Whole([part.name for part in parts], candidate.sighting.box))
            free = [target for target in free if target not in parts]
            candidate.inside = {}
    return found


def _parts(
    candidate: Candidate, free: Sequence[OwnTarget], own: Sequence[OwnTarget], others: Sequence[Box]
) -> list[OwnTarget]:
    """The targets that a candidate is the whole of, if it is one."""
    box = candidate.sighting.box
    parts = [target for target in own if target.age_s <= AGE_MAX_S and _is_in(target.box, box)]
    candidate.hold([part.name for part in parts])
    beside = [*others, *(target.box for target in own if target not in parts)]
    if not parts or not candidate.is_steady or any(shared(other, box) > BESIDE_SHARED for other in beside):
        return []
    stray_px = STRAY_PX + STRAY_SHARE * max(box.w, box.h)
    keep = all(part.strayed_px(parts[0]) <= stray_px for part in parts)
    is_seen = all(_is_long(candidate.inside[part.name]) for part in parts)
    return parts if is_seen and keep and _move_alike(parts) and all(part in free for part in parts) else []


def _is_in(box: Box, whole: Box) -> bool:
    """Whether a box lies in a whole as parts do."""
    area = box.w * box.h
    return whole.w * whole.h >= LARGER * area and shared(box, whole) >= INSIDE


def _is_long(looks_ns: Sequence[int]) -> bool:
    return len(looks_ns) >= LOOKS_MIN and looks_ns[-1] - looks_ns[0] >= SEEN_MIN_S * 1e9


def _move_alike(parts: Sequence[OwnTarget]) -> bool:
    velocities = np.array([part.velocity for part in parts])
    differences = np.hypot(*(velocities[:, None] - velocities).T)
    return bool(differences.max() <= ALIKE_PX_S + ALIKE_SHARE * np.hypot(*velocities.T).max())
