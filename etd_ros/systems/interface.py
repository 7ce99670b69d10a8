"""What a compared system offers: a box for each picture, or boxes as events come."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.errors import EtdError
from etd_ros.events import Events

Picture = npt.NDArray[np.uint8]
"""Grey, uint8 of shape (height, width), or colour in OpenCV's order, uint8 of shape (height, width, 3)."""


class CompareError(EtdError):
    """A compared system that is unknown or cannot be built, or input that it cannot be given."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Where a system sees its target.

    Attributes:
        box: the target's box (pixels), None where the system says that it has lost it.
        score: how sure it is, 0 to 1; NaN for systems that do not say.
    """

    box: Box | None
    score: float


class PictureTracker(Protocol):
    """Follows one target from picture to picture. One instance serves one target, from one start on."""

    def start(self, picture: Picture, box: Box) -> None:
        """The target is at `box` (pixels) in this picture, which may be reused by the caller."""
        ...

    def update(self, picture: Picture) -> Answer:
        """Where it is in the next picture, of the same size."""
        ...


class EventTracker(Protocol):
    """Follows one target on the events themselves. One instance serves one target, from one start on."""

    def start(self, stamp_ns: int, box: Box) -> None:
        """The target is at `box` (pixels) at this time (ns)."""
        ...

    def update(self, events: Events) -> Iterator[tuple[int, Answer]]:
        """Answers, each with its time (ns), as the next events bring them. Events before the start prepare only."""
        ...
