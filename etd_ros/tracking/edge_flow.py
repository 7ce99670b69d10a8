"""How what is in a window moves and grows, told from the flow of its edges, without a model.

An edge passes one pixel after the other, so that the last event times of the pixels round one lie on a plane, and its
slope is how slowly the edge comes along (Benosman et al. 2014, Event-Based Visual Flow). That is the motion across the
edge alone. Edges that lie in several directions tell the whole of it, and those on opposite sides whether it grows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from etd_ros.tracking.contour_kernels import Float64Array
from etd_ros.tracking.edge_flow_kernels import COLUMNS, PARTS, PARTS_TURNING, errors_by_edge, flows_of, motion_of

FLOWS_MAX, FLOWS_MIN = 400, 20
"""More event pixels than the first are thinned out; fewer than the second tell nothing."""


class EdgeFlow(NamedTuple):
    """The motion that goes best with the flow of the edges: velocity x, y (pixels/s), how fast it grows (1/s, of the
    logarithm of the scale), and the standard error of that; how far the edges' speeds usually are from it (pixels/s);
    how fast it turns (rad/s) and the standard error of that, 0 where it may not; and the standard error of growing if
    the flows of an edge go wrong together (`errors_by_edge`), 0 where that was not asked for."""

    velocity: Float64Array
    growing_per_s: float
    growing_error: float
    spread_px_s: float = 0.0
    turning_rad_s: float = 0.0
    turning_error: float = 0.0
    growing_error_by_edge: float = 0.0


class EdgeFlows(NamedTuple):
    """The motions that go best with the flow of the edges: without turning and with it."""

    along: EdgeFlow
    turning: EdgeFlow


def edge_flow(
    times: npt.NDArray[np.int64],
    now_ns: int,
    span_s: float,
    window: tuple[int, int, int, int],
    x: float,
    y: float,
    *,
    may_turn: bool = False,
    by_edge: bool = False,
) -> EdgeFlow | None:
    """How the edges in a window move.

    Args:
        times: last event times of the pixels (ns), shape (height, width, 2).
        now_ns: events after this do not count (ns).
        span_s: nor do those that are older than this (s).
        window: rows top .. bottom - 1 and columns left .. right - 1.
        x: the column of the place round which they grow (pixels).
        y: its row (pixels).
        may_turn: whether they may turn round it as well.
        by_edge: whether the error of growing by whole edges is asked for.

    Returns:
        The motion, or None where there are too few edges.
    """
    flows = _flows(times, now_ns, span_s, window, x, y)
    return None if len(flows) < FLOWS_MIN else _motion(flows, PARTS_TURNING if may_turn else PARTS, by_edge=by_edge)


def edge_flows(
    times: npt.NDArray[np.int64], now_ns: int, span_s: float, window: tuple[int, int, int, int], x: float, y: float
) -> EdgeFlows | None:
    """How the edges in a window move if they may not turn round the place, and if they may; the arguments are those of
    `edge_flow`."""
    flows = _flows(times, now_ns, span_s, window, x, y)
    if len(flows) < FLOWS_MIN:
        return None
    return EdgeFlows(_motion(flows, PARTS, by_edge=True), _motion(flows, PARTS_TURNING, by_edge=True))


def _flows(
    times: npt.NDArray[np.int64], now_ns: int, span_s: float, window: tuple[int, int, int, int], x: float, y: float
) -> Float64Array:
    flows = np.empty((FLOWS_MAX, COLUMNS))
    return flows[: flows_of(times, now_ns, now_ns - int(span_s * 1e9), *window, x, y, flows)]


def _motion(flows: Float64Array, parts: int, *, by_edge: bool = False) -> EdgeFlow:
    """The motion of flows, of so many parts; with the error of growing by whole edges where that is asked for."""
    motion, error, error_by_edge = np.zeros((3, parts))
    spread_px_s = motion_of(flows, motion, error)
    if by_edge:
        errors_by_edge(flows, motion, spread_px_s, error_by_edge)
    _, _, *rates = zip(motion.tolist(), error.tolist(), strict=True)
    (growing_per_s, growing_error), (turning_rad_s, turning_error) = [*rates, (0.0, 0.0)][:2]
    return EdgeFlow(
        motion[:2], growing_per_s, growing_error, spread_px_s, turning_rad_s, turning_error, float(error_by_edge[2])
    )
