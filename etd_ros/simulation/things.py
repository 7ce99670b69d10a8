"""Things that scenes are made of: balls, dartboards, cars, irregular shapes, plain and textured ones, lamps."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import cv2
import numpy as np

from etd_ros.simulation.motion import FloatArray
from etd_ros.simulation.photographs import photograph
from etd_ros.simulation.textures import BRIGHT, DARK, Texture, blobs, checks, smooth_noise, stripes

Thing: TypeAlias = tuple[Texture, FloatArray]
"""Texture and opacity, float64, shape (h, w) each; its opaque pixels reach all four edges, or nearly."""

OVERSAMPLING = 4
"""Shapes are drawn so much larger and averaged: edges are smooth."""
OUTLINE_POINTS = 180


def ball(rng: np.random.Generator, size: int) -> Thing:
    """A disc shaded from one side, with a faint mark or two, as a tennis ball or an old leather one."""
    x, y, radius = _disc_grid(size)
    angle = rng.uniform(0, 2 * np.pi)
    shine = np.sqrt(np.clip(1 - radius**2, 0, 1)) + 0.5 * (x * np.cos(angle) + y * np.sin(angle))
    tone, contrast = rng.uniform(0.25, 0.7), rng.uniform(0.15, 0.45)
    surface = tone * (1 + contrast * (shine - 0.6))
    for _ in range(rng.integers(1, 4)):
        offset, turn = rng.uniform(-0.5, 0.5), rng.uniform(0, np.pi)
        seam = np.abs(x * np.cos(turn) + y * np.sin(turn) + offset * (1 - radius**2)) < 1.5 / size
        surface = np.where(seam, surface * rng.uniform(0.55, 1.5), surface)
    return _bounded(cv2.GaussianBlur(surface, (0, 0), 0.6)), _smooth_disc(size)


def dartboard(rng: np.random.Generator, size: int) -> Thing:
    """Rings and sectors, dark and bright."""
    x, y, radius = _disc_grid(size * OVERSAMPLING)
    sectors, rings = int(rng.integers(6, 13)), rng.integers(2, 5)
    turn = np.floor((np.arctan2(y, x) / (2 * np.pi) + 0.5) * 2 * sectors + rng.uniform())
    ring = np.floor(radius * rings)
    bright = (turn + ring) % 2
    surface = np.where(radius < 0.12, 0.9, np.where(radius > 0.88, 0.2, 0.25 + 0.55 * bright))
    return _bounded(shrunk(surface)), _smooth_disc(size)


def car(rng: np.random.Generator, size: int) -> Thing:
    """A body with a cabin, windows and wheels, seen from the side or from behind."""
    width, height = size * OVERSAMPLING, round(size * rng.uniform(0.4, 0.9)) * OVERSAMPLING
    paint, glass = rng.uniform(0.3, 0.9), rng.uniform(0.15, 0.3)
    surface, opacity = np.full((height, width), paint), np.zeros((height, width))

    def fill(image: FloatArray, corners: list[tuple[float, float]], value: float) -> None:
        points = np.array([(x * (width - 1), y * (height - 1)) for x, y in corners])
        cv2.fillPoly(image, [np.rint(points).astype(np.int32)], value)

    shoulder, slope = rng.uniform(0.35, 0.5), rng.uniform(0.08, 0.22)
    fill(opacity, [(0, shoulder), (1, shoulder), (1, 0.88), (0, 0.88)], 1.0)
    fill(opacity, [(slope, 0), (1 - slope, 0), (1 - slope / 3, shoulder), (slope / 3, shoulder)], 1.0)
    fill(surface, [(0, 0.75), (1, 0.75), (1, 0.88), (0, 0.88)], paint * 0.7)
    for left, right in ((slope + 0.04, 0.48), (0.53, 0.96 - slope)):
        fill(surface, [(left, 0.08), (right, 0.08), (right, shoulder), (left, shoulder)], glass)
    for x in (0.22, 0.78):
        centre, radius = (round(x * width), round(0.84 * height)), round(0.16 * height)
        cv2.circle(opacity, centre, radius, 1.0, cv2.FILLED)
        cv2.circle(surface, centre, radius, 0.18, cv2.FILLED)
        cv2.circle(surface, centre, radius // 2, 0.5, cv2.FILLED)
    return _bounded(shrunk(surface)), shrunk(opacity)


def irregular(rng: np.random.Generator, size: int) -> Thing:
    """A surface within a random smooth closed outline."""
    opacity = _outline(rng, size)
    return surface_of(rng, *opacity.shape), opacity


def plain(rng: np.random.Generator, size: int) -> Thing:
    """An outline with hardly any texture inside."""
    opacity = _outline(rng, size)
    height, width = opacity.shape
    y, x = np.mgrid[-0.5 : 0.5 : height * 1j, -0.5 : 0.5 : width * 1j]
    angle = rng.uniform(0, 2 * np.pi)
    slope = rng.uniform(0.0, 0.2) * (x * np.cos(angle) + y * np.sin(angle))
    return _bounded(rng.choice([0.2, 0.35, 0.65, 0.9]) * (1 + slope)), opacity


def panel(rng: np.random.Generator, size: int) -> Thing:
    """A textured rectangle."""
    height, width = size, round(size * rng.uniform(0.55, 1.0))
    if rng.uniform() < 0.5:
        height, width = width, height
    return surface_of(rng, height, width), np.ones((height, width))


def picture(rng: np.random.Generator, size: int) -> Thing:
    """Part of a photograph within an irregular outline or a rectangle.

    Raises:
        SimulationError: scikit-image is missing.
    """
    _, opacity = panel(rng, size) if rng.uniform() < 0.4 else plain(rng, size)
    return photograph(rng, *opacity.shape), opacity


def lamp(rng: np.random.Generator, size: int) -> Thing:
    """A bright disc in a dark mounting."""
    _, _, radius = _disc_grid(size)
    glow = np.clip((rng.uniform(0.6, 0.75) - radius) * size / 4 + 0.5, 0, 1)
    return _bounded(0.2 + 0.8 * glow), _smooth_disc(size)


KINDS: dict[str, Callable[[np.random.Generator, int], Thing]] = {
    kind.__name__: kind for kind in (ball, dartboard, car, irregular, plain, panel, picture, lamp)
}
"""Makes a thing whose larger side is `size` pixels, by name."""


def surface_of(rng: np.random.Generator, height: int, width: int) -> Texture:
    """One of the procedural textures, of a size (pixels) and a random contrast."""
    short = min(height, width)
    number = rng.integers(4)
    if number == 0:
        surface = smooth_noise(rng, height, width, grain=max(1.0, short / 16))
    elif number == 1:
        surface = stripes(rng, height, width, period=short * rng.uniform(0.2, 0.5))
    elif number == 2:
        surface = blobs(rng, height, width)
    else:
        surface = checks(rng, height, width, cell=max(3, short // int(rng.integers(3, 6))))
    contrast = rng.uniform(0.4, 1.0)
    return _bounded(rng.uniform(0.3, 0.6) * (1 - contrast) + contrast * surface)


def _outline(rng: np.random.Generator, size: int) -> FloatArray:
    """The inside of a smooth closed curve that is `size` pixels wide or high, anti-aliased, cut to its bounds."""
    angles = np.linspace(0, 2 * np.pi, OUTLINE_POINTS, endpoint=False)
    radius = 1 + sum(
        rng.normal(0, 0.28 / order) * np.cos(order * angles + rng.uniform(0, 2 * np.pi)) for order in (2, 3, 4, 5)
    )
    points = (
        np.stack([np.cos(angles), rng.uniform(0.6, 1.0) * np.sin(angles)], axis=1) * np.maximum(radius, 0.35)[:, None]
    )
    points -= points.min(axis=0)
    points *= (size * OVERSAMPLING - 1) / points.max()
    width, height = (-(-int(extent + 1) // OVERSAMPLING) for extent in points.max(axis=0))
    inside = np.zeros((height * OVERSAMPLING, width * OVERSAMPLING))
    cv2.fillPoly(inside, [np.rint(points).astype(np.int32)], 1.0)
    return shrunk(inside)


def _disc_grid(size: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """x, y and the distance from the middle, in radii."""
    y, x = (np.mgrid[0:size, 0:size] - (size - 1) / 2) / (size / 2)
    return x, y, np.hypot(x, y)


def _smooth_disc(size: int) -> FloatArray:
    _, _, radius = _disc_grid(size * OVERSAMPLING)
    return shrunk((radius <= 1).astype(np.float64))


def rim_seen(thing: Thing, ground: float, contrast: float) -> float:
    """The share of a thing's rim whose log intensity is farther from that of the ground behind it than `contrast`."""
    texture, opacity = thing
    inner = cv2.erode(opacity, np.ones((5, 5)), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    is_rim = (opacity > 0.5) & (inner < 0.5)
    return float((np.abs(np.log(texture[is_rim]) - ground) > contrast).mean())


def shrunk(image: FloatArray) -> FloatArray:
    """A picture drawn OVERSAMPLING times as large, as it is to be: the mean of each square of so many pixels."""
    height, width = (extent // OVERSAMPLING for extent in image.shape)
    squares = image[: height * OVERSAMPLING, : width * OVERSAMPLING].reshape(height, OVERSAMPLING, width, OVERSAMPLING)
    return np.asarray(squares.mean(axis=(1, 3)), np.float64)


def _bounded(surface: FloatArray) -> Texture:
    return np.asarray(np.clip(surface, DARK, BRIGHT), np.float64)
