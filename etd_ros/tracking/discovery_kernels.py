"""Compiled parts of discovery: recent events, clusters of cells, and motions that make events sharp.

A *point* is a pixel that fired: x, y (pixels, at its middle) and the age of its last event (s), a row of a float32
array of shape (capacity, 3). A *cell* is a square of pixels; cells hold how many points they have.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
Int32Array = npt.NDArray[np.int32]
Int64Array = npt.NDArray[np.int64]

X, Y, AGE = range(3)
"""Columns of a point."""


@njit(cache=True, nogil=True)
def enter(times: Int64Array, of_each: Int64Array, levels: npt.NDArray[np.uint16], start_ns: int,
          duration_ns: int) -> None:  # fmt: skip
    """Enter a frame's event times, from its grey levels, into the last times of the pixels, shape (pixels,), and of
    each polarity, shape (pixels, 2).

    A pixel's two levels are one number, so that most pixels, which have no event, take one comparison.
    """
    share = duration_ns / 255.0
    for pixel in range(len(levels)):
        both = levels[pixel]
        if both:
            first, second = both & 0xFF, both >> 8
            times[pixel] = start_ns + np.int64(max(first, second) * share)
            if first:
                of_each[pixel, 0] = start_ns + np.int64(first * share)
            if second:
                of_each[pixel, 1] = start_ns + np.int64(second * share)


@njit(cache=True, nogil=True)
def count_recent(times: Int64Array, oldest_ns: int) -> int:
    """How many pixels fired after a time."""
    height, width = times.shape
    count = 0
    for row in range(height):
        for column in range(width):
            count += times[row, column] > oldest_ns
    return count


@njit(cache=True, nogil=True)
def supported_points(times: Int64Array, now_ns: int, oldest_ns: int, support_ns: int, stride: int, cell: int,
                     points: Float32Array, counts: Int32Array) -> int:  # fmt: skip
    """The pixels that fired after a time and have a neighbour that fired at about the same time, as points.

    Args:
        times: last times (ns), shape (height, width).
        now_ns: the time that ages count from.
        oldest_ns: the time after which events are taken.
        support_ns: a neighbour fired within this time of the pixel; noise has none.
        stride: only every so many-th point is taken, where there would be too many.
        cell: side of a cell (pixels).
        points: room for the points; more than fit are left out.
        counts: points in each cell, to be filled, shape (rows, columns) for the whole sensor.

    Returns:
        How many points there are.
    """
    height, width = times.shape
    counts[:] = 0
    count = seen = 0
    for row in range(height):
        for column in range(width):
            time_ns = times[row, column]
            if time_ns <= oldest_ns:
                continue
            supported = False
            for r in range(max(0, row - 1), min(height, row + 2)):
                for c in range(max(0, column - 1), min(width, column + 2)):
                    is_other = r != row or c != column
                    if is_other and abs(times[r, c] - time_ns) <= support_ns:
                        supported = True
            if not supported:
                continue
            counts[row // cell, column // cell] += 1
            seen += 1
            if seen % stride == 0 and count < len(points):
                points[count, X] = column + 0.5
                points[count, Y] = row + 0.5
                points[count, AGE] = (now_ns - time_ns) * 1e-9
                count += 1
    return count


@njit(cache=True, nogil=True)
def label_cells(counts: Int32Array, least: int, labels: Int32Array, stack: Int32Array) -> int:
    """Number the clusters of neighbouring cells (eight neighbours) that hold at least so many points.

    Args:
        counts: shape (rows, columns).
        least: the fewest points.
        labels: to be filled: 0 for no cluster, else its number from 1.
        stack: room, shape (rows * columns, 2).

    Returns:
        How many clusters there are.
    """
    rows, columns = counts.shape
    labels[:] = 0
    clusters = 0
    for row in range(rows):
        for column in range(columns):
            if counts[row, column] < least or labels[row, column] > 0:
                continue
            clusters += 1
            labels[row, column] = clusters
            stack[0, 0], stack[0, 1] = row, column
            waiting = 1
            while waiting > 0:
                waiting -= 1
                y, x = stack[waiting, 0], stack[waiting, 1]
                for r in range(max(0, y - 1), min(rows, y + 2)):
                    for c in range(max(0, x - 1), min(columns, x + 2)):
                        if counts[r, c] >= least and labels[r, c] == 0:
                            labels[r, c] = clusters
                            stack[waiting, 0], stack[waiting, 1] = r, c
                            waiting += 1
    return clusters


@njit(cache=True, nogil=True)
def deal_to_tiles(points: Float32Array, count: int, tile: int, columns: int, kept: Float32Array,
                  seen: Int32Array) -> None:  # fmt: skip
    """Give each tile of the sensor some of its points, spread evenly over it.

    Args:
        points: the points.
        count: how many there are.
        tile: side of a tile (pixels).
        columns: tiles in a row.
        kept: to be filled: the points of each tile, x and y from its corner, shape (tiles, most, 3).
        seen: to be filled: how many points each tile has, shape (tiles,).
    """
    seen[:] = 0
    most = kept.shape[1]
    for index in range(count):
        x, y = points[index, X], points[index, Y]
        column, row = int(x) // tile, int(y) // tile
        number = row * columns + column
        place = seen[number]
        seen[number] += 1
        if place >= most:
            # The first ones would be those of the upper rows: later ones take their places as if by chance.
            place = (place * 7919) % seen[number]
            if place >= most:
                continue
        kept[number, place, X] = x - column * tile
        kept[number, place, Y] = y - row * tile
        kept[number, place, AGE] = points[index, AGE]


@njit(cache=True, nogil=True)
def score_tiles(kept: Float32Array, seen: Int32Array, least: int, tile: int, step_px: float, window_s: float,
                scores: Float32Array) -> None:  # fmt: skip
    """How sharp each tile's points become for each velocity of a square grid: the chance that two points of the tile,
    moved on by their ages, fall on the same pixel.

    Args:
        kept: the points of each tile, from `deal_to_tiles`.
        seen: how many points each tile has.
        least: a tile with fewer points gets no scores, zeros.
        tile: side of a tile (pixels).
        step_px: distance of the velocities (pixels of motion in the window).
        window_s: the points' largest age (s); older ones count as if they had this age.
        scores: to be filled, shape (tiles, 2 reach + 1, 2 reach + 1): velocities along y, then x.
    """
    tiles, most, _ = kept.shape
    grid = scores.shape[1]
    reach = grid // 2
    margin = int(reach * step_px) + 2
    side = tile + 2 * margin
    drawn = np.zeros(side * side, np.int32)
    columns = np.empty((grid, most), np.int32)
    rows = np.empty((grid, most), np.int32)
    scores[:] = 0
    for number in range(tiles):
        held = min(seen[number], most)
        if held < least:
            continue
        for p in range(held):
            motion = min(max(kept[number, p, AGE] / window_s, 0.0), 1.0) * step_px
            for k in range(grid):
                columns[k, p] = int(kept[number, p, X] + (k - reach) * motion + margin)
                rows[k, p] = int(kept[number, p, Y] + (k - reach) * motion + margin) * side
        for j in range(grid):
            for i in range(grid):
                pairs = 0
                for p in range(held):
                    pairs += drawn[rows[j, p] + columns[i, p]]
                    drawn[rows[j, p] + columns[i, p]] += 1
                for p in range(held):
                    drawn[rows[j, p] + columns[i, p]] = 0
                scores[number, j, i] = 2.0 * pairs / (held * held)


@njit(cache=True, nogil=True)
def draw(points: Float32Array, velocity_x: float, velocity_y: float, picture: Float32Array) -> None:
    """Draw points, moved on by their ages, with linear weights; what falls outside of the picture is left out."""
    rows, columns = picture.shape
    picture[:] = 0
    for index in range(len(points)):
        x = points[index, X] + velocity_x * points[index, AGE] - 0.5
        y = points[index, Y] + velocity_y * points[index, AGE] - 0.5
        if x < 0 or y < 0 or x >= columns - 1 or y >= rows - 1:
            continue
        c, r = int(x), int(y)
        right, below = x - c, y - r
        picture[r, c] += (1 - right) * (1 - below)
        picture[r, c + 1] += right * (1 - below)
        picture[r + 1, c] += (1 - right) * below
        picture[r + 1, c + 1] += right * below


@njit(cache=True, nogil=True)
def sharpness(points: Float32Array, velocity_x: float, velocity_y: float, room: Float32Array) -> float:
    """The sum of the squares of the points' picture: the larger, the more of them fall together. The room is zeros, of
    the picture's shape, and zeros again afterwards."""
    rows, columns = room.shape
    total = 0.0
    for clears in range(2):
        for index in range(len(points)):
            x = points[index, X] + velocity_x * points[index, AGE] - 0.5
            y = points[index, Y] + velocity_y * points[index, AGE] - 0.5
            if x < 0 or y < 0 or x >= columns - 1 or y >= rows - 1:
                continue
            c, r = int(x), int(y)
            right, below = x - c, y - r
            for part in range(4):
                to_right, to_below = part % 2, part // 2
                weight = (right if to_right else 1 - right) * (below if to_below else 1 - below)
                if clears:
                    room[r + to_below, c + to_right] = 0
                else:
                    total += weight * (2 * room[r + to_below, c + to_right] + weight)
                    room[r + to_below, c + to_right] += weight
    return total


