"""Compiled parts of the contour tracker. Kernels that call each other share this file, or numba would miss changes.

A *point* is an event pixel of the surface: x, y (pixels, at the middle of the pixel), its age (s) and its polarity
(+1 or -1), a row of a float32 array of shape (capacity, 4). A *pose* places the model on the sensor: x, y of its centre
(pixels), its scale, and its angle (rad). The model's maps are float32, shape (maps, rows, columns); a cell is `cell_px`
pixels of the target at scale 1.

A *motion* is float64, shape (4,): along x, along y, turning, growing. As a velocity it is in pixels/s, pixels/s, rad/s
and 1/s (of the logarithm of the scale). Where polarities are predicted by it, it is in pixels, the last two being those
of a point `arm` cells from the middle (`arm_cells`).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]

ALONG_X, ALONG_Y, TURNING, GROWING = range(4)
"""Parts of a motion."""
SCALE, ANGLE = 2, 3
"""Parts of a pose that are fitted beside its place."""
X, Y, AGE, POLARITY = range(4)
"""Columns of a point."""
GRADIENT_X, GRADIENT_Y, RIDGE, WEIGHT, DENSITY = range(5)
"""Maps of the model: what polarity motion along x and along y makes; where events are, less the mean; how much a cell
counts; where events are."""
MAPS = 5
SUMS = 6
"""What a place is judged by (`_sums`)."""
SUPPORT_FLOOR = 20.0
"""Added to the number of points under the model, so that few of them never look certain."""
NORM_FLOOR = 0.1
CLIMBS = 3
"""The place found with the nearest cells may be a step off; so often it is moved to a better neighbour."""
POINTS_SEARCHED = 300
"""About so many points are enough to find the place; all of them put it right."""
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
def parabola(left: float, middle: float, right: float, stiffness: float = 0.0) -> float:
    """Where the parabola through three values at -1, 0, 1 is largest, within half a step; 0 if it has no top.

    One that bends less than `stiffness` hardly tells, and stays near 0.
    """
    curvature = left - 2 * middle + right - stiffness
    if curvature >= 0:
        return 0.0
    return float(min(max(0.5 * (left - right) / curvature, -0.5), 0.5))


@njit(cache=True, nogil=True)
def arm_cells(rows: int, columns: int) -> float:
    """Cells from the middle to where turning and growing move the model as much as moving does, usually."""
    return 0.25 * (rows + columns)


@njit(cache=True, nogil=True, fastmath=True, inline="always")
def _moved(points: Float32Array, index: int, x: float, y: float, velocity: Float64Array) -> tuple[float, float]:
    """Where a point is now, from x, y of the centre now (pixels): moved on by its age."""
    age = points[index, AGE]
    dx = points[index, X] + velocity[ALONG_X] * age - x
    dy = points[index, Y] + velocity[ALONG_Y] * age - y
    grown, turned = 1 + velocity[GROWING] * age, velocity[TURNING] * age
    return grown * dx - turned * dy, grown * dy + turned * dx


@njit(cache=True, nogil=True, fastmath=True)
def _sums(points: Float32Array, count: int, maps: Float32Array, x: float, y: float, cosine: float, sine: float,
          velocity: Float64Array) -> tuple[float, float, float, float, float, float]:  # fmt: skip
    """What the model's maps hold under the points, moved on by their age: with polarity the gradients along x and y,
    and those that turning and growing move along; ridge; weight.

    `cosine` and `sine` are those of the pose's angle, over the pixels of a cell.
    """
    _, rows, columns = maps.shape
    middle_column, middle_row = (columns - 1) / 2, (rows - 1) / 2
    arm = arm_cells(rows, columns)
    along_x = along_y = around = outward = ridge = support = 0.0
    for index in range(count):
        dx, dy = _moved(points, index, x, y, velocity)
        across, down = cosine * dx + sine * dy, cosine * dy - sine * dx
        column, row = across + middle_column, down + middle_row
        if column < 0 or row < 0 or column >= columns - 1 or row >= rows - 1:
            continue
        c, r = int(column), int(row)
        right, below = column - c, row - r
        a, b = (1 - right) * (1 - below), right * (1 - below)
        d, e = (1 - right) * below, right * below
        polarity = points[index, POLARITY]
        gx = polarity * (a * maps[0, r, c] + b * maps[0, r, c + 1] + d * maps[0, r + 1, c] + e * maps[0, r + 1, c + 1])
        gy = polarity * (a * maps[1, r, c] + b * maps[1, r, c + 1] + d * maps[1, r + 1, c] + e * maps[1, r + 1, c + 1])
        along_x += gx
        along_y += gy
        around += gy * across - gx * down
        outward += gx * across + gy * down
        ridge += a * maps[2, r, c] + b * maps[2, r, c + 1] + d * maps[2, r + 1, c] + e * maps[2, r + 1, c + 1]
        support += maps[3, r, c]
    return along_x, along_y, around / arm, outward / arm, ridge, support


@njit(cache=True, nogil=True, fastmath=True)
def best_motion(sums: tuple[float, float, float, float, float, float], norms: Float64Array) -> tuple[float, float]:
    """The direction of motion whose predicted polarities correlate best with the points' (least squares), in the
    model's coordinates.

    A gradient that has not been seen yet is taken for a small one.
    """
    floor = NORM_FLOOR * (norms[0, 0] + norms[1, 1]) + 1e-12
    xx, yy = norms[0, 0] + floor, norms[1, 1] + floor
    determinant = xx * yy - norms[0, 1] * norms[0, 1]
    return (yy * sums[0] - norms[0, 1] * sums[1]) / determinant, (xx * sums[1] - norms[0, 1] * sums[0]) / determinant


@njit(cache=True, nogil=True, fastmath=True)
def _score(sums: tuple[float, float, float, float, float, float], norms: Float64Array, cos: float, sin: float,
           motion_x: float, motion_y: float, motion: Float64Array, ridge_weight: float, any_motion: bool
           ) -> float:  # fmt: skip
    """Correlation of points and model for a motion: polarity as the gradient along it predicts, and places.

    `cos` and `sin` are those of the pose's angle; `motion_x` and `motion_y` are added to `motion`. With `any_motion` it
    is the correlation of the direction of motion that fits best, without turning and growing.
    """
    turning, growing = motion[TURNING], motion[GROWING]
    if any_motion:
        x, y = best_motion(sums, norms)
        turning = growing = 0.0
    else:
        across, down = motion[ALONG_X] + motion_x, motion[ALONG_Y] + motion_y
        x, y = cos * across + sin * down, cos * down - sin * across
    score = ridge_weight * sums[4] / np.sqrt(norms[4, 4])
    square = (
        x * (x * norms[0, 0] + 2 * (y * norms[0, 1] + turning * norms[0, 2] + growing * norms[0, 3]))
        + y * (y * norms[1, 1] + 2 * (turning * norms[1, 2] + growing * norms[1, 3]))
        + turning * (turning * norms[2, 2] + 2 * growing * norms[2, 3])
        + growing * growing * norms[3, 3]
    )
    if x * x + y * y + turning * turning + growing * growing > 1e-12:
        along = sums[0] * x + sums[1] * y + sums[2] * turning + sums[3] * growing
        score += along / np.sqrt(max(square, 1e-12))
    return float(score / np.sqrt(sums[5] + SUPPORT_FLOOR))


@njit(cache=True, nogil=True, fastmath=True)
def score_at(points: Float32Array, count: int, maps: Float32Array, norms: Float64Array, pose: Float64Array,
             cell_px: float, velocity: Float64Array, motion: Float64Array, ridge_weight: float, any_motion: bool
             ) -> tuple[float, float, float, float]:  # fmt: skip
    """(score, points under the model, x and y of the motion that fits best) of one pose."""
    size = 1 / (cell_px * pose[2])
    cos, sin = np.cos(pose[3]), np.sin(pose[3])
    sums = _sums(points, count, maps, pose[0], pose[1], cos * size, sin * size, velocity)
    score = _score(sums, norms, cos, sin, 0.0, 0.0, motion, ridge_weight, any_motion)
    x, y = best_motion(sums, norms)
    return score, sums[5], cos * x - sin * y, cos * y + sin * x


@njit(cache=True, nogil=True, fastmath=True)
def scores_beside(points: Float32Array, count: int, maps: Float32Array, norms: Float64Array, pose: Float64Array,
                  part: int, step: float, cell_px: float, velocity: Float64Array, motion: Float64Array,
                  ridge_weight: float) -> tuple[float, float, float]:  # fmt: skip
    """Scores of a pose whose scale (`part` SCALE) is less by a step (of its logarithm, nearly), as it is and greater,
    or its angle (`part` ANGLE; rad).

    A larger model has more cells to agree with: the norm of what it predicts grows by its scale.
    """
    scores = np.empty(3)
    beside = pose.copy()
    for number in range(3):
        change = (number - 1) * step
        beside[part] = pose[part] * (1 + change) if part == SCALE else pose[part] + change
        score, _, _, _ = score_at(
            points, count, maps, norms, beside, cell_px, velocity, motion, ridge_weight, False
        )  # fmt: skip
        scores[number] = score / beside[SCALE]
    return scores[0], scores[1], scores[2]


@njit(cache=True, nogil=True, fastmath=True)
def _sums_on_grid(points: Float32Array, count: int, maps: Float32Array, x: float, y: float, cosine: float, sine: float,
                  velocity: Float64Array, step_px: float, sums: Float64Array) -> None:  # fmt: skip
    """`_sums` for every place of a square grid round x, y, with the cell nearest to each point, and of so many points
    only as find the place: `sums`, shape (2r + 1, 2r + 1, 6)."""
    _, rows, columns = maps.shape
    side = sums.shape[0]
    radius = side // 2
    arm = arm_cells(rows, columns)
    table = np.empty((rows, columns, 6), np.float32)
    for row in range(rows):
        for column in range(columns):
            across, down = (column - (columns - 1) / 2) / arm, (row - (rows - 1) / 2) / arm
            gx, gy = np.float64(maps[GRADIENT_X, row, column]), np.float64(maps[GRADIENT_Y, row, column])
            table[row, column, 0], table[row, column, 1] = gx, gy
            table[row, column, 2], table[row, column, 3] = gy * across - gx * down, gx * across + gy * down
            table[row, column, 4], table[row, column, 5] = maps[RIDGE, row, column], maps[WEIGHT, row, column]
    sums[:] = 0
    for index in range(0, count, 1 + count // POINTS_SEARCHED):
        dx, dy = _moved(points, index, x, y, velocity)
        polarity = points[index, POLARITY]
        for j in range(side):
            for i in range(side):
                across, down = dx - (i - radius) * step_px, dy - (j - radius) * step_px
                column = int(cosine * across + sine * down + columns / 2)
                row = int(cosine * down - sine * across + rows / 2)
                if 0 <= column < columns and 0 <= row < rows:
                    at, sum_of = table[row, column], sums[j, i]
                    sum_of[0] += polarity * at[0]
                    sum_of[1] += polarity * at[1]
                    sum_of[2] += polarity * at[2]
                    sum_of[3] += polarity * at[3]
                    sum_of[4] += at[4]
                    sum_of[5] += at[5]


@njit(cache=True, nogil=True, fastmath=True)
def search(points: Float32Array, count: int, maps: Float32Array, norms: Float64Array, pose: Float64Array,
           cell_px: float, velocity: Float64Array, bias: Float64Array, before: Float64Array, ridge_weight: float,
           any_motion: bool, step_px: float, sums: Float64Array) -> tuple[float, float]:  # fmt: skip
    """The best place on a square grid round a pose, then between its points by parabolas.

    `bias` is the motion that is added to the one from `before`, x, y of the target at its last look, to a place, for
    the polarity it predicts. `sums`, float64 of shape (2r + 1, 2r + 1, 6), is room for the grid.
    Returns x, y of the best place (pixels).
    """
    side = sums.shape[0]
    radius = side // 2
    size = 1 / (cell_px * pose[2])
    cos, sin = np.cos(pose[3]), np.sin(pose[3])
    cosine, sine = cos * size, sin * size
    _sums_on_grid(points, count, maps, pose[0], pose[1], cosine, sine, velocity, step_px, sums)
    best = -np.inf
    for j in range(side):
        for i in range(side):
            found = (sums[j, i, 0], sums[j, i, 1], sums[j, i, 2], sums[j, i, 3], sums[j, i, 4], sums[j, i, 5])
            motion_x = pose[0] + (i - radius) * step_px - before[0]
            motion_y = pose[1] + (j - radius) * step_px - before[1]
            sums[j, i, 0] = _score(found, norms, cos, sin, motion_x, motion_y, bias, ridge_weight, any_motion)
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
                if axis == 1 and number == 1:
                    around[1, 1] = around[0, 1]
                    continue
                offset = (number - 1) * step_px
                at_x, at_y = (x + offset, y) if axis == 0 else (x, y + offset)
                found = _sums(points, count, maps, at_x, at_y, cosine, sine, velocity)
                around[axis, number] = _score(
                    found, norms, cos, sin, at_x - before[0], at_y - before[1], bias, ridge_weight, any_motion
                )
        uphill_x, uphill_y = np.argmax(around[0]) - 1, np.argmax(around[1]) - 1
        if uphill_x == 0 and uphill_y == 0:
            break
        x, y = x + uphill_x * step_px, y + uphill_y * step_px
    x += step_px * parabola(around[0, 0], around[0, 1], around[0, 2])
    y += step_px * parabola(around[1, 0], around[1, 1], around[1, 2])
    return x, y


@njit(cache=True, nogil=True, fastmath=True)
def measure_norms(maps: Float32Array, norms: Float64Array) -> None:
    """Sums of products of the gradients that the parts of a motion move along, `norms[:4, :4]`, and of the squares of
    the ridge map, `norms[4, 4]`."""
    _, rows, columns = maps.shape
    arm = arm_cells(rows, columns)
    norms[:] = 0
    for row in range(rows):
        for column in range(columns):
            across, down = (column - (columns - 1) / 2) / arm, (row - (rows - 1) / 2) / arm
            gx, gy = np.float64(maps[GRADIENT_X, row, column]), np.float64(maps[GRADIENT_Y, row, column])
            parts = (gx, gy, gy * across - gx * down, gx * across + gy * down)
            for part in range(4):
                for other in range(part, 4):
                    norms[part, other] += parts[part] * parts[other]
            norms[4, 4] += maps[RIDGE, row, column] ** 2
    norms[4, 4] += 1e-9
