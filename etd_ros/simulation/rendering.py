"""Log intensity on the sensor, step after step: only the tiles in which something moved are painted again."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.simulation.motion import FloatArray
from etd_ros.simulation.scene import Scene

TILE = 16
"""Side of the squares that are painted again as a whole (pixels)."""
PLANES = 2
"""A sprite's texture pixel is its intensity times its opacity, and its opacity."""

_MANTISSA_LENGTH, _MANTISSA_BITS = 52, 0x000FFFFFFFFFFFFF
_ONE_BITS, _EXPONENT_OF_ONE = 0x3FF0000000000000, 0x3FF
_ROOT_HALF_BITS = 0x3FE6A09E667F3BCD
_LOG_2 = 0.6931471805599453
_R1, _R2, _R3, _R4 = 0.6666666666666735130, 0.3999999999940941908, 0.2857142874366239149, 0.2222219843214978396
_R5, _R6, _R7 = 0.1818357216161805012, 0.1531383769920937332, 0.1479819860511658591

Tiles = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]


class Layers:
    """A scene's textures in one array, as the kernels read them, each sprite's with a clear border of one pixel.

    Attributes:
        background: intensities, float64, shape (rows, columns).
        pixels: intensity times opacity, and opacity, of all sprites, one after the other; float64, shape (n, 2).
        table: first row in `pixels`, rows and columns (without the border) of each sprite, int64, shape (sprites, 3).
    """

    def __init__(self, scene: Scene) -> None:
        self.background = np.ascontiguousarray(scene.background, np.float64)
        blocks: list[FloatArray] = [np.zeros((0, PLANES))]
        table, first = [], 0
        for sprite in scene.sprites:
            height, width = sprite.texture.shape
            block = np.zeros((height + 2, width + 2, PLANES))
            block[1:-1, 1:-1, 0] = sprite.texture * sprite.opacity
            block[1:-1, 1:-1, 1] = sprite.opacity
            blocks.append(block.reshape(-1, PLANES))
            table.append((first, height, width))
            first += block.shape[0] * block.shape[1]
        self.pixels = np.concatenate(blocks)
        self.table = np.array(table, np.int64).reshape(-1, 3)


