"""How fast a target grows, by the flow of its edges.

Looks hardly tell: the model of a thing that comes nearer is found again on the edge that moves most, and what the
others do is taken for a poor fit. The flow needs no model, and says how far it is to be believed. But it takes in all
edges in the box, of what covers the target or lies behind it as well: it counts where there are few round it, or where
all edges agree so well that they are of one thing.
"""

from __future__ import annotations

import math

from etd_ros.boxes import Box
from etd_ros.tracking.edge_flow import EdgeFlow
from etd_ros.tracking.known_growth import KnownGrowth, error_by_all
from etd_ros.tracking.measured_rate import MeasuredRate
from etd_ros.tracking.other_targets import OtherBoxes
from etd_ros.tracking.surface import TimeSurface, Window
from etd_ros.tracking.surface_kernels import count_within

FLOW_MARGIN_PX = 2.0
"""How far round a box its own edges lie."""
ERRORS, ERROR_FLOOR_PER_S = 3.0, 0.1
"""The flow is off by so many times its standard error, as neighbours go wrong together, and by so much besides."""
START_SPAN_S = 0.1
"""A start takes the flow of so much time, if it lasts as long."""
START_ERRORS, START_MOVED_PX = 4.0, 1.0
"""What starts grows if that is so many standard errors from 0, and has moved its outline by so much."""
START_USUAL_PER_S = 0.5
"""How fast things usually grow: less sure flows are believed by less."""
START_SHARE_MIN = 0.2
"""What is believed by less is not worth a change of the start."""
MEASURE_S = 0.02
SPAN_PX, SPAN_MIN_S, SPAN_MAX_S = 6.0, 0.01, 0.3
"""The flow of so much motion is taken. Of less, only the fastest edges have come far enough to be seen."""
MOVED_MIN_PX = 2.0
ERROR_MAX_PER_S = 0.15
"""A flow with a larger standard error is not asked."""
SURE_PER_S = 0.1
"""A flow is sure whose standard error is no larger, also by whole edges: what covers a target, or lies behind it, has
edges that do not go with the others."""
RING_SCALE, RING_PX, RING_MAX = 1.2, 4.0, 0.15
"""Where there are more events in a ring than this share of those in the box, for each pixel, the edges in the box may
be those of what lies behind. The ring is so wide, as the surface is kept up to date no farther out, round the box so
many times as wide and high, which leaves room for what has outgrown it."""
UNKNOWN_PER_S, CHANGES_PER_S = 1.5, 1.6
"""How fast a target may grow of which nothing is known, and by how much that may change within a second."""


def arm_px(width_px: float, height_px: float) -> float:
    """How far a box's outline is from its middle, usually (pixels)."""
    return (width_px + height_px) / 4


def growth_trust(flow: EdgeFlow, arm_px: float, time_s: float) -> float:
    """How far the flow of a target's edges is believed to tell how fast it has grown since its start, 0 to 1; 0 where
    it may as well not grow, or the flow is hardly believed.

    Args:
        flow: of its edges.
        arm_px: how far its outline is from its middle (pixels).
        time_s: since its start (s).
    """
    growing_per_s = flow.growing_per_s
    has_moved = abs(growing_per_s) * arm_px * time_s >= START_MOVED_PX
    # Few edges may go wrong together, however many flows they have.
    if not has_moved or abs(growing_per_s) < START_ERRORS * error_by_all(flow):
        return 0.0
    share = 1 / (1 + (_error(flow) / START_USUAL_PER_S) ** 2)
    return share if share > START_SHARE_MIN else 0.0


