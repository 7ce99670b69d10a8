"""Compiled parts of the contour tracker that draw points on the cells of a model. Kernels that call each other share
this file, or numba would miss changes; points, poses and motions are those of `contour_kernels`."""

from __future__ import annotations

import math
from typing import NamedTuple

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
def _draw_point(layer: Float32Array, column: float, row: float) -> None:
    """A point, shared out over the four cells round a place that lies among the cells."""
    c, r = int(column), int(row)
    right, below = column - c, row - r
    layer[r, c] += (1 - right) * (1 - below)
    layer[r, c + 1] += right * (1 - below)
    layer[r + 1, c] += (1 - right) * below
    layer[r + 1, c + 1] += right * below


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
        _draw_point(drawn[0 if points[index, POLARITY] > 0 else 1], column, row)
        inside += 1
    return inside


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _blur_line(line: Float32Array, smooth: Float32Array) -> None:
    """1 4 6 4 1 along a line, but not at the two cells of each end, beside which less lies; `smooth` is as long."""
    # Constants of float32, or each product is one of float64, of which half as many fit in a register.
    four, six, sixteen = np.float32(4), np.float32(6), np.float32(16)
    before_2, before, middle, after, after_2 = line[:-4], line[1:-3], line[2:-2], line[3:-1], line[4:]
    inner = smooth[2:-2]
    for column in range(len(inner)):
        near = before[column] + after[column]
        inner[column] = six * middle[column] + four * near + before_2[column] + after_2[column]
    last = len(line) - 1
    for column in (0, 1, last - 1, last):
        smooth[column] = sixteen * line[column]


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _blur_down(lines: Float32Array, drawn: Float32Array) -> None:
    """1 4 6 4 1 across lines that `_blur_line` has smoothed, into `drawn`; the sum stays what it was before both."""
    rows, columns = drawn.shape
    four, six, share = np.float32(4), np.float32(6), np.float32(1 / 256)
    for row in range(rows):
        above, above_2 = lines[max(row - 1, 0)], lines[max(row - 2, 0)]
        below, below_2 = lines[min(row + 1, rows - 1)], lines[min(row + 2, rows - 1)]
        line, middle = drawn[row], lines[row]
        for column in range(columns):
            near = above[column] + below[column]
            line[column] = (six * middle[column] + four * near + above_2[column] + below_2[column]) * share


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def blur(drawn: Float32Array, room: Float32Array) -> None:
    """Smooth each channel by 1 4 6 4 1 (a Gaussian of one cell) both ways, in place; `room` is of the same shape. What
    lies at the border is smoothed less: the model's weight is 0 there."""
    channels, rows, _ = drawn.shape
    for channel in range(channels):
        for row in range(rows):
            _blur_line(drawn[channel, row], room[channel, row])
        _blur_down(room[channel], drawn[channel])


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _blur_parts(drawn: Float32Array, lines: Float32Array, columns: int) -> None:
    """What `blur` makes of layers of so many columns that lie side by side: longer lines are faster."""
    rows, wide = drawn.shape
    sixteen = np.float32(16)
    for row in range(rows):
        _blur_line(drawn[row], lines[row])
        for first in range(columns, wide, columns):
            for column in range(first - 2, first + 2):
                lines[row, column] = sixteen * drawn[row, column]
    _blur_down(lines, drawn)


def room_for_parts(parts: int, rows: int, columns: int) -> Float32Array:
    """Room to draw and smooth On and Off of so many parts of a time in, shape (2, rows, 2 * parts * columns)."""
    return np.zeros((2, rows, 2 * parts * columns), np.float32)


