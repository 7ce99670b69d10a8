"""What a look at a target's events says."""

from __future__ import annotations

from typing import NamedTuple


class Look(NamedTuple):
    """What the events say about the target.

    Attributes:
        x, y: where it fits best (pixels).
        score: how well.
        events: how many are under the model.
        motion: how far the target moved while they came, in parts of `window_px`, 0.15 to 1.
        direction: x, y of the motion that fits the polarities best, of any length.
        scale: of the model, by which its edges are longer than at the start.
    """

    x: float
    y: float
    score: float
    events: float
    motion: float
    direction: tuple[float, float]
    scale: float = 1.0
