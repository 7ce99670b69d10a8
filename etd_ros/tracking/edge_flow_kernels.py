"""Compiled parts of `edge_flow`. Kernels that call each other share this file, or numba would miss changes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.tracking.contour_kernels import Float64Array

REACH, NEIGHBOURS_MIN = 2, 7
"""A plane is fitted to the event times of a pixel and of those so far to each side of it, if so many have one: a line
and two pixels more, as one line has no slope across it."""
NEAR = (2 * REACH + 1) ** 2
FITS, STRAY_PX = 3, 1.5
"""It is fitted so often; pixels are left out that are off the last one by more than the edge takes for so much way."""
SPREAD_MIN = 1e-3
"""Pixels whose places vary less, all on a line, have no plane."""
SLOWNESS_MIN = 1e-6
"""Edges that would be faster than the inverse of this (pixels/s) have come at once, by a lamp."""
NORMAL_X, NORMAL_Y, SPEED, RIGHT, BELOW = range(5)
COLUMNS = 5
"""Columns of a flow: which way its edge moves, how fast (pixels/s), and where it is beside a middle (pixels)."""
PARTS, PARTS_TURNING = 3, 4
"""Of a motion here: x, y (pixels/s), growing (1/s); and, of one that may turn, turning (rad/s)."""
ROUNDS, STRAYING = 8, 2.0
"""Least squares are weighted again so often; a flow that strays by so many deviations counts a quarter."""
DEVIATION_OF_MEDIAN = 1.4826
"""Of normally distributed values, over the median of their sizes."""
DEVIATION_FLOOR = 1e-6
RIDGE = 1e-9
DIRECTIONS = 8
EDGES = 2 * DIRECTIONS
"""Flows of a direction on one side of the middle are taken to be of one edge."""


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _plane(times: npt.NDArray[np.int64], now_ns: int, oldest_ns: int, row: int, column: int, channel: int,
           near: Float64Array) -> tuple[float, float]:  # fmt: skip
    """By how much later (s) the edge that an event pixel is of comes by a pixel farther to the right and by one farther
    down; 0, 0 where that is not known. `near` is room for the pixels round it, shape (NEAR, 3)."""
    height, width, _ = times.shape
    first = times[row, column, channel]
    found = 0
    for dy in range(max(-REACH, -row), min(REACH, height - 1 - row) + 1):
        for dx in range(max(-REACH, -column), min(REACH, width - 1 - column) + 1):
            time = times[row + dy, column + dx, channel]
            if oldest_ns < time <= now_ns:
                near[found, 0], near[found, 1], near[found, 2] = dx, dy, (time - first) * 1e-9
                found += 1
    right = below = middle = stray_s = 0.0
    for fit in range(FITS):
        n = sum_x = sum_y = sum_t = xx = xy = yy = xt = yt = 0.0
        for index in range(found):
            dx, dy, late_s = near[index]
            if fit > 0 and abs(right * dx + below * dy + middle - late_s) > stray_s:
                continue
            n += 1
            sum_x += dx
            sum_y += dy
            sum_t += late_s
            xx += dx * dx
            xy += dx * dy
            yy += dy * dy
            xt += dx * late_s
            yt += dy * late_s
        if n < NEIGHBOURS_MIN:
            return 0.0, 0.0
        xx -= sum_x * sum_x / n
        xy -= sum_x * sum_y / n
        yy -= sum_y * sum_y / n
        xt -= sum_x * sum_t / n
        yt -= sum_y * sum_t / n
        determinant = xx * yy - xy * xy
        if determinant < SPREAD_MIN * n * n:
            return 0.0, 0.0
        right, below = (yy * xt - xy * yt) / determinant, (xx * yt - xy * xt) / determinant
        middle = (sum_t - right * sum_x - below * sum_y) / n
        stray_s = STRAY_PX * np.sqrt(right * right + below * below)
    return right, below


@njit(cache=True, nogil=True, fastmath=True)
def flows_of(times: npt.NDArray[np.int64], now_ns: int, oldest_ns: int, top: int, bottom: int, left: int, right: int,
             x: float, y: float, flows: Float64Array) -> int:  # fmt: skip
    """The flows of the edges in a window beside a middle; their number. Of more event pixels than fit every second,
    third, ... is taken."""
    events = 0
    for row in range(top, bottom):
        for column in range(left, right):
            for channel in range(2):
                events += oldest_ns < times[row, column, channel] <= now_ns
    stride = 1 + events // len(flows)
    near = np.empty((NEAR, 3))
    number = events = 0
    for row in range(top, bottom):
        for column in range(left, right):
            for channel in range(2):
                if not oldest_ns < times[row, column, channel] <= now_ns:
                    continue
                events += 1
                if events % stride or number == len(flows):
                    continue
                later_right, later_below = _plane(times, now_ns, oldest_ns, row, column, channel, near)
                slowness = np.sqrt(later_right * later_right + later_below * later_below)
                if slowness > SLOWNESS_MIN:
                    flow = flows[number]
                    flow[NORMAL_X], flow[NORMAL_Y] = later_right / slowness, later_below / slowness
                    flow[SPEED] = 1 / slowness
                    flow[RIGHT], flow[BELOW] = column + 0.5 - x, row + 0.5 - y
                    number += 1
    return number


@njit(cache=True, nogil=True)
def motion_of(flows: Float64Array, motion: Float64Array, error: Float64Array) -> float:
    """The motion with which the flows go best, and its standard errors, into `motion` and `error`, shape (PARTS,) or
    (PARTS_TURNING,): iteratively reweighted least squares, as some edges are of something else.

    Returns how far the flows' speeds usually are from it (pixels/s).
    """
    count, parts = len(flows), len(motion)
    weights, strays = np.ones(count), np.empty(count)
    rows = _rows(flows, parts)
    squares, sums = np.empty((parts, parts)), np.empty(parts)
    deviation = 0.0
    for _ in range(ROUNDS):
        squares[:], sums[:] = RIDGE * np.eye(parts), 0.0
        for i in range(count):
            _add(rows[i], weights[i], flows[i, SPEED], squares, sums)
        inverse = np.linalg.inv(squares)
        motion[:] = inverse @ sums
        strays[:] = flows[:, SPEED] - rows @ motion
        deviation = DEVIATION_OF_MEDIAN * np.median(np.abs(strays)) + DEVIATION_FLOOR
        for i in range(count):
            weights[i] = _weight(strays[i], deviation)
        for j in range(parts):
            error[j] = deviation * np.sqrt(inverse[j, j])
    return float(deviation)


@njit(cache=True, nogil=True)
def errors_by_edge(flows: Float64Array, motion: Float64Array, deviation: float, error: Float64Array) -> None:
    """How far the motion with which the flows go best would be another without one of the edges, into `error`, shape
    as `motion`: the jackknife over edges. What a single edge decides is not known, however many flows it has, as they
    go wrong together.

    Args:
        flows: as `flows_of` makes them.
        motion: that with which they go best.
        deviation: how far their speeds usually are from it (pixels/s).
        error: is filled.
    """
    parts = len(motion)
    rows = _rows(flows, parts)
    squares, sums = np.zeros((EDGES, parts, parts)), np.zeros((EDGES, parts))
    counts = np.zeros(EDGES)
    strays = flows[:, SPEED] - rows @ motion
    for i in range(len(flows)):
        edge, weight = _edge(flows[i]), _weight(strays[i], deviation)
        _add(rows[i], weight, flows[i, SPEED], squares[edge], sums[edge])
        counts[edge] += 1
    edges = np.count_nonzero(counts)
    error[:] = 0
    for edge in range(EDGES):
        if counts[edge]:
            others = RIDGE * np.eye(parts) + squares[:edge].sum(axis=0) + squares[edge + 1 :].sum(axis=0)
            without = np.linalg.inv(others) @ (sums[:edge].sum(axis=0) + sums[edge + 1 :].sum(axis=0))
            error += (without - motion) ** 2
    error[:] = np.sqrt(error * (edges - 1) / edges)


@njit(cache=True, nogil=True)
def _rows(flows: Float64Array, parts: int) -> Float64Array:
    """By how much an edge is faster for each unit of each part of the motion, shape (flows, parts)."""
    rows = np.empty((len(flows), parts))
    rows[:, 0], rows[:, 1] = flows[:, NORMAL_X], flows[:, NORMAL_Y]
    rows[:, 2] = flows[:, NORMAL_X] * flows[:, RIGHT] + flows[:, NORMAL_Y] * flows[:, BELOW]
    if parts == PARTS_TURNING:
        rows[:, 3] = flows[:, NORMAL_Y] * flows[:, RIGHT] - flows[:, NORMAL_X] * flows[:, BELOW]
    return rows


@njit(cache=True, nogil=True)
def _add(row: Float64Array, weight: float, speed_px_s: float, squares: Float64Array, sums: Float64Array) -> None:
    """Add a flow to the sums of least squares."""
    for j in range(len(row)):
        sums[j] += weight * row[j] * speed_px_s
        for k in range(len(row)):
            squares[j, k] += weight * row[j] * row[k]


@njit(cache=True, nogil=True)
def _weight(stray_px_s: float, deviation_px_s: float) -> float:
    """How much a flow counts that strays by so much."""
    return float((1 + (stray_px_s / (STRAYING * deviation_px_s)) ** 2) ** -2)


@njit(cache=True, nogil=True)
def _edge(flow: Float64Array) -> int:
    """Which edge a flow is taken to be of: one of a direction, ahead or behind."""
    turns = np.arctan2(flow[NORMAL_Y], flow[NORMAL_X]) / (2 * np.pi)
    direction = int(np.floor(turns * DIRECTIONS + 0.5)) % DIRECTIONS
    is_ahead = flow[NORMAL_X] * flow[RIGHT] + flow[NORMAL_Y] * flow[BELOW] > 0
    return 2 * direction + int(is_ahead)