class _Grid(NamedTuple):
    """Where points fall when they are moved back to where they began: all float32, twice as fast as float64.

    Attributes:
        size: cells of a pixel.
        left, top: column and row of the pixel (0, 0).
        right_s, down_s: cells that a point moves in a second.
        parts_s: parts of the time that a second is, below 0, as ages count backwards from the beginning.
        columns, rows: of a layer.
        last: number of the last part.
    """

    size: np.float32
    left: np.float32
    top: np.float32
    right_s: np.float32
    down_s: np.float32
    parts_s: np.float32
    columns: np.float32
    rows: np.float32
    last: np.float32


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _grid(pose: Float64Array, cell_px: float, velocity: Float64Array, time_s: float, drawn: Float32Array,
          columns: int) -> _Grid:  # fmt: skip
    """The grid of layers of so many columns that lie side by side."""
    rows, wide = drawn.shape
    number = wide // (2 * columns)
    size = 1 / (cell_px * pose[2])
    return _Grid(
        np.float32(size),
        np.float32((columns - 1) / 2 - size * pose[0]),
        np.float32((rows - 1) / 2 - size * pose[1]),
        np.float32(size * velocity[0]),
        np.float32(size * velocity[1]),
        np.float32(-number / time_s),
        np.float32(columns),
        np.float32(rows),
        np.float32(number - 1),
    )


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _place(points: Float32Array, index: int, grid: _Grid) -> tuple[np.float32, np.float32, int]:
    """Column and row of a point, and its layer: On and Off of each part of the time; -1 beside the grid."""
    age = points[index, AGE]
    column = grid.size * points[index, X] + grid.right_s * age + grid.left
    row = grid.size * points[index, Y] + grid.down_s * age + grid.top
    nothing, one = np.float32(0), np.float32(1)
    if column < nothing or row < nothing or column >= grid.columns - one or row >= grid.rows - one:
        return column, row, -1
    part = np.int32(min(grid.last, max(nothing, age * grid.parts_s)))
    return column, row, 2 * int(part) + (0 if points[index, POLARITY] > nothing else 1)


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _draw_parts(points: Float32Array, count: int, shares: Float32Array, grid: _Grid, drawn: Float32Array,
                lines: Float32Array) -> None:  # fmt: skip
    """Draw the points' shares on the layers, which lie side by side in `drawn`, and smooth them."""
    columns = int(grid.columns)
    drawn[:] = np.float32(0)
    for index in range(count):
        column, row, layer = _place(points, index, grid)
        if layer < 0:
            continue
        c, r = np.int32(column), np.int32(row)
        right, below = column - np.float32(c), row - np.float32(r)
        lower = shares[index] * below
        upper = shares[index] - lower
        at = c + layer * columns
        drawn[r, at] += upper - upper * right
        drawn[r, at + 1] += upper * right
        drawn[r + 1, at] += lower - lower * right
        drawn[r + 1, at + 1] += lower * right
    _blur_parts(drawn, lines, columns)


@njit(cache=True, nogil=True, fastmath=True)
def agreements(points: Float32Array, count: int, pose: Float64Array, cell_px: float, velocity: Float64Array,
               time_s: float, columns: int, room: Float32Array, agreed: Float32Array) -> None:  # fmt: skip
    """What the other parts of a time have drawn where a point falls when all are moved back to where they began: into
    `agreed`, shape (count,), much for points that move like this. The arguments are those of `coherence`, with the
    columns of a layer."""
    drawn, lines = room[0], room[1]
    grid = _grid(pose, cell_px, velocity, time_s, drawn, columns)
    _draw_parts(points, count, np.ones(count, np.float32), grid, drawn, lines)
    layers = drawn.shape[1] // columns
    half = np.float32(0.5)
    for index in range(count):
        column, row, layer = _place(points, index, grid)
        agreed[index] = 0
        if layer < 0:
            continue
        r, c = int(row + half), int(column + half)
        for other in range(layer % 2, layers, 2):
            if other != layer:
                agreed[index] += drawn[r, c + other * columns]


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _line_products(weight: Float32Array, on: Float32Array, off: Float32Array, before_on: Float32Array,
                   before_off: Float32Array) -> tuple[float, float]:  # fmt: skip
    """What a line of a part, On and Off, shape (columns,), has in common with itself and with the sum of the parts
    before, to which it is added then; weighed twice, and On and Off that fall together count half."""
    half, own, common = np.float32(0.5), np.float32(0), np.float32(0)
    for column in range(len(weight)):
        more, less = on[column] - half * off[column], off[column] - half * on[column]
        square = weight[column] * weight[column]
        own += square * (more * on[column] + less * off[column])
        common += square * (more * before_on[column] + less * before_off[column])
        before_on[column] += on[column]
        before_off[column] += off[column]
    return float(own), float(common)


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _coherence(points: Float32Array, count: int, shares: Float32Array, weight: Float32Array, pose: Float64Array,
               cell_px: float, velocity: Float64Array, time_s: float, room: Float32Array
               ) -> tuple[float, float]:  # fmt: skip
    """What `coherence` says."""
    rows, columns = weight.shape
    drawn, lines = room[0], room[1]
    _draw_parts(points, count, shares, _grid(pose, cell_px, velocity, time_s, drawn, columns), drawn, lines)
    number = drawn.shape[1] // (2 * columns)
    own, before = np.zeros(number), np.empty((2, columns), np.float32)
    found = possible = 0.0
    for row in range(rows):
        before[:] = np.float32(0)
        for part in range(number):
            on, off = drawn[row, 2 * part * columns :][:columns], drawn[row, (2 * part + 1) * columns :][:columns]
            of_itself, of_both = _line_products(weight[row], on, off, before[0], before[1])
            own[part] += of_itself
            found += of_both
    for part in range(number):
        for other in range(part + 1, number):
            possible += np.sqrt(own[part] * own[other])
    return float(found / (possible + COHERENCE_FLOOR) ** CROWDING_POWER), float(found / max(possible, 1e-9))


