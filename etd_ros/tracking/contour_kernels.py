"""Compiled parts of the contour tracker. Kernels that call each other share this file, or numba would miss changes.

A *point* is an event pixel of the surface: x, y (pixels, at the middle of the pixel), its age (s) and its polarity
(+1 or -1), a row of a float32 array of shape (capacity, 4). A *pose* places the model on the sensor: x, y of its centre
(pixels), its scale, and its angle (rad). The model's maps are float32, shape (maps, rows, columns); a cell is `cell_px`
pixels of the target at scale 1.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]

X, Y, AGE, POLARITY = range(4)
"""Columns of a point."""
GRADIENT_X, GRADIENT_Y, RIDGE, WEIGHT, DENSITY = range(5)
"""Maps of the model: what polarity motion along x and along y makes; where events are, less the mean; how much a cell
counts; where events are."""
MAPS = 5
SUPPORT_FLOOR = 20.0
"""Added to the number of points under the model, so that few of them never look certain."""
NORM_FLOOR = 0.1
CLIMBS = 3
"""The place found with the nearest cells may be a step off; so often it is moved to a better neighbour."""
POINTS_SEARCHED = 300
"""About so many points are enough to find the place; all of them put it right."""
COHERENCE_FLOOR = 10.0
"""Added to the coherence that is possible, so that few points never look coherent."""
CROWDING_POWER = 0.7
"""Of the coherence that is possible: with 0 busy places would win, with 1 a few points that agree."""
PRIOR_WEIGHT = 0.05
"""How much of the best score a place at the edge of the search gives away to one in its middle."""


@njit(cache=True, nogil=True)
def keep_times(times: npt.NDArray[np.int64], data: npt.NDArray[np.uint8], start_ns: int, duration_ns: int, top: int,
               bottom: int, left: int, right: int) -> int:  # fmt: skip
    """Enter a frame's event times into the surface, in a window of both; the number of its event pixels there."""
    count = 0
    share = duration_ns / 255.0
    for row in range(top, bottom):
        for column in range(left, right):
            for channel in range(2):
                level = data[row, column, channel]
                if level > 0:
                    count += 1
                    times[row, column, channel] = start_ns + np.int64(level * share)
    return count


@njit(cache=True, nogil=True)
def gather(times: npt.NDArray[np.int64], now_ns: int, oldest_ns: int, top: int, bottom: int, left: int, right: int,
           points: Float32Array) -> int:  # fmt: skip
    """The surface's event pixels after `oldest_ns` in a window, as points; their number. More than fit are left out."""
    count = 0
    for row in range(top, bottom):
        for column in range(left, right):
            for channel in range(2):
                time_ns = times[row, column, channel]
                if time_ns > oldest_ns and count < len(points):
                    points[count, X] = column + 0.5
                    points[count, Y] = row + 0.5
                    points[count, AGE] = (now_ns - time_ns) * 1e-9
                    points[count, POLARITY] = 1.0 if channel == 0 else -1.0
                    count += 1
    return count


@njit(cache=True, nogil=True)
def parabola(left: float, middle: float, right: float) -> float:
    """Where the parabola through three values at -1, 0, 1 is largest, within half a step; 0 if it has no top."""
    curvature = left - 2 * middle + right
    if curvature >= 0:
        return 0.0
    return float(min(max(0.5 * (left - right) / curvature, -0.5), 0.5))


@njit(cache=True, nogil=True, fastmath=True)
def _sums(points: Float32Array, count: int, maps: Float32Array, x: float, y: float, cosine: float, sine: float,
          velocity_x: float, velocity_y: float) -> tuple[float, float, float, float]:  # fmt: skip
    """What the model's maps hold under the points, moved on by their age: gradients with polarity, ridge, weight.

    `cosine` and `sine` are those of the pose's angle, over the pixels of a cell.
    """
    _, rows, columns = maps.shape
    middle_column, middle_row = (columns - 1) / 2, (rows - 1) / 2
    along_x = along_y = ridge = support = 0.0
    for index in range(count):
        dx = points[index, X] + velocity_x * points[index, AGE] - x
        dy = points[index, Y] + velocity_y * points[index, AGE] - y
        column = cosine * dx + sine * dy + middle_column
        row = cosine * dy - sine * dx + middle_row
        if column < 0 or row < 0 or column >= columns - 1 or row >= rows - 1:
            continue
        c, r = int(column), int(row)
        right, below = column - c, row - r
        a, b = (1 - right) * (1 - below), right * (1 - below)
        d, e = (1 - right) * below, right * below
        polarity = points[index, POLARITY]
        along_x += polarity * (
            a * maps[0, r, c] + b * maps[0, r, c + 1] + d * maps[0, r + 1, c] + e * maps[0, r + 1, c + 1]
        )
        along_y += polarity * (
            a * maps[1, r, c] + b * maps[1, r, c + 1] + d * maps[1, r + 1, c] + e * maps[1, r + 1, c + 1]
        )
        ridge += a * maps[2, r, c] + b * maps[2, r, c + 1] + d * maps[2, r + 1, c] + e * maps[2, r + 1, c + 1]
        support += maps[3, r, c]
    return along_x, along_y, ridge, support


