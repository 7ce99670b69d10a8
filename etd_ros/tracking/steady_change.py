"""How fast a part of a pose changes: turning (rad/s) or growing (1/s, of the logarithm of the scale)."""

from __future__ import annotations

import math

AGREEING_S = 0.2
AGREEING, EACH_AGREEING = 3.0, 2.5
"""The sum of the misfits of about so long has to be so many times the root of the sum of their squares; the second for
each of two parts, which hardly agree both by chance."""
AVERAGE_S = 0.05
"""A rate is an average over this time at least."""
DECAY_S = 1.0
TOLD_GAIN = 0.5
"""How much of what something else than looks says is off is a misfit of the rate."""


class _Agreement:
    """Whether misfits of a while have one sign, more clearly than by chance.

    Attributes:
        total: their sum.
    """

    def __init__(self) -> None:
        self.total = self._squares = 0.0

    def take(self, misfit: float, kept: float) -> None:
        """Take the next one; of those before so much counts."""
        self.total = kept * self.total + misfit
        self._squares = kept * self._squares + misfit**2

    def is_clear(self, times: float) -> bool:
        """Whether their sum is more than so many times the root of the sum of their squares."""
        return abs(self.total) > times * math.sqrt(self._squares)


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
        self._whole, self._parts = _Agreement(), (_Agreement(), _Agreement())

    def doubt_if_below_0(self) -> None:
        """What seemed to become less has become more: believe half of the rate."""
        if self.per_s < 0:
            self.per_s /= 2

    def correct(self, misfit: float) -> None:
        """Take what something else than looks says that the part is off by: it knows at once what looks have to agree
        about. They still have to, before they change what it says."""
        self._is_told_alone = self._is_told_alone or self.per_s == 0
        self.per_s += TOLD_GAIN * misfit / AVERAGE_S

    def learn(
        self,
        misfit: float,
        elapsed_s: float,
        parts: tuple[float, float] = (0.0, 0.0),
        *,
        parts_agree: bool = False,
    ) -> bool:
        """Take what a look says that the part is off by.

        Args:
            misfit: so much.
            elapsed_s: so long after the last look (s).
            parts: the two that it is made of, if it is.
            parts_agree: whether each of the two has to agree for itself, and with the other one: what is made of both
                may have one sign by how it is made.

        Returns:
            Whether looks are believed.
        """
        kept = math.exp(-elapsed_s / AGREEING_S)
        self._whole.take(misfit, kept)
        for agreement, part in zip(self._parts, parts, strict=True):
            agreement.take(part, kept)
        has_to_agree = self.per_s == 0 or self._is_told_alone
        agrees = not has_to_agree or (self._parts_agree() if parts_agree else self._whole.is_clear(AGREEING))
        if agrees:
            self._is_told_alone = False
            self.per_s += self._gain * misfit / (elapsed_s + AVERAGE_S)
        self.per_s *= math.exp(-elapsed_s / DECAY_S)
        return agrees

    def _parts_agree(self) -> bool:
        one, other = self._parts
        return one.is_clear(EACH_AGREEING) and other.is_clear(EACH_AGREEING) and one.total * other.total > 0
