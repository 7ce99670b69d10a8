"""Compiled parts of the contour tracker. Kernels that call each other share this file, or numba would miss changes.

What a kernel calls is put into it (`forceinline`): its sums may be reordered (`fastmath`), and were otherwise in a
kernel compiled just now than in the same one from the cache, so that hard scenes had other boxes in the first run.

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
Turn = tuple[float, float, float, float]
"""Cells per pixel: across the model by pixels to the right and by pixels downwards, and down the model by both."""

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
SUMS, RIDGE_SUM = 6, 4
"""What a place is judged by (`sums_at`); the first of them that go without polarity."""
SUMS_OF_ANY_MOTION = (0, 1, 4, 5)
"""Those that are asked for where the motion may be any: it neither turns nor grows."""
SUPPORT_FLOOR = 20.0
"""Added to the number of points under the model, so that few of them never look certain."""
NORM_FLOOR = 0.1
CLIMBS = 3
"""The place found with the nearest cells may be a step off; so often it is moved to a better neighbour."""
STEPS_MAX = 18
"""From the middle of a search to its edge: what is finely textured agrees with itself within some two pixels."""
POINTS_SEARCHED = 300
"""About so many points are enough to find the place; all of them put it right."""
PRIOR_WEIGHT = 0.05
"""How much of the best score a place at the edge of the search gives away to one in its middle."""


@njit(cache=True, nogil=True, forceinline=True)
def parabola(left: float, middle: float, right: float, stiffness: float = 0.0) -> float:
    """Where the parabola through three values at -1, 0, 1 is largest, within half a step; 0 if it has no top.

    One that bends less than `stiffness` hardly tells, and stays near 0.
    """
    curvature = left - 2 * middle + right - stiffness
    if curvature >= 0:
        return 0.0
    return float(min(max(0.5 * (left - right) / curvature, -0.5), 0.5))


@njit(cache=True, nogil=True, forceinline=True)
def arm_cells(rows: int, columns: int) -> float:
    """Cells from the middle to where turning and growing move the model as much as moving does, usually."""
    return 0.25 * (rows + columns)


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def to_cells(width_px: float, height_px: float, angle_rad: float) -> Turn:
    """What turns pixels beside the model's middle into cells, by the width and height of a cell and the model's
    angle."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return cos / width_px, sin / width_px, -sin / height_px, cos / height_px


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _place_on_model(points: Float32Array, count: int, stride: int, x: float, y: float, turn: Turn,
                    velocity: Float64Array, places: Float32Array) -> None:  # fmt: skip
    """Where points are now, moved on by their age: cells from the model's middle, across and down, into `places`, shape
    (2, points), of every `stride`-th one.

    `x` and `y` are the model's middle (pixels); `turn` is what `to_cells` returns.
    """
    to_x, to_y = np.float32(x), np.float32(y)
    across_x, across_y, down_x, down_y = turn
    a, b, c, d = np.float32(across_x), np.float32(across_y), np.float32(down_x), np.float32(down_y)
    speed_x, speed_y = np.float32(velocity[ALONG_X]), np.float32(velocity[ALONG_Y])
    turning, growing = np.float32(velocity[TURNING]), np.float32(velocity[GROWING])
    for index in range(count):
        point = points[index * stride]
        age = point[AGE]
        from_x, from_y = point[X] + speed_x * age - to_x, point[Y] + speed_y * age - to_y
        grown, turned = np.float32(1) + growing * age, turning * age
        dx, dy = grown * from_x - turned * from_y, grown * from_y + turned * from_x
        places[0, index] = a * dx + b * dy
        places[1, index] = c * dx + d * dy


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def sums_at(points: Float32Array, count: int, maps: Float32Array, x: float, y: float, turn: Turn,
            velocity: Float64Array) -> tuple[float, float, float, float, float, float]:  # fmt: skip
    """What the model's maps hold under the points, moved on by their age: with polarity the gradients along x and y,
    and those that turning and growing move along; ridge; weight.

    The arguments are those of `_place_on_model`.
    """
    _, rows, columns = maps.shape
    places = np.empty((2, count), np.float32)
    _place_on_model(points, count, 1, x, y, turn, velocity, places)
    middle_column, middle_row = np.float32((columns - 1) / 2), np.float32((rows - 1) / 2)
    last_column, last_row = np.float32(columns - 1), np.float32(rows - 1)
    one, next_ = np.float32(1), np.uintp(1)
    gradient_x, gradient_y, ridges, weights = maps[GRADIENT_X], maps[GRADIENT_Y], maps[RIDGE], maps[WEIGHT]
    along_x = along_y = around = outward = ridge = support = np.float32(0)
    for index in range(count):
        across, down = places[0, index], places[1, index]
        column, row = across + middle_column, down + middle_row
        if column < 0 or row < 0 or column >= last_column or row >= last_row:
            continue
        # An unsigned index is not one that may count from the end: that would be asked for each of them.
        c, r = np.uintp(column), np.uintp(row)
        right, below = column - np.float32(c), row - np.float32(r)
        d = right * below
        b, e = right - d, below - d
        a = one - right - e
        c1, r1 = c + next_, r + next_
        polarity = points[index, POLARITY]
        gx = a * gradient_x[r, c] + b * gradient_x[r, c1] + e * gradient_x[r1, c] + d * gradient_x[r1, c1]
        gy = a * gradient_y[r, c] + b * gradient_y[r, c1] + e * gradient_y[r1, c] + d * gradient_y[r1, c1]
        gx, gy = polarity * gx, polarity * gy
        along_x += gx
        along_y += gy
        around += gy * across - gx * down
        outward += gx * across + gy * down
        ridge += a * ridges[r, c] + b * ridges[r, c1] + e * ridges[r1, c] + d * ridges[r1, c1]
        support += weights[r, c]
    arm = arm_cells(rows, columns)
    return float(along_x), float(along_y), float(around / arm), float(outward / arm), float(ridge), float(support)


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def best_motion(sums: tuple[float, float, float, float, float, float], norms: Float64Array) -> tuple[float, float]:
    """The direction of motion whose predicted polarities correlate best with the points' (least squares), in the
    model's coordinates.

    A gradient that has not been seen yet is taken for a small one.
    """
    floor = NORM_FLOOR * (norms[0, 0] + norms[1, 1]) + 1e-12
    xx, yy = norms[0, 0] + floor, norms[1, 1] + floor
    determinant = xx * yy - norms[0, 1] * norms[0, 1]
    return (yy * sums[0] - norms[0, 1] * sums[1]) / determinant, (xx * sums[1] - norms[0, 1] * sums[0]) / determinant


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _score(sums: tuple[float, float, float, float, float, float], norms: Float64Array, cos: float, sin: float,
           motion_x: float, motion_y: float, motion: Float64Array | tuple[float, ...], ridge_weight: float,
           any_motion: bool) -> float:  # fmt: skip
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
    size_px = cell_px * pose[SCALE]
    cos, sin = np.cos(pose[ANGLE]), np.sin(pose[ANGLE])
    sums = sums_at(points, count, maps, pose[0], pose[1], to_cells(size_px, size_px, pose[ANGLE]), velocity)
    score = _score(sums, norms, cos, sin, 0.0, 0.0, motion, ridge_weight, any_motion)
    x, y = best_motion(sums, norms)
    return score, sums[5], cos * x - sin * y, cos * y + sin * x


