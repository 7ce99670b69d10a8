"""How what lies round a target has moved, and which events are of it: compiled parts of `backdrop`."""

from __future__ import annotations

import numpy as np
from numba import njit

from etd_ros.tracking.contour_drawing import agreements
from etd_ros.tracking.contour_kernels import AGE, POLARITY, Float32Array, Float64Array, X, Y, parabola

POINTS_MAX = 2000
"""Of so many points, or more, every second, third, ... tells how what is round the target moves."""


@njit(cache=True, nogil=True)
def ring_shift(points: Float32Array, count: int, pose: Float64Array, cell_px: float, velocity: Float64Array,
               span_s: float, ring: Float32Array, reach: int, halves: Float32Array, room: Float32Array,
               sides: Float64Array) -> tuple[float, float, float]:  # fmt: skip
    """How far the newer half of a time's events lies from the older one once all are moved on by a velocity.

    Args:
        points: the events, with ages up to `span_s`.
        count: number of points.
        pose: where the grid lies, upright; scale 1 in its third place.
        cell_px: pixels of a cell at scale 1.
        velocity: x, y (pixels/s).
        span_s: the time (s).
        ring: how much each cell counts, shape (rows, columns).
        reach: cells to each side that are tried.
        halves: room for what is drawn, shape (2, rows, columns).
        room: room for smoothing, shape (rows, columns).
        sides: how many events are in the ring, left of, right of, above and below its middle.

    Returns:
        The shift with the greatest correlation along x and y (pixels), by parabolas between the cells, and how alike
        both halves are there: 1 if they are the same, 0 if they have nothing in common, or where the greatest lies at
        the border of what was tried: it may be greater beyond.
    """
    _draw_halves(points, count, pose, cell_px, velocity, span_s, ring, halves, sides)
    smooth(halves[0], room)
    smooth(halves[1], room)
    older, newer = halves[0], halves[1]
    of_older = _energy(older, ring, 0, 0)
    for row in range(older.shape[0]):
        for column in range(older.shape[1]):
            older[row, column] *= ring[row, column]
    scores = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    below = right = 0
    for down in range(-reach, reach + 1):
        for across in range(-reach, reach + 1):
            score = _correlation(older, newer, across, down)
            scores[down + reach, across + reach] = score
            if score > scores[below + reach, right + reach]:
                below, right = down, across
    if max(abs(right), abs(below)) == reach:
        return 0.0, 0.0, 0.0
    best, line = scores[below + reach, right + reach], scores[below + reach]
    along_x = right + parabola(line[right + reach - 1], best, line[right + reach + 1])
    along_y = below + parabola(scores[below + reach - 1, right + reach], best, scores[below + reach + 1, right + reach])
    size_px = cell_px * pose[2]
    possible = np.sqrt(of_older * _energy(newer, ring, right, below))
    return along_x * size_px, along_y * size_px, float(best / max(possible, 1e-6))


