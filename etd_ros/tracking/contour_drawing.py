"""Compiled parts of the contour tracker that draw points on the cells of a model. Kernels that call each other share
this file, or numba would miss changes; points, poses and motions are those of `contour_kernels`."""

from __future__ import annotations

import numpy as np
from numba import njit

from etd_ros.tracking.contour_kernels import (
    AGE,
    ALONG_X,
    ALONG_Y,
    DENSITY,
    GRADIENT_X,
    GRADIENT_Y,
    GROWING,
    POLARITY,
    RIDGE,
    TURNING,
    WEIGHT,
    Float32Array,
    Float64Array,
    X,
    Y,
)

COHERENCE_FLOOR = 10.0
"""Added to the coherence that is possible, so that few points never look coherent."""
CROWDING_POWER = 0.7
"""Of the coherence that is possible: with 0 busy places would win, with 1 a few points that agree."""


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _draw_point(layer: Float32Array, column: float, row: float, weight: float) -> None:
    """A weight, shared out over the four cells round a place that lies among the cells."""
    c, r = int(column), int(row)
    right, below = column - c, row - r
    layer[r, c] += weight * (1 - right) * (1 - below)
    layer[r, c + 1] += weight * right * (1 - below)
    layer[r + 1, c] += weight * (1 - right) * below
    layer[r + 1, c + 1] += weight * right * below


@njit(cache=True, nogil=True, fastmath=True)
def splat(points: Float32Array, count: int, pose: Float64Array, cell_px: float, velocity: Float64Array,
          drawn: Float32Array) -> float:  # fmt: skip
    """Draw the points, moved on by their age, on the model's grid: `drawn`, shape (2, rows, columns), On and Off.

    Returns the number of points on it.
    """
    _, rows, columns = drawn.shape
    size = 1 / (cell_px * pose[2])
    cosine, sine = np.cos(pose[3]) * size, np.sin(pose[3]) * size
    drawn[:] = 0
    inside = 0.0
    for index in range(count):
        age = points[index, AGE]
        dx = points[index, X] + velocity[ALONG_X] * age - pose[0]
        dy = points[index, Y] + velocity[ALONG_Y] * age - pose[1]
        grown, turned = 1 + velocity[GROWING] * age, velocity[TURNING] * age
        dx, dy = grown * dx - turned * dy, grown * dy + turned * dx
        column = cosine * dx + sine * dy + (columns - 1) / 2
        row = cosine * dy - sine * dx + (rows - 1) / 2
        if column < 0 or row < 0 or column >= columns - 1 or row >= rows - 1:
            continue
        _draw_point(drawn[0 if points[index, POLARITY] > 0 else 1], column, row, 1.0)
        inside += 1
    return inside


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def blur(drawn: Float32Array, room: Float32Array) -> None:
    """Smooth each channel by 1 4 6 4 1 (a Gaussian of one cell) both ways, in place; `room` is of the same shape."""
    channels, rows, columns = drawn.shape
    # Constants of float32, or each product is one of float64, of which half as many fit in a register.
    four, six, sixteen, share = np.float32(4), np.float32(6), np.float32(16), np.float32(1 / 256)
    for channel in range(channels):
        for row in range(rows):
            line, smooth = drawn[channel, row], room[channel, row]
            before_2, before, middle, after, after_2 = line[:-4], line[1:-3], line[2:-2], line[3:-1], line[4:]
            inner = smooth[2:-2]
            for column in range(columns - 4):
                near = before[column] + after[column]
                inner[column] = six * middle[column] + four * near + before_2[column] + after_2[column]
            # The two cells at each border, where less lies beside them: the model's weight is 0 there.
            for column in (0, 1, columns - 2, columns - 1):
                smooth[column] = sixteen * line[column]
        for row in range(rows):
            line = drawn[channel, row]
            above, above_2 = room[channel, max(row - 1, 0)], room[channel, max(row - 2, 0)]
            below, below_2 = room[channel, min(row + 1, rows - 1)], room[channel, min(row + 2, rows - 1)]
            middle = room[channel, row]
            for column in range(columns):
                near = above[column] + below[column]
                line[column] = (six * middle[column] + four * near + above_2[column] + below_2[column]) * share


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _place(points: Float32Array, index: int, pose: Float64Array, size: float, velocity: Float64Array, time_s: float,
           parts: Float32Array) -> tuple[float, float, int, int]:  # fmt: skip
    """Column and row of a point moved back to where it began, the part of the time it is of (-1 beside the grid), and
    its channel."""
    number, _, rows, columns = parts.shape
    age = points[index, AGE]
    column = size * (points[index, X] + velocity[0] * age - pose[0]) + (columns - 1) / 2
    row = size * (points[index, Y] + velocity[1] * age - pose[1]) + (rows - 1) / 2
    channel = 0 if points[index, POLARITY] > 0 else 1
    if column < 0 or row < 0 or column >= columns - 1 or row >= rows - 1:
        return column, row, -1, channel
    return column, row, min(number - 1, max(0, int(-age / time_s * number))), channel