@njit(cache=True, nogil=True, fastmath=True)
def scores_of_shapes(points: Float32Array, count: int, maps: Float32Array, norms: Float64Array, pose: Float64Array,
                     shapes: Float64Array, cell_px: float, velocity: Float64Array, motion: Float64Array,
                     ridge_weight: float, scores: Float64Array) -> None:  # fmt: skip
    """Scores of a pose if the model had other shapes, into `scores`, shape (n,): `shapes` says how many times as wide
    and as high it would be, and by how much further it would be turned (rad), shape (n, 3).

    A larger model has more cells to agree with: the norm of what it predicts grows by the root of its area.
    """
    size_px = cell_px * pose[SCALE]
    for number in range(len(shapes)):
        wide, high, angle = shapes[number, 0], shapes[number, 1], pose[ANGLE] + shapes[number, 2]
        turn = to_cells(size_px * wide, size_px * high, angle)
        sums = sums_at(points, count, maps, pose[0], pose[1], turn, velocity)
        score = _score(sums, norms, np.cos(angle), np.sin(angle), 0.0, 0.0, motion, ridge_weight, False)
        scores[number] = score / np.sqrt(wide * high)


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _summed_parts(maps: Float32Array, any_motion: bool, cells: Float32Array) -> None:
    """What each cell adds to the sums, side by side with that of every `apart`-th cell beside it, into `cells`, shape
    (apart, rows, ceil(columns / apart) * sums)."""
    _, rows, columns = maps.shape
    apart = cells.shape[0]
    arm = arm_cells(rows, columns)
    sums = len(SUMS_OF_ANY_MOTION) if any_motion else SUMS
    for row in range(rows):
        down = np.float32((row - (rows - 1) / 2) / arm)
        for first in range(apart):
            for at, column in enumerate(range(first, columns, apart)):
                cell = cells[first, row, at * sums : (at + 1) * sums]
                gx, gy = maps[GRADIENT_X, row, column], maps[GRADIENT_Y, row, column]
                cell[0], cell[1] = gx, gy
                if not any_motion:
                    across = np.float32((column - (columns - 1) / 2) / arm)
                    cell[2], cell[3] = gy * across - gx * down, gx * across + gy * down
                cell[sums - 2], cell[sums - 1] = maps[RIDGE, row, column], maps[WEIGHT, row, column]


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def sums_on_grid(points: Float32Array, count: int, maps: Float32Array, x: float, y: float, turn: Turn,
                 velocity: Float64Array, radius: int, apart: int, any_motion: bool) -> Float32Array:  # fmt: skip
    """`sums_at` with the model's middle moved up to `radius` times by `apart` of its cells up, down, left and right,
    with the cell nearest to each point, and of so many points only as find the place.

    Moved by whole cells, what a point finds lies side by side in memory, whatever the model's angle.

    Returns:
        shape (6, 2r + 1, 2r + 1): the model is moved down and right most in the first row and column, where a point
        lies over the cell that is farthest up and left. With `any_motion` those of turning and growing are 0.
    """
    _, rows, columns = maps.shape
    groups = (columns + apart - 1) // apart
    number = len(SUMS_OF_ANY_MOTION) if any_motion else SUMS
    cells = np.zeros((apart, rows, groups * number), np.float32)
    _summed_parts(maps, any_motion, cells)
    side = 2 * radius + 1
    by_sign = np.zeros((2, side, side * number), np.float32)
    stride = 1 + count // POINTS_SEARCHED
    searched = (count + stride - 1) // stride
    places = np.empty((2, searched), np.float32)
    _place_on_model(points, searched, stride, x, y, turn, velocity, places)
    for index in range(searched):
        column = int(np.floor(places[0, index] + columns / 2))
        row = int(np.floor(places[1, index] + rows / 2))
        group = column // apart
        left, right = max(group - radius, 0), min(group + radius + 1, groups)
        up, down = max(-radius, -(row // apart)), min(radius, (rows - 1 - row) // apart)
        if left >= right:
            continue
        sign = 0 if points[index * stride, POLARITY] > 0 else 1
        into_at, from_at = np.uintp((left - group + radius) * number), np.uintp(left * number)
        for steps in range(up, down + 1):
            into = by_sign[sign, np.uintp(steps + radius)]
            from_ = cells[np.uintp(column % apart), np.uintp(row + steps * apart)]
            for part in range(np.uintp((right - left) * number)):
                into[into_at + part] += from_[from_at + part]
    # Those of a kind side by side, so that many places are scored at a time.
    sums = np.zeros((SUMS, side, side), np.float32)
    for part in range(number):
        kind = SUMS_OF_ANY_MOTION[part] if any_motion else part
        off_counts = np.float32(-1 if kind < RIDGE_SUM else 1)
        for j in range(side):
            on, off, line = by_sign[0, j], by_sign[1, j], sums[kind, j]
            for i in range(side):
                line[i] = on[i * number + part] + off_counts * off[i * number + part]
    return sums


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _best_on_grid(points: Float32Array, count: int, maps: Float32Array, norms: Float64Array, pose: Float64Array,
                  cell_px: float, velocity: Float64Array, bias: Float64Array, before: Float64Array, ridge_weight: float,
                  any_motion: bool, radius_px: float) -> tuple[float, float]:  # fmt: skip
    """The best place on a grid round a pose, of every cell of the model, or of some that are a pixel apart or, far
    round, two; the arguments are those of `search`."""
    size_px = cell_px * pose[SCALE]
    cos, sin = np.cos(pose[ANGLE]), np.sin(pose[ANGLE])
    apart = max(1, int(max(1.0, radius_px / STEPS_MAX) / size_px + 0.5))
    step_px = apart * size_px
    radius = max(1, int(radius_px / step_px + 0.5))
    turn = to_cells(size_px, size_px, pose[ANGLE])
    sums = sums_on_grid(points, count, maps, pose[0], pose[1], turn, velocity, radius, apart, any_motion)
    side = 2 * radius + 1
    scores, best = np.empty((side, side)), -np.inf
    # Numbers that lie in memory would be read anew for each place.
    added = bias[ALONG_X], bias[ALONG_Y], bias[TURNING], bias[GROWING]
    from_x, from_y = pose[0] - before[0], pose[1] - before[1]
    for j in range(side):
        down, line = (radius - j) * step_px, scores[j]
        along_x, along_y, ridge, support = sums[0, j], sums[1, j], sums[4, j], sums[5, j]
        if any_motion:
            for i in range(side):
                found = along_x[i], along_y[i], 0.0, 0.0, ridge[i], support[i]
                line[i] = _score(found, norms, cos, sin, 0.0, 0.0, added, ridge_weight, True)
        else:
            around, outward = sums[2, j], sums[3, j]
            for i in range(side):
                across = (radius - i) * step_px
                found = along_x[i], along_y[i], around[i], outward[i], ridge[i], support[i]
                motion_x, motion_y = from_x + cos * across - sin * down, from_y + cos * down + sin * across
                line[i] = _score(found, norms, cos, sin, motion_x, motion_y, added, ridge_weight, False)
        best = max(best, line.max())
    top, best_across, best_down = -np.inf, 0.0, 0.0
    for j in range(side):
        for i in range(side):
            across, down = (radius - i) * step_px, (radius - j) * step_px
            far = (across * across + down * down) / (2 * (0.8 * radius_px) ** 2)
            score = scores[j, i] - PRIOR_WEIGHT * abs(best) * far
            if score > top:
                top, best_across, best_down = score, across, down
    return pose[0] + cos * best_across - sin * best_down, pose[1] + cos * best_down + sin * best_across


@njit(cache=True, nogil=True, fastmath=True)
def search(points: Float32Array, count: int, maps: Float32Array, norms: Float64Array, pose: Float64Array,
           cell_px: float, velocity: Float64Array, bias: Float64Array, before: Float64Array, ridge_weight: float,
           any_motion: bool, radius_px: float) -> tuple[float, float]:  # fmt: skip
    """The best place on a square grid round a pose, as far as `radius_px`, then between its points: uphill by
    pixels, and to the top of parabolas.

    `bias` is the motion that is added to the one from `before`, x, y of the target at its last look, to a place, for
    the polarity it predicts.
    Returns x, y of the best place (pixels).
    """
    size_px = cell_px * pose[SCALE]
    cos, sin = np.cos(pose[ANGLE]), np.sin(pose[ANGLE])
    turn = to_cells(size_px, size_px, pose[ANGLE])
    x, y = _best_on_grid(
        points, count, maps, norms, pose, cell_px, velocity, bias, before, ridge_weight, any_motion, radius_px
    )  # fmt: skip
    # By whole pixels from there: most of what is next to a step is next to the one before, too.
    side = 2 * CLIMBS + 1
    scores, is_known = np.empty((side, side)), np.zeros((side, side), np.bool_)
    column = row = CLIMBS
    for _ in range(CLIMBS):
        for right, down in ((0, 0), (-1, 0), (1, 0), (0, -1), (0, 1)):
            c, r = column + right, row + down
            if not is_known[r, c]:
                at_x, at_y = x + right, y + down
                found = sums_at(points, count, maps, at_x, at_y, turn, velocity)
                scores[r, c] = _score(
                    found, norms, cos, sin, at_x - before[0], at_y - before[1], bias, ridge_weight, any_motion
                )
                is_known[r, c] = True
        beside, above = scores[row, column - 1 : column + 2], scores[row - 1 : row + 2, column]
        uphill_x, uphill_y = int(np.argmax(beside)) - 1, int(np.argmax(above)) - 1
        if uphill_x == 0 and uphill_y == 0:
            break
        x, y = x + uphill_x, y + uphill_y
        column, row = column + uphill_x, row + uphill_y
    x += parabola(beside[0], beside[1], beside[2])
    y += parabola(above[0], above[1], above[2])
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
