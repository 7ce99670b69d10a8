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
from etd_ros.tracking.edge_flow_kernels import COLUMNS, PARTS, flows_of, motion_of

FLOWS_MAX, FLOWS_MIN = 400, 20
"""More event pixels than the first are thinned out; fewer than the second tell nothing."""


class EdgeFlow(NamedTuple):
    """The motion that goes best with the flow of the edges: velocity x, y (pixels/s), how fast it grows (1/s, of the
    logarithm of the scale), and the standard error of that."""

    velocity: Float64Array
    growing_per_s: float
    growing_error: float


def edge_flow(
    times: npt.NDArray[np.int64], now_ns: int, span_s: float, window: tuple[int, int, int, int], x: float, y: float
) -> EdgeFlow | None:
    """How the edges in a window move.

    Args:
        times: last event times of the pixels (ns), shape (height, width, 2).
        now_ns: events after this do not count (ns).
        span_s: nor do those that are older than this (s).
        window: rows top .. bottom - 1 and columns left .. right - 1.
        x: the column of the place round which they grow (pixels).
        y: its row (pixels).

    Returns:
        The motion, or None where there are too few edges.
    """
    flows = np.empty((FLOWS_MAX, COLUMNS))
    number = flows_of(times, now_ns, now_ns - int(span_s * 1e9), *window, x, y, flows)
    if number < FLOWS_MIN:
        return None
    motion, error = np.zeros(PARTS), np.zeros(PARTS)
    motion_of(flows[:number], motion, error)
    return EdgeFlow(motion[:2], float(motion[2]), float(error[2]))