@njit(cache=True, nogil=True, fastmath=True)
def coherence(points: Float32Array, count: int, shares: Float32Array, weight: Float32Array, pose: Float64Array,
              cell_px: float, velocity: Float64Array, time_s: float, room: Float32Array
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
        room: to draw and smooth in, shape (2, rows, 2 * parts * columns), as `room_for_parts` makes it.
    """
    return _coherence(points, count, shares, weight, pose, cell_px, velocity, time_s, room)


@njit(cache=True, nogil=True)
def most_coherent(points: Float32Array, shares: Float32Array, weight: Float32Array, pose: Float64Array, cell_px: float,
                  velocities: Float64Array, time_s: float, rest_weight: float, room: Float32Array
                  ) -> tuple[int, float, float]:  # fmt: skip
    """The first velocity of the greatest coherence among several (pixels/s), shape (velocities, 2): its number, how
    well the points agree at it, and how alike their parts are; the other arguments are those of `climbed`."""
    best = 0, -np.inf, 0.0
    for number in range(len(velocities)):
        velocity = velocities[number]
        agreement, alike = _coherence(points, len(points), shares, weight, pose, cell_px, velocity, time_s, room)
        agreement *= math.exp(-(rest_weight * math.hypot(velocity[0], velocity[1]) * time_s))
        if agreement > best[1]:
            best = number, agreement, alike
    return best


@njit(cache=True, nogil=True)
def climbed(points: Float32Array, shares: Float32Array, weight: Float32Array, pose: Float64Array, cell_px: float,
            so_far: Float64Array, middle: Float64Array, step_px: float, reach: int, time_s: float, change_weight: float,
            rest_weight: float, room: Float32Array) -> tuple[float, float, float, float]:  # fmt: skip
    """The velocity of the greatest coherence among those up to `reach` steps to each side of one, climbed to from that:
    half of them need not be looked at. Returns it (pixels/s), how well the points agree at it, as `coherence` says but
    less what motion since the beginning has to bring, and how alike their parts are.

    Args:
        points: their ages count backwards from the beginning, so they are negative.
        shares: how much each of them counts, 0 to 1, shape (count,).
        weight: of the cells, shape (rows, columns).
        pose: where the grid lies, upright.
        cell_px: pixels of a cell at scale 1.
        so_far: the velocity believed so far (pixels/s).
        middle: the velocity to begin with (pixels/s).
        step_px: from one velocity to the next (pixels at the end of the time).
        reach: number of steps.
        time_s: from the beginning to the end (s).
        change_weight: how much coherence a pixel of change (squared) from the one so far has to bring.
        rest_weight: how much of it a pixel of motion since the beginning has to bring.
        room: as for `coherence`.
    """
    seen = np.zeros((2 * reach + 1, 2 * reach + 1), np.bool_)
    velocity, best_value = np.empty(2), -np.inf
    best = (middle[0], middle[1], 0.0, 0.0)
    # No candidate yet.
    top_column = top_row = reach + 1
    column = row = 0
    while column != top_column or row != top_row:
        top_column, top_row = column, row
        for right in range(max(top_column - 1, -reach), min(top_column + 1, reach) + 1):
            for down in range(max(top_row - 1, -reach), min(top_row + 1, reach) + 1):
                if seen[right + reach, down + reach]:
                    continue
                seen[right + reach, down + reach] = True
                velocity[0] = middle[0] + right * (step_px / time_s)
                velocity[1] = middle[1] + down * (step_px / time_s)
                agreement, alike = _coherence(
                    points, len(points), shares, weight, pose, cell_px, velocity, time_s, room
                )
                agreement *= math.exp(-(rest_weight * math.hypot(velocity[0], velocity[1]) * time_s))
                change_px = math.hypot(velocity[0] - so_far[0], velocity[1] - so_far[1]) * time_s
                value = agreement * math.exp(-change_weight * change_px**2)
                if value > best_value:
                    best_value, column, row = value, right, down
                    best = (velocity[0], velocity[1], agreement, alike)
    return best


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
