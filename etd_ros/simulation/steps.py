"""The times at which a scene is rendered: often where things move fast, seldom where they do not."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from etd_ros.simulation.motion import FloatArray
from etd_ros.simulation.scene import Scene

SAMPLE_S = 0.001
"""Distance of the times at which speeds are looked at."""
STEPS_PER_FLICKER = 12
STEPS_TOLERANCE = 1e-6
"""What is a whole number of steps but for so little of one is that."""


def step_times_us(scene: Scene, *, step_s: float, step_px: float) -> npt.NDArray[np.int64]:
    """Times of the renderings (us), increasing from 0, int64, shape (n,).

    Args:
        scene: what is rendered.
        step_s: the longest time between two of them (s).
        step_px: the farthest that anything on the sensor may move meanwhile (pixels); 0: all times between them are
            equally long.
    """
    if step_px == 0:
        steps = max(1, math.ceil(scene.duration_s / step_s - STEPS_TOLERANCE))
        return np.unique(np.rint(np.arange(steps + 1) * (scene.duration_s / steps) * 1e6).astype(np.int64))
    times = np.arange(0, scene.duration_s + 2 * SAMPLE_S, SAMPLE_S)
    rate_hz = np.maximum(1 / step_s, fastest_px_s(scene, times) / step_px)
    flickers = [scene.flicker, *(sprite.flicker for sprite in scene.sprites)]
    flicker_hz = max((flicker.rate_hz for flicker in flickers if flicker is not None), default=0.0)
    rate_hz = np.maximum(rate_hz, STEPS_PER_FLICKER * flicker_hz)
    # The number of steps done by a time is the integral of their rate.
    done = np.concatenate([[0.0], np.cumsum((rate_hz[1:] + rate_hz[:-1]) / 2 * SAMPLE_S)])
    total = float(np.interp(scene.duration_s, times, done))
    count = max(1, int(np.ceil(total)))
    edges_us = np.rint(np.interp(np.arange(count + 1) * (total / count), done, times) * 1e6).astype(np.int64)
    return np.unique(edges_us)


def fastest_px_s(scene: Scene, times_s: FloatArray) -> FloatArray:
    """Speed of the fastest point on the sensor (pixels/s) at increasing times (s, shape (n,)), shape (n,)."""
    placements = scene.placements(times_s)
    sizes = np.array([(scene.width, scene.height), *(sprite.texture.shape[::-1] for sprite in scene.sprites)])
    reach = np.hypot(sizes[:, 0], sizes[:, 1]) / 2 * placements[..., 2]
    seconds = np.diff(times_s)[:, None]
    steps = np.diff(placements, axis=0)
    corner_speeds = (
        np.hypot(steps[..., 0], steps[..., 1])
        + reach[1:] * np.abs(steps[..., 3])
        + reach[1:] * np.abs(steps[..., 2]) / placements[1:, :, 2]
    ) / seconds
    x, y = placements[1:, :, 0], placements[1:, :, 1]
    on_sensor = (x > -reach[1:]) & (x < scene.width + reach[1:]) & (y > -reach[1:]) & (y < scene.height + reach[1:])
    on_sensor[:, 0] = True
    fastest = np.where(on_sensor, corner_speeds, 0.0).max(axis=1)
    return np.asarray(np.concatenate([fastest[:1], np.maximum(fastest, np.roll(fastest, -1))[:-1], fastest[-1:]]))