@njit(cache=True, nogil=True, fastmath=True)
def best_motion(sums: tuple[float, float, float, float], norms: Float64Array) -> tuple[float, float]:
    """The direction of motion whose predicted polarities correlate best with the points' (least squares).

    A gradient that has not been seen yet is taken for a small one.
    """
    floor = NORM_FLOOR * (norms[0] + norms[2]) + 1e-12
    xx, yy = norms[0] + floor, norms[2] + floor
    determinant = xx * yy - norms[1] * norms[1]
    return (yy * sums[0] - norms[1] * sums[1]) / determinant, (xx * sums[1] - norms[1] * sums[0]) / determinant


@njit(cache=True, nogil=True, fastmath=True)
def _agreement(sums: tuple[float, float, float, float], norms: Float64Array, motion_x: float, motion_y: float,
               ridge_weight: float, any_motion: bool) -> float:  # fmt: skip
    """Correlation of points and model for a motion: polarity as the gradient along it predicts, and places.

    With `any_motion` it is that of the direction of motion that fits best.
    """
    if any_motion:
        motion_x, motion_y = best_motion(sums, norms)
    length = np.sqrt(motion_x * motion_x + motion_y * motion_y)
    agreement = ridge_weight * sums[2] / np.sqrt(norms[3])
    if length > 1e-6:
        x, y = motion_x / length, motion_y / length
        norm = np.sqrt(max(x * x * norms[0] + 2 * x * y * norms[1] + y * y * norms[2], 1e-12))
        agreement += (sums[0] * x + sums[1] * y) / norm
    return float(agreement)


@njit(cache=True, nogil=True, fastmath=True)
def score_at(points: Float32Array, count: int, maps: Float32Array, norms: Float64Array, pose: Float64Array,
             cell_px: float, velocity: Float64Array, motion: Float64Array, ridge_weight: float, any_motion: bool
             ) -> tuple[float, float, float, float, float]:  # fmt: skip
    """(score, agreement per point, points under the model, x and y of the motion that fits best) of one pose."""
    size = 1 / (cell_px * pose[2])
    sums = _sums(points, count, maps, pose[0], pose[1], np.cos(pose[3]) * size, np.sin(pose[3]) * size, velocity[0],
                 velocity[1])  # fmt: skip
    agreement = _agreement(sums, norms, motion[0], motion[1], ridge_weight, any_motion)
    x, y = best_motion(sums, norms)
    return agreement / np.sqrt(sums[3] + SUPPORT_FLOOR), agreement / max(sums[3], 1.0), sums[3], x, y


