"""What looks at a target usually say: the measure of whether a look is of the target."""

from __future__ import annotations

import numpy as np

from etd_ros.tracking.contour_kernels import Float64Array
from etd_ros.tracking.contours import Look

EVENTS_MIN = 15.0
"""Fewer events under the model say nothing about the target."""
RATE = 0.08
CHANGE_MAX = 0.5
"""A look counts as if it were off the usual ones by this share at most: motion that was misjudged multiplies events."""


class UsualLooks:
    """Averages over the looks that were believed.

    A look is measured by its score and by the number of its events, both as if all of its window were motion: a slow
    target has fewer events, whose score grows with the root of their number.
    """

    def __init__(self) -> None:
        self._evidence: Float64Array | None = None
        self._motion = 1.0

    def learn(self, look: Look) -> None:
        """Take a look that is believed."""
        evidence = _evidence(look, look.motion)
        if self._evidence is None:
            self._evidence = evidence
        most = CHANGE_MAX * self._evidence
        self._evidence += RATE * np.clip(evidence - self._evidence, -most, most)
        self._motion += RATE * (look.motion - self._motion)

    def confidence(self, look: Look) -> float:
        """A look in parts of the usual ones: its score or the number of its events, whichever is less. Things in front
        bring events elsewhere, or none. It is 1 where no look is known."""
        return self._share(look, look.motion)

    def confidence_of_lost(self, look: Look) -> float:
        """The same of a look for a lost target, whose motion is not known: no less than its usual motion counts, or few
        events of anything would be many."""
        return self._share(look, max(look.motion, self._motion))

    def _share(self, look: Look, motion: float) -> float:
        return 1.0 if self._evidence is None else float((_evidence(look, motion) / self._evidence).min())


def _evidence(look: Look, motion: float) -> Float64Array:
    return np.maximum([look.score / np.sqrt(motion), look.events / motion], 1e-6)
