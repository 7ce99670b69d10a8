"""What the tracker asks of whoever finds a lost target again on the reconstructed images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.errors import EtdError

WIDER_SEARCHES = 9
"""The region of a target that is lost, or has left, grows as if there were so many searches more: it may come in at the
other side of the sensor."""


class RecoveryError(EtdError):
    """A recovery tracker that cannot be built, or an image that does not fit it."""


@dataclass(frozen=True, slots=True)
class Found:
    """Where a lost target was found.

    Attributes:
        box: the target's box on the searched image (pixels).
        score: how sure the tracker is, 0 to 1.
    """

    box: Box
    score: float


class RecoveryTracker(Protocol):
    """Finds one target again after its tracking failed, or (`watch`) after it has drifted. One instance serves one
    target."""

    @property
    def has_lead(self) -> bool:
        """Whether the last search saw what may be the target, which images soon after it have to confirm."""
        ...

    def remember(self, image: npt.NDArray[np.uint8], box: Box) -> None:
        """The target is seen here and its tracking is right. `image` is uint8, shape (h, w), and may be reused."""
        ...

    def search(self, image: npt.NDArray[np.uint8], last_box: Box) -> Found | None:
        """Look for the target; `last_box` is its last box. None: it was not found convincingly."""
        ...

    def look_wider(self) -> None:
        """The target is lost, or has left: the next search may look much farther from its last box."""
        ...

    def forget_lately(self) -> None:
        """What was remembered last was not the target: keep what it looked like at first alone."""
        ...

    def watch(self) -> RecoveryTracker | None:
        """Another tracker for the same target: it remembers what the target looks like at first, and searches round the
        box that is followed while nothing says that it is lost. None: this one cannot be as sure as that."""
        ...


def check_image(image: npt.NDArray[np.uint8]) -> None:
    """Refuse what is no grey image.

    Raises:
        RecoveryError: not uint8 of shape (h, w), or empty.
    """
    if image.ndim != 2 or image.dtype != np.uint8 or not image.size:
        msg = f"recovery searches grey images, uint8 of shape (height, width), not {image.dtype} {image.shape}"
        raise RecoveryError(msg)