class Renderer:
    """Renders a scene at given times.

    Attributes:
        before, after: log intensity at the last two times rendered, float64, shape (height, width).
        changed: squares of TILE pixels in which they may differ, bool, shape (rows, columns).
    """

    def __init__(self, scene: Scene, times_s: FloatArray) -> None:
        height, width = scene.height, scene.width
        self._layers = Layers(scene)
        self._placements = scene.placements(times_s)
        ones = np.ones(len(times_s))
        self._light = ones if scene.flicker is None else scene.flicker.at(times_s)
        of_sprites = [ones if sprite.flicker is None else sprite.flicker.at(times_s) for sprite in scene.sprites]
        self._lights = np.stack([*of_sprites, ones], axis=1)
        self._shade = np.ones((height, width)) if scene.shade is None else np.ascontiguousarray(scene.shade, np.float64)
        self._dark = float(scene.dark)
        self._image = np.empty((height, width))
        self.before = np.empty((height, width))
        self.after = np.empty((height, width))
        self.changed = np.ones((-(-height // TILE), -(-width // TILE)), np.bool_)
        self._last = -1

    def advance(self, number: int) -> None:
        """Render the time of this number, which follows the one rendered last."""
        layers, placements, lights = self._layers, self._placements, self._lights
        if self._last >= 0:
            copy_tiles(self.after, self.before, self.changed)
            self._find_changes(self._last, number)
        if self.changed.any():
            _paint_background(self._image, layers.background, placements[number, 0], self.changed)
            for sprite in range(len(layers.table)):
                placement, light = placements[number, 1 + sprite], lights[number, sprite]
                _paint_sprite(self._image, layers.pixels, layers.table[sprite], placement, light, self.changed)
            _to_log(self._image, self._shade, self._light[number], self._dark, self.after, self.changed)
        if self._last < 0:
            self.before[:] = self.after
        self._last = number

    def _find_changes(self, last: int, number: int) -> None:
        placements, lights = self._placements, self._lights
        background_moved = not np.array_equal(placements[last, 0], placements[number, 0])
        if background_moved or self._light[last] != self._light[number]:
            self.changed[:] = True
            return
        self.changed[:] = False
        for sprite in range(len(self._layers.table)):
            old, new = placements[last, 1 + sprite], placements[number, 1 + sprite]
            if not np.array_equal(old, new) or lights[last, sprite] != lights[number, sprite]:
                for placement in (old, new):
                    _mark(self.changed, *self._image.shape, self._layers.table[sprite], placement)


def sprite_cover(layers: Layers, placements: FloatArray, index: int, height: int, width: int) -> tuple[float, float]:
    """How much of a sprite is on the sensor, and how much of that is not hidden by later sprites.

    Args:
        layers: the scene's textures.
        placements: of background and sprites at a time, shape (1 + sprites, 4).
        index: of the sprite.
        height: sensor height (pixels).
        width: sensor width (pixels).

    Returns:
        Sums of opacity over the sensor's pixels.
    """
    # Only later sprites that come near matter, and with many targets hardly any does.
    first_row, end_row, first_column, end_column = _bounds(height, width, layers.table[index], placements[1 + index])
    if first_row >= end_row or first_column >= end_column:
        return 0.0, 0.0
    shown = np.zeros((end_row - first_row, end_column - first_column))
    _add_opacity(shown, layers.pixels, layers.table[index], placements[1 + index], first_row, first_column)
    on_sensor = float(shown.sum())
    for later in range(index + 1, len(layers.table)):
        _hide(shown, layers.pixels, layers.table[later], placements[1 + later], first_row, first_column)
    return on_sensor, float(shown.sum())


@njit(cache=True, nogil=True)
def _bounds(height: int, width: int, entry: IntArray, placement: FloatArray) -> tuple[int, int, int, int]:
    """Rows and columns (first, end) of the sensor in which a sprite may be."""
    x, y, scale, angle = placement[0], placement[1], placement[2], placement[3]
    cos, sin = abs(np.cos(angle)), abs(np.sin(angle))
    # Bilinear interpolation reaches half a texture pixel beyond its edge.
    reach_x = (cos * (entry[2] + 1) + sin * (entry[1] + 1)) * scale / 2 + 1
    reach_y = (sin * (entry[2] + 1) + cos * (entry[1] + 1)) * scale / 2 + 1
    # Limited as floats: a sprite may be farther away than integers go.
    first_row = int(min(max(0.0, np.floor(y - reach_y)), float(height)))
    end_row = int(min(max(0.0, np.ceil(y + reach_y)), float(height)))
    first_column = int(min(max(0.0, np.floor(x - reach_x)), float(width)))
    end_column = int(min(max(0.0, np.ceil(x + reach_x)), float(width)))
    return first_row, end_row, first_column, end_column


@njit(cache=True, nogil=True)
def _mark(changed: Tiles, height: int, width: int, entry: IntArray, placement: FloatArray) -> None:
    first_row, end_row, first_column, end_column = _bounds(height, width, entry, placement)
    for tile_row in range(first_row // TILE, -(-end_row // TILE)):
        for tile_column in range(first_column // TILE, -(-end_column // TILE)):
            changed[tile_row, tile_column] = True


@njit(cache=True, nogil=True)
def copy_tiles(source: FloatArray, target: FloatArray, tiles: Tiles) -> None:
    """Copy the squares of `tiles` from one image of log intensity to another."""
    height, width = source.shape
    for row in range(height):
        for tile in range(tiles.shape[1]):
            if tiles[row // TILE, tile]:
                for column in range(tile * TILE, min(width, (tile + 1) * TILE)):
                    target[row, column] = source[row, column]


@njit(cache=True, nogil=True)
def _texture_point(
    dx: float, dy: float, cos: float, sin: float, shrink: float, columns: int, rows: int
) -> tuple[float, float]:
    """Column and row of a texture (whole at pixels' centres) at an offset from where its centre is on the sensor."""
    return (cos * dx + sin * dy) * shrink + columns / 2 - 0.5, (cos * dy - sin * dx) * shrink + rows / 2 - 0.5


@njit(cache=True, nogil=True)
def _mirrored(index: int, size: int) -> int:
    """The index of a pixel beyond the edges of a texture that continues mirrored."""
    if 0 <= index < size:
        return index
    index %= 2 * size
    return index if index < size else 2 * size - 1 - index


@njit(cache=True, nogil=True)
def _paint_background(image: FloatArray, texture: FloatArray, placement: FloatArray, tiles: Tiles) -> None:
    height, width = image.shape
    rows, columns = texture.shape
    x, y, scale, angle = placement[0], placement[1], placement[2], placement[3]
    cos, sin, shrink = np.cos(angle), np.sin(angle), 1 / scale
    for row in range(height):
        dy = row + 0.5 - y
        for tile in range(tiles.shape[1]):
            if not tiles[row // TILE, tile]:
                continue
            first, end = tile * TILE, min(width, (tile + 1) * TILE)
            is_inside = True
            for column in (first, end - 1):
                u, v = _texture_point(column + 0.5 - x, dy, cos, sin, shrink, columns, rows)
                is_inside = is_inside and 0 <= u < columns - 1 and 0 <= v < rows - 1
            if is_inside:
                for column in range(first, end):
                    u, v = _texture_point(column + 0.5 - x, dy, cos, sin, shrink, columns, rows)
                    i, j = int(u), int(v)
                    fu, fv = u - i, v - j
                    upper = (1 - fu) * texture[j, i] + fu * texture[j, i + 1]
                    lower = (1 - fu) * texture[j + 1, i] + fu * texture[j + 1, i + 1]
                    image[row, column] = (1 - fv) * upper + fv * lower
                continue
            for column in range(first, end):
                u, v = _texture_point(column + 0.5 - x, dy, cos, sin, shrink, columns, rows)
                u0, v0 = int(np.floor(u)), int(np.floor(v))
                fu, fv = u - u0, v - v0
                i, j = _mirrored(u0, columns), _mirrored(v0, rows)
                i1, j1 = _mirrored(u0 + 1, columns), _mirrored(v0 + 1, rows)
                upper = (1 - fu) * texture[j, i] + fu * texture[j, i1]
                lower = (1 - fu) * texture[j1, i] + fu * texture[j1, i1]
                image[row, column] = (1 - fv) * upper + fv * lower


@njit(cache=True, nogil=True)
def _paint_sprite(
    image: FloatArray, pixels: FloatArray, entry: IntArray, placement: FloatArray, light: float, tiles: Tiles
) -> None:
    """Blend a sprite over an image, bilinear between the texture's pixels."""
    height, width = image.shape
    first, rows, columns = entry[0], entry[1], entry[2]
    first_row, end_row, first_column, end_column = _bounds(height, width, entry, placement)
    x, y, scale, angle = placement[0], placement[1], placement[2], placement[3]
    cos, sin, shrink = np.cos(angle), np.sin(angle), 1 / scale
    stride = columns + 2
    for row in range(first_row, end_row):
        dy = row + 0.5 - y
        for tile in range(first_column // TILE, -(-end_column // TILE)):
            if not tiles[row // TILE, tile]:
                continue
            for column in range(max(first_column, tile * TILE), min(end_column, (tile + 1) * TILE)):
                u, v = _texture_point(column + 0.5 - x, dy, cos, sin, shrink, columns, rows)
                if not (-1 <= u < columns and -1 <= v < rows):
                    continue
                u0, v0 = int(np.floor(u)), int(np.floor(v))
                fu, fv = u - u0, v - v0
                at = first + (v0 + 1) * stride + u0 + 1
                a, b, c, d = (1 - fv) * (1 - fu), (1 - fv) * fu, fv * (1 - fu), fv * fu
                colour = (
                    a * pixels[at, 0]
                    + b * pixels[at + 1, 0]
                    + c * pixels[at + stride, 0]
                    + d * pixels[at + stride + 1, 0]
                )
                alpha = (
                    a * pixels[at, 1]
                    + b * pixels[at + 1, 1]
                    + c * pixels[at + stride, 1]
                    + d * pixels[at + stride + 1, 1]
                )
                image[row, column] = image[row, column] * (1 - alpha) + colour * light


@njit(cache=True, nogil=True)
def _to_log(
    image: FloatArray, shade: FloatArray, light: float, dark: float, log_intensity: FloatArray, tiles: Tiles
) -> None:
    """Natural logarithm to its last digit or two, without branches, so that the compiler makes vectors of it.

    As in Sun's fdlibm: x = 2^k (1 + f) with 1 + f in [sqrt(1/2), sqrt(2)), and log(1 + f) = 2 s + s R(s^2) for
    s = f / (2 + f).
    """
    height, width = image.shape
    values, exponents = np.empty(TILE), np.empty(TILE)
    bits = values.view(np.int64)
    for row in range(height):
        for tile in range(tiles.shape[1]):
            if not tiles[row // TILE, tile]:
                continue
            first = tile * TILE
            count = min(width, first + TILE) - first
            for i in range(count):
                values[i] = image[row, first + i] * shade[row, first + i] * light + dark
            for i in range(count):
                shifted = bits[i] + (_ONE_BITS - _ROOT_HALF_BITS)
                exponents[i] = (shifted >> _MANTISSA_LENGTH) - _EXPONENT_OF_ONE
                bits[i] = (shifted & _MANTISSA_BITS) + _ROOT_HALF_BITS
            for i in range(count):
                f = values[i] - 1.0
                s = f / (2.0 + f)
                z = s * s
                r = _R7
                for coefficient in (_R6, _R5, _R4, _R3, _R2, _R1):
                    r = r * z + coefficient
                log_intensity[row, first + i] = exponents[i] * _LOG_2 + (2.0 * s + s * (z * r))


@njit(cache=True, nogil=True)
def _opacity_at(
    pixels: FloatArray, entry: IntArray, placement: FloatArray, cos: float, sin: float, row: int, column: int
) -> float:
    first, rows, columns = entry[0], entry[1], entry[2]
    dx, dy = column + 0.5 - placement[0], row + 0.5 - placement[1]
    u, v = _texture_point(dx, dy, cos, sin, 1 / placement[2], columns, rows)
    if not (-1 <= u < columns and -1 <= v < rows):
        return 0.0
    u0, v0 = int(np.floor(u)), int(np.floor(v))
    fu, fv = u - u0, v - v0
    at = first + (v0 + 1) * (columns + 2) + u0 + 1
    upper = (1 - fu) * pixels[at, 1] + fu * pixels[at + 1, 1]
    lower = (1 - fu) * pixels[at + columns + 2, 1] + fu * pixels[at + columns + 3, 1]
    return float((1 - fv) * upper + fv * lower)


@njit(cache=True, nogil=True)
def _add_opacity(
    shown: FloatArray, pixels: FloatArray, entry: IntArray, placement: FloatArray, first_row: int, first_column: int
) -> None:
    cos, sin = np.cos(placement[3]), np.sin(placement[3])
    for row in range(shown.shape[0]):
        for column in range(shown.shape[1]):
            shown[row, column] += _opacity_at(
                pixels, entry, placement, cos, sin, first_row + row, first_column + column
            )


@njit(cache=True, nogil=True)
def _hide(
    shown: FloatArray, pixels: FloatArray, entry: IntArray, placement: FloatArray, first_row: int, first_column: int
) -> None:
    """Take from what is shown what a sprite in front of it covers."""
    rows, columns = shown.shape
    top, bottom, left, right = _bounds(first_row + rows, first_column + columns, entry, placement)
    cos, sin = np.cos(placement[3]), np.sin(placement[3])
    for row in range(max(top, first_row), bottom):
        for column in range(max(left, first_column), right):
            cover = _opacity_at(pixels, entry, placement, cos, sin, row, column)
            shown[row - first_row, column - first_column] *= 1 - cover