class GrowthByFlow:
    """Puts the rate of growth of a target right while it is followed, once it is known to grow, by the lesser of two
    flows that agree about its sign. Of what does not, the edges of what covers it would be taken for its own."""

    def __init__(self, *, grows: bool = False, is_new: bool = False) -> None:
        """Begin.

        Args:
            grows: whether the target is known to grow.
            is_new: whether it has just started.
        """
        self._known = KnownGrowth(grows=grows, is_new=is_new)
        self._rate = MeasuredRate(MEASURE_S, UNKNOWN_PER_S, CHANGES_PER_S)
        self._last_per_s: float | None = None

    @property
    def is_known(self) -> bool:
        """Whether the target is known to grow."""
        return self._known.is_known

    def correction(
        self,
        surface: TimeSurface,
        box: Box,
        place: tuple[float, float],
        speed_px_s: float,
        growing_per_s: float,
        covered: float,
    ) -> float:
        """What to add to the rate of growth (1/s).

        Args:
            surface: the events.
            box: the target's (pixels).
            place: x, y of its middle (pixels).
            speed_px_s: how fast it moves.
            growing_per_s: how fast it is taken to grow (1/s).
            covered: how surely something covers it, 0 to 1: what is covered seems to shrink.
        """
        may_grow = self._known.may_be(surface.stamp_ns, growing_per_s, covered)
        if not may_grow or not self._rate.is_due(surface.stamp_ns):
            return 0.0
        arm = arm_px(box.w, box.h)
        fastest_px_s = max(speed_px_s, abs(growing_per_s) * arm, 1e-3)
        span_s = min(max(SPAN_PX / fastest_px_s, SPAN_MIN_S), SPAN_MAX_S)
        flow = surface.flow(surface.window(box, FLOW_MARGIN_PX), span_s, *place, by_edge=True)
        self._known.learn(flow)
        is_sure = flow is not None and error_by_all(flow) <= SURE_PER_S
        if flow is not None and not (self._known.is_known and (is_sure or _may_be_own(flow, surface, box, span_s))):
            flow = None
        last_per_s, self._last_per_s = self._last_per_s, None if flow is None else flow.growing_per_s
        if flow is None or last_per_s is None:
            return 0.0
        moved_px = math.hypot(*flow.velocity.tolist(), flow.growing_per_s * arm) * span_s
        more, more_before = flow.growing_per_s - growing_per_s, last_per_s - growing_per_s
        if moved_px < MOVED_MIN_PX or more * more_before <= 0:
            return 0.0
        share = 1.0 if is_sure else 1 - covered
        return share * self._rate.gain(_error(flow), span_s) * min(more, more_before, key=abs)


def _may_be_own(flow: EdgeFlow, surface: TimeSurface, box: Box, span_s: float) -> bool:
    """Whether a flow that is not sure may be of the edges of a box's target alone."""
    return flow.growing_error <= ERROR_MAX_PER_S and stands_alone(surface, box, span_s)


def stands_alone(
    surface: TimeSurface, box: Box, span_s: float, around_max: float = RING_MAX, others: OtherBoxes | None = None
) -> bool:
    """Whether there are few events of the last `span_s` round a box: for each pixel at most so many times as many as in
    it. Those of others are left out, if they are given."""
    own = surface.window(box, 0.0)
    within, wide = (surface.window(box.scaled(RING_SCALE), margin) for margin in (0.0, RING_PX))
    events, events_within, events_wide = _counts_of(surface, (own, within, wide), span_s, others)
    around = (events_wide - events_within) / max(1, _pixels(wide) - _pixels(within))
    return around <= around_max * events / max(1, _pixels(own))


def _counts_of(
    surface: TimeSurface, windows: tuple[Window, Window, Window], span_s: float, others: OtherBoxes | None
) -> list[int]:
    """`count_of` for windows that lie in the last one of them."""
    if others is None or others.are_far:
        return [surface.count(window, span_s) for window in windows]
    points, count = surface.points(windows[-1], span_s)
    if count == len(points):
        # There may be more of them.
        return [count_of(surface, window, span_s, others) for window in windows]
    count = others.leave_out(points, count, surface.stamp_ns)
    return [count_within(points, count, *window) for window in windows]


def count_of(surface: TimeSurface, window: Window, span_s: float, others: OtherBoxes | None) -> int:
    """How many events of a window are at most so old; those of others are left out, if they are given."""
    if others is None or others.are_far:
        return surface.count(window, span_s)
    points, count = surface.points(window, span_s)
    return others.leave_out(points, count, surface.stamp_ns)


def _pixels(window: Window) -> int:
    top, bottom, left, right = window
    return (bottom - top) * (right - left)


def _error(flow: EdgeFlow) -> float:
    """How far off a flow's rate of growth is to be expected (1/s)."""
    return ERRORS * flow.growing_error + ERROR_FLOOR_PER_S
