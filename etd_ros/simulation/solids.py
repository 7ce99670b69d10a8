"""Things with faces and few edges, many of them slanted: what stands on a shelf."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import cv2
import numpy as np

from etd_ros.simulation.motion import FloatArray
from etd_ros.simulation.textures import BRIGHT, DARK, smooth_noise
from etd_ros.simulation.things import OVERSAMPLING, Thing, shrunk, surface_of

Face = tuple[Sequence[tuple[float, float]], float]
"""Corners (parts of the width and height) and tone."""


def pyramid(rng: np.random.Generator, size: int) -> Thing:
    """Two faces."""
    apex, edge, tone = rng.uniform(0.3, 0.8), rng.uniform(0.55, 0.95), rng.uniform(0.3, 0.8)
    shaded: Face = [(edge, 1), (apex, 0), (1, rng.uniform(0.8, 1))], tone * rng.uniform(0.4, 0.8)
    height = round(size * rng.uniform(0.5, 1))
    return _solid(rng, height, size, [([(0, 1), (apex, 0), (edge, 1)], tone), shaded], rng.uniform(0, 0.5))


def books(rng: np.random.Generator, size: int) -> Thing:
    """Some that lean to one side."""
    count, lean = int(rng.integers(3, 7)), rng.uniform(-0.35, 0.35)
    room = abs(lean)
    edges = np.concatenate([[0], (np.sort(rng.uniform(0, 1, count - 1)) + np.arange(1, count) / count) / 2, [1]])
    edges = room / 2 + edges * (1 - room)
    faces: list[Face] = []
    for left, right in itertools.pairwise(edges):
        top, own = rng.uniform(0, 0.3), lean if rng.uniform() < 0.8 else -lean / 2
        over = own / 2 * (1 - top)
        corners = [(left - own / 2, 1), (left + over, top), (right + over, top), (right - own / 2, 1)]
        faces.append((corners, rng.uniform(0.16, 0.7)))
    return _solid(rng, round(size * rng.uniform(0.5, 1.1)), size, faces, rng.uniform(0, 0.3))


def box(rng: np.random.Generator, size: int) -> Thing:
    """A face seen from one side, textured or not."""
    inset = rng.uniform(0, 0.3, 5)
    corners = [(inset[0], 0), (1 - inset[1], inset[2] / 2), (1 - inset[3] / 2, 1), (inset[4], 1)]
    texture, opacity = _solid(rng, round(size * rng.uniform(0.5, 1.1)), size, [(corners, rng.uniform(0.2, 0.9))], 0.3)
    return (surface_of(rng, *opacity.shape) if rng.uniform() < 0.6 else texture), opacity


def mug(rng: np.random.Generator, size: int) -> Thing:
    """Plain, round, with a handle."""
    width, body, tone = round(size * rng.uniform(0.95, 1.2)), rng.uniform(0.2, 0.35), rng.uniform(0.5, 0.95)
    opacity = np.zeros((size * OVERSAMPLING, width * OVERSAMPLING))
    start, middle = int(body * width * OVERSAMPLING), size * OVERSAMPLING // 2
    thick = max(2, int(0.09 * width * OVERSAMPLING))
    cv2.ellipse(opacity, (start, middle), (int(0.95 * start), int(0.28 * size * OVERSAMPLING)), 0, 0, 360, 1.0, thick)
    cv2.rectangle(
        opacity, (start, int(0.04 * size * OVERSAMPLING)), (width * OVERSAMPLING, size * OVERSAMPLING), 1.0, cv2.FILLED
    )
    shine = 1 - rng.uniform(0.1, 0.6) * np.abs(np.linspace(0, 1, width) - rng.uniform(0.3, 0.7))
    texture = np.repeat(tone * shine[None], size, axis=0)
    way = 1 if rng.uniform() < 0.5 else -1
    return _cut(texture[:, ::way], shrunk(opacity)[:, ::way])


def tower(rng: np.random.Generator, size: int) -> Thing:
    """A roof, a row of windows, and a plain wall."""
    width, tone, inset = max(9, round(size * rng.uniform(0.3, 0.55))), rng.uniform(0.3, 0.8), rng.uniform(0, 0.12)
    faces: list[Face] = [
        ([(inset, 0.3), (1 - inset, 0.3), (1 - inset, 1), (inset, 1)], tone),
        ([(inset, 0.3), (0.5, 0), (1 - inset, 0.3)], 0.7 * tone),
        ([(0, 0.5), (1, 0.5), (1, 0.55), (0, 0.55)], 0.6 * tone),
    ]
    for left in np.linspace(inset + 0.1, 0.9 - inset, int(rng.integers(3, 6)), endpoint=False):
        faces.append(([(left, 0.38), (left + 0.09, 0.38), (left + 0.09, 0.48), (left, 0.48)], 0.4 * tone))
    return _solid(rng, size, width, faces, rng.uniform(0, 0.3))


def chess(rng: np.random.Generator, size: int) -> Thing:
    """A board seen from one side."""
    count, slant = int(rng.integers(3, 6)), rng.uniform(-0.4, 0.4)

    def at(column: int, row: int) -> tuple[float, float]:
        return abs(slant) / 2 + column / count * (1 - abs(slant)) + slant * (0.5 - row / count), row / count

    faces: list[Face] = [
        ([at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)], 0.9 if (i + j) % 2 else 0.18)
        for i in range(count)
        for j in range(count)
    ]
    return _solid(rng, round(size * rng.uniform(0.6, 1.1)), size, faces, 0.0)


SOLIDS: tuple[Callable[[np.random.Generator, int], Thing], ...] = (pyramid, books, box, mug, tower, chess)
"""Makes a thing whose larger side is about `size` pixels."""


def _solid(rng: np.random.Generator, height: int, width: int, faces: Sequence[Face], rough: float) -> Thing:
    """Faces, later ones over earlier ones, of a size (pixels)."""
    height = max(height, 8)
    opacity = np.zeros((height * OVERSAMPLING, width * OVERSAMPLING))
    texture = np.full_like(opacity, 0.5)
    for corners, tone in faces:
        points = np.array([(x * (width * OVERSAMPLING - 1), y * (height * OVERSAMPLING - 1)) for x, y in corners])
        for picture, value in (texture, float(tone)), (opacity, 1.0):
            cv2.fillPoly(picture, [np.rint(points).astype(np.int32)], value)
    grain = 1 + rough * (smooth_noise(rng, height, width, grain=2.0) - 0.5)
    return _cut(shrunk(texture) * grain, shrunk(opacity))


def _cut(texture: FloatArray, opacity: FloatArray) -> Thing:
    """To where it is opaque."""
    rows, columns = np.nonzero(opacity > 0.5)
    inside = slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)
    return np.clip(texture[inside], DARK, BRIGHT), np.ascontiguousarray(opacity[inside])
