"""Compiled parts of what the box network sees: events, moved on with the target, and what is known of it, drawn on a
grid round a box. Points and poses are those of `contour_kernels`."""

from __future__ import annotations

import math

from numba import njit

from etd_ros.tracking.contour_kernels import (
    AGE,
    ALONG_X,
    ALONG_Y,
    ANGLE,
    DENSITY,
    GRADIENT_X,
    GRADIENT_Y,
    POLARITY,
    SCALE,
    Float32Array,
    Float64Array,
    X,
    Y,
)

SLICES_END = (0.25, 0.5, 1.0)
"""Parts of the time in which events are drawn apart, the newest first: what moves otherwise lies elsewhere in each."""
CONTRAST_FLOOR, CONTRAST_MAX = 0.05, 6.0
MIDDLE_X, MIDDLE_Y, WIDTH, HEIGHT = range(4)
"""Parts of a box that is handed to a kernel."""


@njit(cache=True, nogil=True, fastmath=True)
def draw_events(points: Float32Array, count: int, box: Float64Array, velocity: Float64Array, span_s: float,
                drawn: Float32Array) -> float:  # fmt: skip
    """Draw points, moved on by their age, on a grid twice as wide and high as a box, to one contrast.

    Args:
        points: shape (capacity, 4).
        count: of them.
        box: x, y of its middle, width and height (pixels).
        velocity: x, y (pixels/s).
        span_s: the age of the oldest points (s).
        drawn: On and Off of each part of that time, the newest first, shape (6, cells, cells).

    Returns:
        The number of points in the box.
    """
    _, rows, columns = drawn.shape
    drawn[:] = 0
    inside = 0.0
    for index in range(count):
        age = points[index, AGE]
        across = (points[index, X] + velocity[ALONG_X] * age - box[MIDDLE_X]) / box[WIDTH]
        down = (points[index, Y] + velocity[ALONG_Y] * age - box[MIDDLE_Y]) / box[HEIGHT]
        column, row = (across + 1) * columns / 2 - 0.5, (down + 1) * rows / 2 - 0.5
        if column < 0 or row < 0 or column >= columns - 1 or row >= rows - 1:
            continue
        part = age / span_s
        channel = 0 if part < SLICES_END[0] else (2 if part < SLICES_END[1] else 4)
        layer = drawn[channel if points[index, POLARITY] > 0 else channel + 1]
        c, r = int(column), int(row)
        right, below = column - c, row - r
        layer[r, c] += (1 - right) * (1 - below)
        layer[r, c + 1] += right * (1 - below)
        layer[r + 1, c] += (1 - right) * below
        layer[r + 1, c + 1] += right * below
        if abs(across) <= 0.5 and abs(down) <= 0.5:
            inside += 1
    norm = 1 / (math.sqrt(inside / (len(drawn) * rows * columns / 4)) + CONTRAST_FLOOR)
    for layer in drawn:
        for row in range(rows):
            for column in range(columns):
                layer[row, column] = min(layer[row, column] * norm, CONTRAST_MAX)
    return inside


@njit(cache=True, nogil=True, fastmath=True)
def draw_model(maps: Float32Array, pose: Float64Array, cell_px: float, middle_x: float, middle_y: float,
               width_px: float, height_px: float, drawn: Float32Array) -> None:  # fmt: skip
    """Draw a model as it lies on the sensor on a grid of so many pixels round a place.

    Args:
        maps: the model's, shape (maps, rows, columns).
        pose: where it lies.
        cell_px: pixels of a cell at scale 1.
        middle_x: of the grid, from the pose's place (pixels).
        middle_y: the same.
        width_px: of the grid.
        height_px: of the grid.
        drawn: gradient along the sensor's x and y, and density, shape (3, cells, cells).
    """
    _, rows, columns = maps.shape
    gx, gy, density = maps[GRADIENT_X], maps[GRADIENT_Y], maps[DENSITY]
    size_px = cell_px * pose[SCALE]
    cos, sin = math.cos(pose[ANGLE]), math.sin(pose[ANGLE])
    cells = drawn.shape[1]
    # A cell of the grid that is larger than the model's is the mean of some places.
    places = max(1, math.ceil(max(width_px, height_px) / cells / size_px))
    share = 1 / (places * places)
    drawn[:] = 0
    for row in range(cells * places):
        down_px = middle_y + ((row + 0.5) / (cells * places) - 0.5) * height_px
        for column in range(cells * places):
            across_px = middle_x + ((column + 0.5) / (cells * places) - 0.5) * width_px
            x = (cos * across_px + sin * down_px) / size_px + (columns - 1) / 2
            y = (cos * down_px - sin * across_px) / size_px + (rows - 1) / 2
            if x < 0 or y < 0 or x >= columns - 1 or y >= rows - 1:
                continue
            c, r = int(x), int(y)
            right, below = x - c, y - r
            a, b = (1 - right) * (1 - below) * share, right * (1 - below) * share
            d, e = (1 - right) * below * share, right * below * share
            along_x = a * gx[r, c] + b * gx[r, c + 1] + d * gx[r + 1, c] + e * gx[r + 1, c + 1]
            along_y = a * gy[r, c] + b * gy[r, c + 1] + d * gy[r + 1, c] + e * gy[r + 1, c + 1]
            drawn[0, row // places, column // places] += cos * along_x - sin * along_y
            drawn[1, row // places, column // places] += sin * along_x + cos * along_y
            drawn[2, row // places, column // places] += (
                a * density[r, c] + b * density[r, c + 1] + d * density[r + 1, c] + e * density[r + 1, c + 1]
            )


@njit(cache=True, nogil=True, fastmath=True)
def move_picture(picture: Float32Array, right: float, below: float, wider: float, higher: float,
                 moved: Float32Array) -> None:  # fmt: skip
    """What a picture is on a grid whose middle lies so many cells to the right and below, and that is so many times as
    wide and high; 0 beyond it.

    Args:
        picture: shape (layers, cells, cells).
        right: of the new middle (cells).
        below: of the new middle (cells).
        wider: than the old grid.
        higher: than the old grid.
        moved: of the same shape.
    """
    layers, rows, columns = picture.shape
    moved[:] = 0
    for row in range(rows):
        y = (row - (rows - 1) / 2) * higher + below + (rows - 1) / 2
        for column in range(columns):
            x = (column - (columns - 1) / 2) * wider + right + (columns - 1) / 2
            if x < 0 or y < 0 or x > columns - 1 or y > rows - 1:
                continue
            c, r = int(x), int(y)
            part_x, part_y = x - c, y - r
            next_c, next_r = min(c + 1, columns - 1), min(r + 1, rows - 1)
            for layer in range(layers):
                above = (1 - part_x) * picture[layer, r, c] + part_x * picture[layer, r, next_c]
                under = (1 - part_x) * picture[layer, next_r, c] + part_x * picture[layer, next_r, next_c]
                moved[layer, row, column] = (1 - part_y) * above + part_y * under
