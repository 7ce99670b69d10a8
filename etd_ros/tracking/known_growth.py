"""Whether a target is known to grow or shrink, so that the flow of its edges is believed about how fast."""

from __future__ import annotations

from etd_ros.tracking.edge_flow import EdgeFlow

GROWING_PER_S = 0.5
"""What grows so fast by its looks, and is not covered, is known to grow."""
NEW_S, NEW_SURE_PER_S, NEW_GROWING_PER_S, NEW_AGREEING = 0.6, 0.06, 0.15, 3
"""So is what has just started, which is hardly covered yet, where so many flows in a row, with no larger standard
errors, say that it grows at least so fast, or all that it shrinks: what comes near slowly has moved its outline too
little when it starts."""


def error_by_all(flow: EdgeFlow) -> float:
    """A flow's standard error of growing, also by whole edges (1/s)."""
    return max(flow.growing_error, flow.growing_error_by_edge)


class KnownGrowth:
    """Of what is not known to grow, the edges of what covers it would be taken for its own.

    Args:
        grows: whether it is known to.
        is_new: whether the target has just started.
    """

    def __init__(self, *, grows: bool, is_new: bool) -> None:
        self.is_known = grows
        self._is_new = is_new
        self._new_until_ns: int | None = None
        self._agreeing = 0

    def may_be(self, stamp_ns: int, growing_per_s: float, covered: float) -> bool:
        """Whether a flow could tell anything at a time (ns) of a target that is taken to grow so fast (1/s) and to be
        covered, 0 to 1."""
        if self._new_until_ns is None:
            self._new_until_ns = stamp_ns + round(NEW_S * 1e9)
        self.is_known = self.is_known or (covered == 0 and abs(growing_per_s) >= GROWING_PER_S)
        return self.is_known or (self._is_new and covered == 0 and stamp_ns < self._new_until_ns)

    def learn(self, flow: EdgeFlow | None) -> None:
        """Count the flows in a row that say surely that it grows, or all that it shrinks."""
        if flow is None or error_by_all(flow) > NEW_SURE_PER_S or abs(flow.growing_per_s) < NEW_GROWING_PER_S:
            self._agreeing = 0
            return
        way = 1 if flow.growing_per_s > 0 else -1
        self._agreeing = self._agreeing + way if self._agreeing * way >= 0 else way
        self.is_known = self.is_known or abs(self._agreeing) >= NEW_AGREEING
