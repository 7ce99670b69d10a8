"""A camera slides past things at different depths, none of which changes its size: what `etd-plus` makes of them.

    python docs/shelf_measures.py [FIRST LAST]     # seeds, 0 and 120 if none are given; a minute for 60 on two cores

Pyramids, leaning books, mugs, towers, boxes and chess boards have few edges, many of them slanted, so that a look can
hardly tell moving along them from growing. Labels are those of `evaluate --suite`; some backgrounds are photographs
(extra `simulate`).
"""

from __future__ import annotations

import itertools
import math
import sys
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from seeded_scenes import SeededScene, seeds_asked_for

from etd_ros.evaluation.suite import evaluate
from etd_ros.simulation import Scene, things
from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.motion import FloatArray, Path
from etd_ros.simulation.motions import Track
from etd_ros.simulation.scene import Sprite
from etd_ros.simulation.sensor import SensorConfig
from etd_ros.simulation.textures import BRIGHT, DARK, smooth_noise
from etd_ros.simulation.things import OVERSAMPLING, Thing, shrunk

Face = tuple[Sequence[tuple[float, float]], float]
"""Corners (parts of the width and height) and tone."""

STREAM = 77
WIDTH, HEIGHT, DURATION_S = 240, 180, 2.0


def main() -> None:
    """Print the mean AP and AR of each kind of thing and of all."""
    shelves: Any = [Shelf(seed) for seed in seeds_asked_for(0, 120)]  # as far as `evaluate` asks, they are sequences
    results = [result for found in evaluate(shelves, jobs=2) for result in found]
    kinds = defaultdict(list)
    for result in results:
        kinds[result.target.rsplit("_", 1)[0]].append(result)
    for kind, of_kind in [*sorted(kinds.items()), ("all", results)]:
        ap, ar = (np.mean([getattr(result, figure) for result in of_kind]) for figure in ("ap", "ar"))
        sys.stdout.write(f"{kind:<12}{len(of_kind):>5}{ap:>8.3f}{ar:>8.3f}\n")
    ap = np.array([result.ap for result in results])
    sys.stdout.write(f"median AP {np.median(ap):.3f}; {np.count_nonzero(ap < 0.5)} below 0.5\n")


class Shelf(SeededScene):
    """Things that a camera slides past."""

    def make(self) -> tuple[Scene, SensorConfig]:
        rng = np.random.default_rng([STREAM, self.seed])
        shift = _camera(rng)
        nearness = np.sort(np.exp(rng.uniform(np.log(1.1), np.log(4.5), int(rng.integers(3, 7)))))
        background = _background(rng, *(float(np.abs(way[-1])) for way in shift(np.array([DURATION_S]))))
        sprites = tuple(_sprite(rng, number, float(near), shift) for number, near in enumerate(nearness))
        sensor = SensorConfig(
            contrast_threshold=float(rng.uniform(0.15, 0.3)),
            threshold_spread=0.03,
            noise_rate_hz=float(rng.uniform(0, 8000)),
            step_s=0.005,
            step_px=0.6,
        )
        view = Path.of(shift, DURATION_S)
        return Scene(WIDTH, HEIGHT, DURATION_S, background, sprites, view=view), sensor


def _camera(rng: np.random.Generator) -> Track:
    """How far the background has moved at times (s): to the side in most scenes, at a speed that hardly changes."""
    speed_px_s = rng.uniform(20, 70) * rng.choice([-1, 1])
    angle = 0.0 if rng.uniform() < 0.6 else rng.uniform(0, 2 * np.pi)
    swing, rate = rng.uniform(-0.3, 0.3), 2 * np.pi * rng.uniform(0.2, 0.7)

    def shift(times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        way = speed_px_s * (times_s + swing / rate * (1 - np.cos(rate * times_s)))
        return way * np.cos(angle), way * np.sin(angle)

    return shift


def _background(rng: np.random.Generator, way_x: float, way_y: float) -> FloatArray:
    kind = str(rng.choice(["shelf", "shelf", "photo", "clutter", "wall"]))
    height, width = HEIGHT + 2 * math.ceil(way_y + 4), WIDTH + 2 * math.ceil(way_x + 4)
    if kind != "shelf":
        return BACKGROUNDS[kind](rng, height, width)
    picture = rng.uniform(0.3, 0.8) * (1 + 0.1 * (smooth_noise(rng, height, width) - 0.5))
    for _ in range(int(rng.integers(3, 8))):
        x, y, tone = rng.uniform(0, width), rng.uniform(0, height), float(rng.uniform(DARK, 0.9))
        if rng.uniform() < 0.5:
            corner = int(x + rng.uniform(20, 200)), int(y + rng.uniform(3, 80))
            cv2.rectangle(picture, (int(x), int(y)), corner, tone, cv2.FILLED)
        else:
            cv2.rectangle(picture, (int(x), 0), (int(x + rng.uniform(2, 12)), height), tone, cv2.FILLED)
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.7), DARK, BRIGHT)


def _sprite(rng: np.random.Generator, number: int, nearness: float, shift: Track) -> Sprite:
    kind = KINDS[int(rng.integers(len(KINDS)))]
    texture, opacity = kind(rng, round(float(np.exp(rng.uniform(np.log(22), np.log(95))))))
    seen_x, seen_y = (float(way[0]) for way in shift(np.array([rng.uniform(0, 0.8 * DURATION_S)])))
    x = rng.uniform(0.2, 0.8) * WIDTH + nearness * seen_x
    y = rng.uniform(0.25, 0.8) * HEIGHT + nearness * seen_y
    path = Path.of(lambda times: (np.full_like(times, x), np.full_like(times, y)), DURATION_S)
    return Sprite(f"{kind.__name__}_{number}", texture, opacity, path, nearness=nearness)


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
    return (things.surface_of(rng, *opacity.shape) if rng.uniform() < 0.6 else texture), opacity


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


KINDS = (
    pyramid, books, box, mug, tower, chess, things.ball, things.plain, things.panel, things.dartboard, things.irregular,
)  # fmt: skip


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


if __name__ == "__main__":
    main()
