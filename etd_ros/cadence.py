"""What is made of a stream now and then only: pictures for eyes, images to search."""

from __future__ import annotations

NS_PER_S = 1_000_000_000


class Cadence:
    """The first moment in each interval of the clock is due: whoever sees the same stamps knows which, without asking.

    Args:
        interval_s: length of an interval (s); 0: every moment is due.
    """

    def __init__(self, interval_s: float) -> None:
        self._interval_ns = round(interval_s * NS_PER_S)
        self._newest: int | None = None

    def is_due(self, now_ns: int) -> bool:
        """Whether the next moment (ns, on any clock) is due; a clock that goes back starts anew."""
        if not self._interval_ns:
            return True
        interval, self._newest = self._newest, now_ns // self._interval_ns
        return interval != self._newest
