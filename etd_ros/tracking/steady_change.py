"""How fast a part of a pose changes: turning (rad/s) or growing (1/s, of the logarithm of the scale)."""

from __future__ import annotations

import math

AGREEING_S = 0.2
AGREEING = 3.0
"""The sum of the misfits of about so long has to be so many times the root of the sum of their squares."""
AVERAGE_S = 0.05
"""A rate is an average over this time at least."""
DECAY_S = 1.0
TOLD_GAIN = 0.5
"""How much of what something else than looks says is off is a misfit of the rate."""


class SteadyChange:
    """Learns a rate from what looks say that a part is off by.

    Looks do not begin it, nor change what `correct` has begun, until the misfits of a while agree: noise must not turn
    what does not turn.

    Attributes:
        per_s: the rate.
    """

    def __init__(self, gain: float) -> None:
        self._gain = gain
        self.stop()

    def stop(self) -> None:
        """Nothing changes any more."""
        self.per_s = 0.0
        self._is_told_alone = False
        self._sum = self._squares = 0.0

    def doubt_if_below_0(self) -> None:
        """What seemed to become less has become more: believe half of the rate."""
        if self.per_s < 0:
            self.per_s /= 2

    def correct(self, misfit: float) -> None:
        """Take what something else than looks says that the part is off by: it knows at once what looks have to agree
        about. They still have to, before they change what it says."""
        self._is_told_alone = self._is_told_alone or self.per_s == 0
        self.per_s += TOLD_GAIN * misfit / AVERAGE_S

    def learn(self, misfit: float, elapsed_s: float) -> bool:
        """Take what a look says that the part is off by, so long after the last one; whether looks are believed."""
        kept = math.exp(-elapsed_s / AGREEING_S)
        self._sum = kept * self._sum + misfit
        self._squares = kept * self._squares + misfit**2
        has_to_agree = self.per_s == 0 or self._is_told_alone
        agrees = not has_to_agree or abs(self._sum) > AGREEING * math.sqrt(self._squares)
        if agrees:
            self._is_told_alone = False
            self.per_s += self._gain * misfit / (elapsed_s + AVERAGE_S)
        self.per_s *= math.exp(-elapsed_s / DECAY_S)
        return agrees
