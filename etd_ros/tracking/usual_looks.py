"""What looks at a target usually say: the measure of whether a look is of the target."""

from __future__ import annotations

import math

from etd_ros.tracking.look import Look

EVENTS_MIN = 15.0
"""Fewer events under the model say nothing about the target."""
RATE = 0.08
CHANGE_MAX = 0.5
"""A look counts as if it were off the usual ones by this share at most: motion that was misjudged multiplies events."""


class UsualLooks:
    """Averages over the looks that were believed.

    A look is measured by its score and by the number of its events, both as if all of its window were motion: a slow
    target has fewer events, whose score grows with the root of their number. It has as many more of them as it has
    grown since its start, as its edges are longer.
    """

    def __init__(self) -> None:
        self._evidence: tuple[float, float] | None = None
        self._motion = 1.0

    def learn(self, look: Look) -> None:
        """Take a look that is believed."""
        evidence = score, events = _evidence(look, look.motion)
        usual_score, usual_events = self._evidence or evidence
        self._evidence = _nearer(usual_score, score), _nearer(usual_events, events)
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
        if self._evidence is None:
            return 1.0
        (usual_score, usual_events), (score, events) = self._evidence, _evidence(look, motion)
        return min(score / usual_score, events / usual_events)


def _nearer(usual: float, now: float) -> float:
    """An average that a look moves."""
    most = CHANGE_MAX * usual
    return usual + RATE * min(max(now - usual, -most), most)


def _evidence(look: Look, motion: float) -> tuple[float, float]:
    """The look's score and the number of its events if all of its window were motion, the latter at the size of the
    start."""
    return max(look.score / math.sqrt(motion), 1e-6), max(look.events / (motion * look.scale), 1e-6)
