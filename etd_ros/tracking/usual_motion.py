"""How a target usually moves: the measure of whether a look may have found it."""

from __future__ import annotations

import math

from etd_ros.tracking.steady_motion import SteadyMotion

SPEED_S = 0.1
"""The usual speed is an average over this time."""
JUMP_MIN_PX, JUMP_RATE, JUMPS, JUMP_SPEEDS = 0.5, 0.08, 4.0, 2.0
"""A look that finds the target farther from where it should be than JUMPS times what is usual (an average that looks
renew by JUMP_RATE; JUMP_MIN_PX at least) is of something else, unless motion by so many times the speed explains it."""


class UsualMotion:
    """Averages over the looks that were followed.

    Attributes:
        speed_px_s: how fast the target usually is (pixels/s).
        steady: how it has moved lately, where looks were sure.
    """

    def __init__(self) -> None:
        self.speed_px_s = 0.0
        self.steady = SteadyMotion()
        self._jump_px = JUMP_MIN_PX

    def learn_speed(self, speed_px_s: float, elapsed_s: float) -> None:
        """It has been so fast (pixels/s) since the last look."""
        self.speed_px_s += (1 - math.exp(-elapsed_s / SPEED_S)) * (speed_px_s - self.speed_px_s)

    def learn_jump(self, jump_px: float) -> None:
        """A look that was believed found it so far from where it should be (pixels)."""
        self._jump_px += JUMP_RATE * (min(jump_px, JUMP_MIN_PX) - self._jump_px)

    def plausible(self, jump_px: float, speed_px_s: float, unsure_s: float) -> float:
        """How far it could be from where it should be, in parts of how far a look finds it; at most 1.

        Args:
            jump_px: how far that is (pixels).
            speed_px_s: its speed now (pixels/s); what it usually has counts as well.
            unsure_s: for how long its place has not been known (s).
        """
        could_px = max(JUMP_MIN_PX, JUMPS * self._jump_px)
        could_px += JUMP_SPEEDS * max(speed_px_s, self.speed_px_s) * unsure_s
        return could_px / max(could_px, jump_px)