@njit(cache=True, nogil=True)
def refined_velocity(points: Float32Array, velocity_x: float, velocity_y: float, step_px_s: float,
                     room: Float32Array) -> tuple[float, float]:  # fmt: skip
    """The velocity near one (pixels/s) that makes the points sharpest: steps along x and y that halve twice."""
    best = sharpness(points, velocity_x, velocity_y, room)
    step = step_px_s
    for _ in range(2):
        step *= 0.5
        moved = True
        moves = 0
        while moved and moves < 4:
            moved = False
            moves += 1
            base_x, base_y = velocity_x, velocity_y
            for side in range(4):
                x = base_x + step * ((side == 0) - (side == 1))
                y = base_y + step * ((side == 2) - (side == 3))
                value = sharpness(points, x, y, room)
                if value > best:
                    best, velocity_x, velocity_y, moved = value, x, y, True
    return velocity_x, velocity_y


@njit(cache=True, nogil=True)
def read_evidence(points: Float32Array, velocity_x: float, velocity_y: float, own: Float32Array, other_x: float,
                  other_y: float, other: Float32Array, floor: float, evidence: Float32Array,
                  places: Float32Array) -> None:  # fmt: skip
    """Where the points move with one velocity rather than with another one.

    Args:
        points: the points, from the pictures' corner.
        velocity_x: a velocity along x (pixels/s).
        velocity_y: the same along y.
        own: the (smoothed) picture that it draws.
        other_x: the other velocity along x (pixels/s).
        other_y: the same along y.
        other: the picture that this one draws.
        floor: added to both pictures, so that single points say little.
        evidence: to be filled, of the pictures' shape: the sum of the points' log ratios where the first velocity
            moves them to.
        places: to be filled: x, y there and the log ratio of each point, shape (n, 3); (-1, -1, 0) if outside.
    """
    rows, columns = own.shape
    evidence[:] = 0
    for index in range(len(points)):
        age = points[index, AGE]
        # As the places are kept: a sum just inside of the picture may be rounded to its border.
        x, y = np.float32(points[index, X] + velocity_x * age), np.float32(points[index, Y] + velocity_y * age)
        other_column, other_row = int(points[index, X] + other_x * age), int(points[index, Y] + other_y * age)
        places[index, 0], places[index, 1], places[index, 2] = -1, -1, 0
        if x < 0 or y < 0 or x >= columns or y >= rows:
            continue
        other_column = min(max(other_column, 0), columns - 1)
        other_row = min(max(other_row, 0), rows - 1)
        ratio = np.log((own[int(y), int(x)] + floor) / (other[other_row, other_column] + floor))
        evidence[int(y), int(x)] += ratio
        places[index, 0], places[index, 1], places[index, 2] = x, y, ratio