@njit(cache=True, nogil=True, fastmath=True)
def agreements(points: Float32Array, count: int, pose: Float64Array, cell_px: float, velocity: Float64Array,
               time_s: float, parts: Float32Array, room: Float32Array, agreed: Float32Array) -> None:  # fmt: skip
    """What the other parts of a time have drawn where a point falls when all are moved back to where they began: into
    `agreed`, shape (count,), much for points that move like this. The arguments are those of `coherence`."""
    number = parts.shape[0]
    size = 1 / (cell_px * pose[2])
    parts[:] = 0
    for index in range(count):
        column, row, part, channel = _place(points, index, pose, size, velocity, time_s, parts)
        if part >= 0:
            _draw_point(parts[part, channel], column, row, 1.0)
    for part in range(number):
        blur(parts[part], room)
    for index in range(count):
        column, row, part, channel = _place(points, index, pose, size, velocity, time_s, parts)
        agreed[index] = 0
        for other in range(number):
            if part >= 0 and other != part:
                agreed[index] += parts[other, channel, int(row + 0.5), int(column + 0.5)]


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _line_product(weight: Float32Array, on: Float32Array, off: Float32Array, other_on: Float32Array,
                  other_off: Float32Array) -> float:  # fmt: skip
    """What a row of two parts, On and Off, shape (columns,), has in common, weighed twice; On and Off that fall
    together count half."""
    half, product = np.float32(0.5), np.float32(0)
    for column in range(len(weight)):
        alike = (on[column] - half * off[column]) * other_on[column]
        alike += (off[column] - half * on[column]) * other_off[column]
        product += weight[column] * weight[column] * alike
    return float(product)


@njit(cache=True, nogil=True, fastmath=True)
def coherence(points: Float32Array, count: int, shares: Float32Array, weight: Float32Array, pose: Float64Array,
              cell_px: float, velocity: Float64Array, time_s: float, parts: Float32Array, room: Float32Array
              ) -> tuple[float, float]:  # fmt: skip
    """How well what the points draw in one part of a time agrees with what they draw in the others, when they are moved
    back to where they began. Returns the sum of their correlations over a power of what it would be if all were alike,
    by which velocities are compared, and the sum in parts of that: 1 if all are alike, below 0 where On falls on Off.

    Contrast (Gallego et al. 2018) also grows with what a single part draws, so that a motion towards busy places wins,
    or, over the square of the number of points, one away from them. On and Off that fall together count half: flicker
    and noise agree for any motion.

    Args:
        points: their ages count backwards from the beginning, so they are negative.
        count: number of points.
        shares: how much each of them counts, 0 to 1, shape (count,).
        weight: of the cells, shape (rows, columns).
        pose: where the grid lies, upright.
        cell_px: pixels of a cell at scale 1.
        velocity: x, y (pixels/s).
        time_s: from the beginning to the end (s).
        parts: room for what is drawn, shape (parts, 2, rows, columns).
        room: room for smoothing, shape (2, rows, columns).
    """
    number, _, rows, _ = parts.shape
    size = 1 / (cell_px * pose[2])
    parts[:] = 0
    for index in range(count):
        column, row, part, channel = _place(points, index, pose, size, velocity, time_s, parts)
        if part >= 0:
            _draw_point(parts[part, channel], column, row, shares[index])
    for part in range(number):
        blur(parts[part], room)
    products = np.zeros((number, number))
    for row in range(rows):
        for part in range(number):
            on, off = parts[part, 0, row], parts[part, 1, row]
            for other in range(part, number):
                products[part, other] += _line_product(weight[row], on, off, parts[other, 0, row], parts[other, 1, row])
    found = possible = 0.0
    for part in range(number):
        for other in range(part + 1, number):
            found += products[part, other]
            possible += np.sqrt(products[part, part] * products[other, other])
    return float(found / (possible + COHERENCE_FLOOR) ** CROWDING_POWER), float(found / max(possible, 1e-9))


@njit(cache=True, nogil=True, fastmath=True)
def normalise(drawn: Float32Array, room: Float32Array, weight: Float32Array, looks: float) -> None:
    """Smooth what was drawn, the sum of so many looks, and bring it to the contrast of a model, in place: fast and slow
    looks, which differ in the number of their events, teach the same."""
    _, rows, columns = drawn.shape
    total = 0.0
    for channel in range(2):
        for row in range(rows):
            for column in range(columns):
                total += drawn[channel, row, column]
    blur(drawn, room)
    norm = 1 / (looks * (np.sqrt(total / looks / (rows * columns)) + 0.05))
    for channel in range(2):
        for row in range(rows):
            for column in range(columns):
                drawn[channel, row, column] *= norm * weight[row, column]


@njit(cache=True, nogil=True, fastmath=True)
def learn(maps: Float32Array, drawn: Float32Array, direction: Float64Array, rate: float) -> None:
    """Move the model towards what was drawn and normalised, with the motion at that time in the model's coordinates, of
    length 1, turning and growing by the cell from the middle.

    Events of a moving gradient g have the rate and sign of -g . v (Gallego et al. 2020, equation 3): only the part of
    the gradient along the motion is corrected, the other part stays what it was. A rate of 1 forgets what was known.
    """
    _, rows, columns = drawn.shape
    mean = area = 0.0
    for row in range(rows):
        for column in range(columns):
            on, off = drawn[0, row, column], drawn[1, row, column]
            across, down = column - (columns - 1) / 2, row - (rows - 1) / 2
            along_x = direction[ALONG_X] + direction[GROWING] * across - direction[TURNING] * down
            along_y = direction[ALONG_Y] + direction[GROWING] * down + direction[TURNING] * across
            error = on - off - along_x * maps[GRADIENT_X, row, column] - along_y * maps[GRADIENT_Y, row, column]
            share = rate / max(1.0, along_x * along_x + along_y * along_y)
            maps[GRADIENT_X, row, column] += share * along_x * error
            maps[GRADIENT_Y, row, column] += share * along_y * error
            maps[DENSITY, row, column] += rate * (on + off - maps[DENSITY, row, column])
            mean += maps[DENSITY, row, column]
            area += maps[WEIGHT, row, column]
    mean /= area
    for row in range(rows):
        for column in range(columns):
            maps[RIDGE, row, column] = maps[DENSITY, row, column] - mean * maps[WEIGHT, row, column]
