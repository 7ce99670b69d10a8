"""The demo's scene: three rimmed things before a textured wall, one of which passes behind a pillar."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from etd_ros.simulation.motion import Path, Waypoint
from etd_ros.simulation.scene import Scene, Sprite
from etd_ros.simulation.textures import BRIGHT, DARK, Texture, blobs, checks, smooth_noise, stripes

WIDTH, HEIGHT = 240, 180
DURATION_S = 5.0
PILLAR_SIZE = (84, 52)
RIM = 3.5
"""Width of the dark rim round each thing (pixels): contours that a proposal can close on."""


def demo_scene(seed: int) -> Scene:
    """Two things on circles in the upper corners, one that crosses below them behind the pillar."""
    rng = np.random.default_rng(seed)
    wall = 0.45 + 0.25 * smooth_noise(rng, HEIGHT, WIDTH, grain=2.5)
    ball = _thing("ball", blobs(rng, 40, 40), _circle(58, 48, 28, 24, period_s=2.2, phase=0.0))
    drum = _thing("drum", checks(rng, 36, 46, cell=11), _circle(180, 48, 28, 22, period_s=2.5, phase=2.0))
    tin = _thing("tin", stripes(rng, 38, 32, period=13.0), _crossing())
    pillar = Sprite(
        "pillar",
        0.5 * BRIGHT * (0.8 + 0.2 * smooth_noise(rng, *PILLAR_SIZE, grain=4.0)),
        np.ones(PILLAR_SIZE),
        Path([Waypoint(0, 116, 136)]),
        is_target=False,
    )
    return Scene(WIDTH, HEIGHT, DURATION_S, wall, (ball, drum, tin, pillar))


def _thing(name: str, texture: Texture, path: Path) -> Sprite:
    """An oval target with a dark rim."""
    height, width = texture.shape
    inside = _oval(height, width, RIM)
    return Sprite(name, np.asarray(inside * texture + (1 - inside) * DARK, np.float64), _oval(height, width, 0.0), path)


def _circle(x: float, y: float, radius_x: float, radius_y: float, *, period_s: float, phase: float) -> Path:
    def center(time_s: float) -> tuple[float, float]:
        angle = phase + 2 * np.pi * time_s / period_s
        return x + radius_x * float(np.cos(angle)), y + radius_y * float(np.sin(angle))

    return _sampled(center)


def _crossing() -> Path:
    return _sampled(lambda time_s: (24 + 40 * time_s, 136 + 6 * float(np.sin(2.4 * time_s))))


def _sampled(center: Callable[[float], tuple[float, float]]) -> Path:
    return Path([Waypoint(float(time_s), *center(float(time_s))) for time_s in np.arange(0, DURATION_S + 0.1, 0.1)])


def _oval(height: int, width: int, inset: float) -> Texture:
    """1 in the oval that a rectangle holds, less `inset` pixels, 0 outside, blended over one pixel."""
    y, x = np.mgrid[0:height, 0:width]
    radius_y, radius_x = height / 2 - inset, width / 2 - inset
    distance = np.hypot((y - (height - 1) / 2) / radius_y, (x - (width - 1) / 2) / radius_x)
    return np.asarray(np.clip((1 - distance) * min(radius_y, radius_x) + 0.5, 0, 1), np.float64)
