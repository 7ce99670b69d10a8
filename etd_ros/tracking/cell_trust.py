"""How far the cells of a target's model are trusted: some show what lies behind it, or what covers it. Kernels that
call each other share this file, or numba would miss changes."""

from __future__ import annotations

import numpy as np
from numba import njit

from etd_ros.tracking.contour_kernels import GRADIENT_X, GRADIENT_Y, RIDGE, Float32Array, Float64Array, measure_norms

REACH_OUTSIDE, REACH_INSIDE = 1, 2
"""Whether a cell stays the same is judged with so many cells round it: single ones are noisy."""
DISTRUST = 3.0
"""How much a change weighs against what stays."""
SQUARES_FLOOR = 1e-5
"""Added to what stays, so that empty cells divide by something."""
ONE_SIDED = (0.021, 0.0625)
"""How far the middle of what stays lies beside the middle of all that is known, in parts of the grid's width and
height: from the first on something may cover the target, from the second on it does. What turns or grows changes all
round."""
LEAST_STAYING = 0.7
"""Cells that stay less than this share of the mean show what covers the target; from the mean on, the target."""
LAYERS = 5
SQUARES, SUMS, CHANGES, COMMON, SCRATCH = range(LAYERS)
"""Layers of the room to work in."""


class CellTrust:
    """What looks are compared with: maps whose cells count by how far they can be trusted.

    Attributes:
        trusted: the usual maps by trust, float32, shape (MAPS, rows, columns); where events are (DENSITY) stays 0.
        both: the mean of the usual and the recent ones, likewise.
        trusted_norms, both_norms: what `measure_norms` says of them, float64, shape (5, 5).
        covered: how surely something covers the target, 0 to 1.
    """

    def __init__(self, usual: Float32Array, outside: Float32Array) -> None:
        self.trusted = usual.copy()
        self.both = usual.copy()
        self.trusted_norms, self.both_norms = np.zeros((2, 5, 5))
        self.covered = 0.0
        self._outside = outside
        self._room = np.zeros((LAYERS, *outside.shape), np.float32)
        self._trust = np.ones_like(outside)

    def weigh(
        self,
        usual: Float32Array,
        recent: Float32Array,
        latest: Float32Array,
        seen: Float64Array,
        *,
        sees_covers: bool,
    ) -> None:
        """Make both maps anew, their norms, and `covered`; the arguments are those of `weigh_cells`."""
        self.covered = weigh_cells(usual, recent, latest, seen, self._outside, sees_covers, self._room, self._trust)
        apply_trust(usual, recent, self._trust, self.trusted, self.both)
        measure_norms(self.trusted, self.trusted_norms)
        measure_norms(self.both, self.both_norms)


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _sum_around(layer: Float32Array, reach: int, scratch: Float32Array) -> None:
    """Replace each cell by the sum of those within `reach` of it, both ways."""
    rows, columns = layer.shape
    scratch[:] = 0
    for offset in range(-reach, reach + 1):
        for row in range(rows):
            for column in range(max(0, -offset), min(columns, columns - offset)):
                scratch[row, column] += layer[row, column + offset]
    layer[:] = 0
    for offset in range(-reach, reach + 1):
        for row in range(max(0, -offset), min(rows, rows - offset)):
            for column in range(columns):
                layer[row, column] += scratch[row + offset, column]


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _compare(usual: Float32Array, lately: Float32Array, reach: int, room: Float32Array) -> None:
    """Squares of the usual maps, their sums round each cell, and the sums of the squared changes, into the room."""
    _, rows, columns = usual.shape
    for row in range(rows):
        for column in range(columns):
            square = change = 0.0
            for layer in (GRADIENT_X, GRADIENT_Y, RIDGE):
                value = usual[layer, row, column]
                square += value * value
                change += (lately[layer, row, column] - value) ** 2
            room[SQUARES, row, column] = room[SUMS, row, column] = square
            room[CHANGES, row, column] = change
    _sum_around(room[SUMS], reach, room[SCRATCH])
    _sum_around(room[CHANGES], reach, room[SCRATCH])


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _compare_known(usual: Float32Array, lately: Float32Array, seen: Float64Array, reach: int,
                   room: Float32Array) -> None:  # fmt: skip
    """The same, where more of the same is no change, nor are gradients along directions that are not known."""
    _, rows, columns = usual.shape
    xx, xy, yy = np.float32(seen[0, 0]), np.float32(seen[0, 1]), np.float32(seen[1, 1])
    for row in range(rows):
        for column in range(columns):
            x, y, ridge = usual[GRADIENT_X, row, column], usual[GRADIENT_Y, row, column], usual[RIDGE, row, column]
            x_now, y_now = lately[GRADIENT_X, row, column], lately[GRADIENT_Y, row, column]
            ridge_now = lately[RIDGE, row, column]
            square = x * (xx * x + xy * y) + y * (xy * x + yy * y) + ridge * ridge
            room[SQUARES, row, column] = room[SUMS, row, column] = square
            room[COMMON, row, column] = x_now * (xx * x + xy * y) + y_now * (xy * x + yy * y) + ridge_now * ridge
            square_now = x_now * (xx * x_now + xy * y_now) + y_now * (xy * x_now + yy * y_now) + ridge_now * ridge_now
            room[CHANGES, row, column] = square_now
    for layer in (SUMS, COMMON, CHANGES):
        _sum_around(room[layer], reach, room[SCRATCH])
    for row in range(rows):
        for column in range(columns):
            square, common = room[SUMS, row, column], room[COMMON, row, column]
            times = max(np.float32(1), common / (square + np.float32(SQUARES_FLOOR)))
            change = room[CHANGES, row, column] - times * (2 * common - times * square)
            room[CHANGES, row, column] = max(np.float32(0), change)


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _stays(room: Float32Array, row: int, column: int) -> float:
    """How alike a cell stays, 0 to 1: u / (u + DISTRUST c), u being the squares of the usual maps round it, c
    those of the changes."""
    square = room[SUMS, row, column] + SQUARES_FLOOR
    return float(square / (square + DISTRUST * room[CHANGES, row, column]))


