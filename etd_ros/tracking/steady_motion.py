"""How a target usually moves, so that what covers it is not taken for it."""

from __future__ import annotations

import math

from etd_ros.tracking.body import Velocity, nearer

STEADY_S = 1.0
"""What has been seen surely for so long, in all since it was found, is known to go on: most things change sooner."""
SPAN_S = 0.3
"""Mean and spread are averages over this time."""
SPREADS, SLACK_PX_S, SLACK_SHARE = 8.0, 8.0, 0.03
"""A velocity strays that is farther from the mean than so many spreads, than this, and than this share of it."""
STRAY_SHARE = 0.7
"""One that strays counts as if it were off by this share of what is plausible: the mean follows a change, slowly."""


class SteadyMotion:
    """Mean and spread of a target's velocity.

    Attributes:
        velocity: the mean.
        seen_s: for how long it has been seen surely since that was forgotten (s).
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """What was seen last says nothing of how the target moves now."""
        self.velocity: Velocity = (0.0, 0.0)
        self._variance = 0.0
        self.seen_s = 0.0

    def plausible(self, velocity: Velocity) -> float:
        """How far from its mean the target's velocity could be, in parts of how far this one is; at most 1."""
        if self.seen_s < STEADY_S:
            return 1.0
        could_px_s = self._could_px_s()
        return could_px_s / max(could_px_s, math.dist(velocity, self.velocity))

    def learn(self, velocity: Velocity, elapsed_s: float) -> None:
        """The target was seen to move at a velocity for a time; none has passed where time went back."""
        if elapsed_s <= 0:
            return
        if self.seen_s == 0:
            self.velocity = velocity
        self.seen_s += elapsed_s
        rate = min(1.0, elapsed_s / min(self.seen_s, SPAN_S))
        off_px_s, most_px_s = math.dist(velocity, self.velocity), STRAY_SHARE * self._could_px_s()
        if self.seen_s >= STEADY_S and off_px_s > most_px_s:
            velocity = nearer(self.velocity, velocity, most_px_s / off_px_s)
            off_px_s = most_px_s
        self.velocity = nearer(self.velocity, velocity, rate)
        self._variance += rate * (off_px_s**2 - self._variance)

    def _could_px_s(self) -> float:
        return max(SPREADS * math.sqrt(self._variance), SLACK_PX_S, SLACK_SHARE * math.hypot(*self.velocity))