@njit(cache=True, nogil=True)
def _draw_halves(points: Float32Array, count: int, pose: Float64Array, cell_px: float, velocity: Float64Array,
                 span_s: float, ring: Float32Array, halves: Float32Array, sides: Float64Array) -> None:  # fmt: skip
    """Draw the polarities of the older and the newer half of the events where a velocity has them in the middle of the
    time, each shared among four cells, and count those in the ring on each side of its middle."""
    _, rows, columns = halves.shape
    size = 1 / (cell_px * pose[2])
    halves[:] = 0
    sides[:] = 0
    for index in range(0, count, 1 + count // POINTS_MAX):
        since_s = points[index, AGE] - span_s / 2
        column = size * (points[index, X] + velocity[0] * since_s - pose[0]) + (columns - 1) / 2
        row = size * (points[index, Y] + velocity[1] * since_s - pose[1]) + (rows - 1) / 2
        if column < 0 or row < 0 or column >= columns - 1 or row >= rows - 1:
            continue
        half = 0 if since_s > 0 else 1
        sign = 1 if points[index, POLARITY] > 0 else -1
        left, top = int(column), int(row)
        across, down = column - left, row - top
        if ring[top, left] > 0:
            from_middle, below_middle = left / columns - 0.5, top / rows - 0.5
            if abs(from_middle) > abs(below_middle):
                sides[0 if from_middle < 0 else 1] += 1
            else:
                sides[2 if below_middle < 0 else 3] += 1
        halves[half, top, left] += sign * (1 - across) * (1 - down)
        halves[half, top, left + 1] += sign * across * (1 - down)
        halves[half, top + 1, left] += sign * (1 - across) * down
        halves[half, top + 1, left + 1] += sign * across * down


@njit(cache=True, nogil=True)
def smooth(drawn: Float32Array, room: Float32Array) -> None:
    """Weigh each cell with its neighbours, 1 2 1 along x and y, in place; beyond the grid is nothing."""
    rows, columns = drawn.shape
    for row in range(rows):
        for column in range(columns):
            before = drawn[row, column - 1] if column > 0 else np.float32(0)
            after = drawn[row, column + 1] if column < columns - 1 else np.float32(0)
            room[row, column] = 2 * drawn[row, column] + before + after
    for row in range(rows):
        for column in range(columns):
            above = room[row - 1, column] if row > 0 else np.float32(0)
            below = room[row + 1, column] if row < rows - 1 else np.float32(0)
            drawn[row, column] = 2 * room[row, column] + above + below


@njit(cache=True, nogil=True, fastmath=True)
def _energy(drawn: Float32Array, ring: Float32Array, across: int, down: int) -> float:
    """Sum of the squares in the ring if that lies so many cells farther to the right and below."""
    rows, columns = ring.shape
    found = np.float32(0)
    for row in range(max(0, -down), min(rows, rows - down)):
        for column in range(max(0, -across), min(columns, columns - across)):
            found += ring[row, column] * drawn[row + down, column + across] ** 2
    return float(found)


@njit(cache=True, nogil=True, fastmath=True)
def _correlation(older: Float32Array, newer: Float32Array, across: int, down: int) -> float:
    """Sum of the products of both, the second one so many cells farther to the right and below."""
    rows, columns = older.shape
    found = np.float32(0)
    left, right = max(0, -across), min(columns, columns - across)
    for row in range(max(0, -down), min(rows, rows - down)):
        line, other = older[row, left:right], newer[row + down, left + across : right + across]
        for column in range(right - left):
            found += line[column] * other[column]
    return float(found)


@njit(cache=True, nogil=True)
def keep_own(points: Float32Array, count: int, pose: Float64Array, cell_px: float, velocity: Float64Array,
             behind: Float64Array, span_s: float, least: int, columns: int, room: Float32Array
             ) -> int:  # fmt: skip
    """Keep the points that agree with the others at least as well at the target's velocity as at that of what lies
    behind it, in place and in order, or all where these would be fewer than `least`.

    Args:
        points: the events, with ages up to `span_s`.
        count: number of points.
        pose: where the target is at the end of the time; scale 1 in its third place.
        cell_px: pixels of a cell at scale 1.
        velocity: of the target, x, y (pixels/s).
        behind: of what lies behind it, the same.
        span_s: the time (s).
        least: number of points.
        columns: of the grid.
        room: to draw and smooth parts of the time in, as `room_for_parts` makes it.

    Returns:
        The number of points kept.
    """
    since_start = points[:count].copy()
    for index in range(count):
        since_start[index, AGE] -= np.float32(span_s)
    agreed = np.empty((2, count), np.float32)
    for layer in range(2):
        motion = velocity if layer == 0 else behind
        at_start = pose.copy()
        # In the middle of the time the grid lies where the target is at its end.
        at_start[0] -= motion[0] * span_s / 2
        at_start[1] -= motion[1] * span_s / 2
        agreements(since_start, count, at_start, cell_px, motion, span_s, columns, room, agreed[layer])
    own = 0
    for index in range(count):
        own += agreed[0, index] >= agreed[1, index]
    if own < least:
        return count
    kept = 0
    for index in range(count):
        if agreed[0, index] >= agreed[1, index]:
            points[kept] = points[index]
            kept += 1
    return kept