@njit(cache=True, nogil=True, fastmath=True)
def weigh_cells(usual: Float32Array, recent: Float32Array, latest: Float32Array, seen: Float64Array,
                outside: Float32Array, sees_covers: bool, room: Float32Array,
                trust: Float32Array) -> float:  # fmt: skip
    """How far each cell is trusted, into `trust`; how surely something covers the target, 0 to 1.

    Outside of the target a cell also shows what lies behind it. That moves through it, so it looks different lately
    than usual: there a cell counts by how alike it stays.

    What covers the target comes over one side of it: then the middle of what stays lies beside the middle of all that
    is known, and the more surely that is so, the less cells inside count that stay less than the mean of all. An edge
    that has become stronger, as what lies behind it is another one, is not covered; nor is one along the motion so far,
    which is seen only when that turns.

    Args:
        usual: maps, shape (MAPS, rows, columns).
        recent: what they were lately.
        latest: what they were in the last few looks.
        seen: a direction d is known by d . seen d, 0 to 1, float64, shape (2, 2).
        outside: how far each cell is taken to lie outside of the target, 0 to 1, shape (rows, columns).
        sees_covers: whether cells inside may be distrusted as well.
        room: shape (LAYERS, rows, columns).
        trust: for the result, 0 to 1, shape (rows, columns).
    """
    rows, columns = outside.shape
    _compare(usual, recent, REACH_OUTSIDE, room)
    for row in range(rows):
        for column in range(columns):
            trust[row, column] = 1 - outside[row, column] * (1 - _stays(room, row, column))
    if not sees_covers:
        return 0.0
    _compare_known(usual, latest, seen, REACH_INSIDE, room)
    known = known_x = known_y = staying = staying_x = staying_y = 1e-9
    for row in range(rows):
        for column in range(columns):
            if outside[row, column] < 1:
                square = room[SQUARES, row, column]
                still = square * _stays(room, row, column)
                known += square
                known_x += square * column
                known_y += square * row
                staying += still
                staying_x += still * column
                staying_y += still * row
    beside_x = (staying_x / staying - known_x / known) / columns
    beside_y = (staying_y / staying - known_y / known) / rows
    least, most = ONE_SIDED
    covered = min(1.0, max(0.0, (np.hypot(beside_x, beside_y) - least) / (most - least)))
    if covered == 0:
        return 0.0
    mean = staying / known
    for row in range(rows):
        for column in range(columns):
            share = (_stays(room, row, column) / mean - LEAST_STAYING) / (1 - LEAST_STAYING)
            distrust = covered * (1 - min(1.0, max(0.0, share)))
            trust[row, column] -= (1 - outside[row, column]) * distrust
    return float(covered)


@njit(cache=True, nogil=True, fastmath=True)
def apply_trust(usual: Float32Array, recent: Float32Array, trust: Float32Array, trusted: Float32Array,
                both: Float32Array) -> None:  # fmt: skip
    """The usual maps, into `trusted`, and the mean of them and the recent ones, into `both`, their cells by `trust`."""
    _, rows, columns = usual.shape
    for layer in (GRADIENT_X, GRADIENT_Y, RIDGE):
        for row in range(rows):
            for column in range(columns):
                by, value = trust[row, column], usual[layer, row, column]
                trusted[layer, row, column] = by * value
                both[layer, row, column] = by * 0.5 * (value + recent[layer, row, column])