@njit(cache=True, nogil=True, fastmath=True)
def _sums_on_grid(points: Float32Array, count: int, maps: Float32Array, x: float, y: float, cosine: float, sine: float,
                  velocity: Float64Array, step_px: float, sums: Float64Array) -> None:  # fmt: skip
    """`_sums` for every place of a square grid round x, y, with the cell nearest to each point, and of so many points
    only as find the place: `sums`, shape (2r + 1, 2r + 1, 4)."""
    _, rows, columns = maps.shape
    side = sums.shape[0]
    radius = side // 2
    table = np.empty((rows, columns, 4), np.float32)
    for row in range(rows):
        for column in range(columns):
            for part in range(4):
                table[row, column, part] = maps[part, row, column]
    sums[:] = 0
    for index in range(0, count, 1 + count // POINTS_SEARCHED):
        dx = points[index, X] + velocity[0] * points[index, AGE] - x
        dy = points[index, Y] + velocity[1] * points[index, AGE] - y
        polarity = points[index, POLARITY]
        for j in range(side):
            for i in range(side):
                across, down = dx - (i - radius) * step_px, dy - (j - radius) * step_px
                column = int(cosine * across + sine * down + columns / 2)
                row = int(cosine * down - sine * across + rows / 2)
                if 0 <= column < columns and 0 <= row < rows:
                    sums[j, i, 0] += polarity * table[row, column, 0]
                    sums[j, i, 1] += polarity * table[row, column, 1]
                    sums[j, i, 2] += table[row, column, 2]
                    sums[j, i, 3] += table[row, column, 3]


@njit(cache=True, nogil=True, fastmath=True)
def search(points: Float32Array, count: int, maps: Float32Array, norms: Float64Array, pose: Float64Array,
           cell_px: float, velocity: Float64Array, bias: Float64Array, before: Float64Array, ridge_weight: float,
           any_motion: bool, step_px: float, sums: Float64Array) -> tuple[float, float]:  # fmt: skip
    """The best place on a square grid round a pose, then between its points by parabolas.

    `bias` is motion (pixels) that is added to the one from `before`, x, y of the target at its last look, to a place,
    for the polarity it predicts. `sums`, float64 of shape (2r + 1, 2r + 1, 4), is room for the grid.
    Returns x, y of the best place (pixels).
    """
    side = sums.shape[0]
    radius = side // 2
    size = 1 / (cell_px * pose[2])
    cosine, sine = np.cos(pose[3]) * size, np.sin(pose[3]) * size
    _sums_on_grid(points, count, maps, pose[0], pose[1], cosine, sine, velocity, step_px, sums)
    best = -np.inf
    for j in range(side):
        for i in range(side):
            found = (sums[j, i, 0], sums[j, i, 1], sums[j, i, 2], sums[j, i, 3])
            motion_x = pose[0] + (i - radius) * step_px - before[0] + bias[0]
            motion_y = pose[1] + (j - radius) * step_px - before[1] + bias[1]
            score = _agreement(found, norms, motion_x, motion_y, ridge_weight, any_motion)
            sums[j, i, 0] = score / np.sqrt(found[3] + SUPPORT_FLOOR)
            best = max(best, sums[j, i, 0])
    top, best_i, best_j = -np.inf, radius, radius
    for j in range(side):
        for i in range(side):
            far = ((i - radius) ** 2 + (j - radius) ** 2) / max(1.0, (0.8 * radius) ** 2 * 2)
            score = sums[j, i, 0] - PRIOR_WEIGHT * abs(best) * far
            if score > top:
                top, best_i, best_j = score, i, j
    x, y = pose[0] + (best_i - radius) * step_px, pose[1] + (best_j - radius) * step_px
    around = np.empty((2, 3))
    for _ in range(CLIMBS):
        for axis in range(2):
            for number in range(3):
                offset = (number - 1) * step_px
                at_x, at_y = (x + offset, y) if axis == 0 else (x, y + offset)
                found = _sums(points, count, maps, at_x, at_y, cosine, sine, velocity[0], velocity[1])
                score = _agreement(
                    found, norms, at_x - before[0] + bias[0], at_y - before[1] + bias[1], ridge_weight, any_motion
                )
                around[axis, number] = score / np.sqrt(found[3] + SUPPORT_FLOOR)
        uphill_x, uphill_y = np.argmax(around[0]) - 1, np.argmax(around[1]) - 1
        if uphill_x == 0 and uphill_y == 0:
            break
        x, y = x + uphill_x * step_px, y + uphill_y * step_px
    x += step_px * parabola(around[0, 0], around[0, 1], around[0, 2])
    y += step_px * parabola(around[1, 0], around[1, 1], around[1, 2])
    return x, y


@njit(cache=True, nogil=True, fastmath=True)
def _draw_point(layer: Float32Array, column: float, row: float) -> None:
    """Weight 1, shared out over the four cells round a place that lies among the cells."""
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
        dx = points[index, X] + velocity[0] * points[index, AGE] - pose[0]
        dy = points[index, Y] + velocity[1] * points[index, AGE] - pose[1]
        column = cosine * dx + sine * dy + (columns - 1) / 2
        row = cosine * dy - sine * dx + (rows - 1) / 2
        if column < 0 or row < 0 or column >= columns - 1 or row >= rows - 1:
            continue
        _draw_point(drawn[0 if points[index, POLARITY] > 0 else 1], column, row)
        inside += 1
    return inside


@njit(cache=True, nogil=True, fastmath=True)
def blur(drawn: Float32Array, room: Float32Array) -> None:
    """Smooth each channel by 1 4 6 4 1 (a Gaussian of one cell) both ways, in place; `room` is of the same shape."""
    channels, rows, columns = drawn.shape
    for channel in range(channels):
        for row in range(rows):
            line, smooth = drawn[channel, row], room[channel, row]
            for column in range(2, columns - 2):
                near = line[column - 1] + line[column + 1]
                smooth[column] = 6 * line[column] + 4 * near + line[column - 2] + line[column + 2]
            # The two cells at each border, where less lies beside them: the model's weight is 0 there.
            for column in (0, 1, columns - 2, columns - 1):
                smooth[column] = 16 * line[column]
        for row in range(rows):
            line = drawn[channel, row]
            above, above_2 = room[channel, max(row - 1, 0)], room[channel, max(row - 2, 0)]
            below, below_2 = room[channel, min(row + 1, rows - 1)], room[channel, min(row + 2, rows - 1)]
            middle = room[channel, row]
            for column in range(columns):
                near = above[column] + below[column]
                line[column] = (6 * middle[column] + 4 * near + above_2[column] + below_2[column]) / 256


@njit(cache=True, nogil=True, fastmath=True)
def coherence(points: Float32Array, count: int, weight: Float32Array, pose: Float64Array, cell_px: float,
              velocity: Float64Array, time_s: float, parts: Float32Array, room: Float32Array) -> float:  # fmt: skip
    """How well what the points draw in one part of a time agrees with what they draw in the others, when they are moved
    back to where they began: their correlations, in parts of what they would be if all were alike.

    Contrast (Gallego et al. 2018) also grows with what a single part draws, so that a motion towards busy places wins,
    or, over the square of the number of points, one away from them. On and Off that fall together count half: flicker
    and noise agree for any motion.

    Args:
        points: their ages count backwards from the beginning, so they are negative.
        count: number of points.
        weight: of the cells, shape (rows, columns).
        pose: where the grid lies.
        cell_px: pixels of a cell at scale 1.
        velocity: x, y (pixels/s).
        time_s: from the beginning to the end (s).
        parts: room for what is drawn, shape (parts, 2, rows, columns).
        room: room for smoothing, shape (2, rows, columns).
    """
    number, _, rows, columns = parts.shape
    size = 1 / (cell_px * pose[2])
    cosine, sine = np.cos(pose[3]) * size, np.sin(pose[3]) * size
    parts[:] = 0
    for index in range(count):
        dx = points[index, X] + velocity[0] * points[index, AGE] - pose[0]
        dy = points[index, Y] + velocity[1] * points[index, AGE] - pose[1]
        column = cosine * dx + sine * dy + (columns - 1) / 2
        row = cosine * dy - sine * dx + (rows - 1) / 2
        if column < 0 or row < 0 or column >= columns - 1 or row >= rows - 1:
            continue
        part = min(number - 1, max(0, int(-points[index, AGE] / time_s * number)))
        _draw_point(parts[part, 0 if points[index, POLARITY] > 0 else 1], column, row)
    for part in range(number):
        blur(parts[part], room)
    products = np.zeros((number, number))
    for row in range(rows):
        for column in range(columns):
            square = weight[row, column] * weight[row, column]
            if square == 0:
                continue
            for part in range(number):
                on, off = parts[part, 0, row, column] * square, parts[part, 1, row, column] * square
                to_on, to_off = on - 0.5 * off, off - 0.5 * on
                for other in range(part, number):
                    products[part, other] += (
                        to_on * parts[other, 0, row, column] + to_off * parts[other, 1, row, column]
                    )
    found = possible = 0.0
    for part in range(number):
        for other in range(part + 1, number):
            found += products[part, other]
            possible += np.sqrt(products[part, part] * products[other, other])
    return float(found / (possible + COHERENCE_FLOOR) ** CROWDING_POWER)


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
    """Move the model towards what was drawn and normalised, with the direction of motion (a unit vector) at that time.

    Events of a moving gradient g have the rate and sign of -g . v (Gallego et al. 2020, equation 3): only the part of
    the gradient along the motion is corrected, the other part stays what it was. A rate of 1 forgets what was known.
    """
    _, rows, columns = drawn.shape
    mean = area = 0.0
    for row in range(rows):
        for column in range(columns):
            on, off = drawn[0, row, column], drawn[1, row, column]
            error = (
                on - off - direction[0] * maps[GRADIENT_X, row, column] - direction[1] * maps[GRADIENT_Y, row, column]
            )
            maps[GRADIENT_X, row, column] += rate * direction[0] * error
            maps[GRADIENT_Y, row, column] += rate * direction[1] * error
            maps[DENSITY, row, column] += rate * (on + off - maps[DENSITY, row, column])
            mean += maps[DENSITY, row, column]
            area += maps[WEIGHT, row, column]
    mean /= area
    for row in range(rows):
        for column in range(columns):
            maps[RIDGE, row, column] = maps[DENSITY, row, column] - mean * maps[WEIGHT, row, column]


@njit(cache=True, nogil=True, fastmath=True)
def measure_norms(maps: Float32Array, norms: Float64Array) -> None:
    """Sums of squares and of the product of the gradient maps (xx, xy, yy), and of the ridge map, into `norms`."""
    xx = xy = yy = ridge = 0.0
    for row in range(maps.shape[1]):
        for column in range(maps.shape[2]):
            x, y = maps[GRADIENT_X, row, column], maps[GRADIENT_Y, row, column]
            xx += x * x
            xy += x * y
            yy += y * y
            ridge += maps[RIDGE, row, column] ** 2
    norms[0], norms[1], norms[2], norms[3] = xx, xy, yy, ridge + 1e-9
