"""A rate that flows of edges measure, now and then."""

from __future__ import annotations


class MeasuredRate:
    """How well a rate (1/s or rad/s) is known that is measured while it wanders: a Kalman filter of it alone."""

    def __init__(self, every_s: float, unknown: float, changes: float) -> None:
        """Take nothing to be known.

        Args:
            every_s: time between measurements (s).
            unknown: how large the rate may be of which nothing is known.
            changes: by how much it may change within a second.
        """
        self._every_s, self._unknown, self._changes = every_s, unknown, changes
        self._measured_ns = 0
        self._since_s = 0.0
        self._variance = unknown**2

    def is_due(self, stamp_ns: int) -> bool:
        """Whether it is time to measure at a time (ns); if so, that is the last measurement's time from then on."""
        since_s = (stamp_ns - self._measured_ns) * 1e-9
        if since_s < self._every_s:
            return False
        self._measured_ns, self._since_s = stamp_ns, since_s
        self._variance = min(self._variance + self._changes**2 * since_s, self._unknown**2)
        return True

    def gain(self, error: float, span_s: float) -> float:
        """Which part counts of what a measurement over this time (s) is off by, 0 to 1, if it errs by `error`."""
        # Measurements of times that overlap say the same again.
        variance = error**2 * max(1.0, span_s / self._since_s)
        gain = self._variance / (self._variance + variance)
        self._variance *= 1 - gain
        return gain
