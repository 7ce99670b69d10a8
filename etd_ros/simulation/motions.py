"""How things and cameras move: wandering, crossing, leaving, hand shake. Functions of times for `Path.of`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from etd_ros.simulation.motion import FloatArray

Track: TypeAlias = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""x and y (pixels), shape (n,) each, at times (s, shape (n,))."""

SHAKE_HZ = (1.5, 3.7, 8.3)
"""A hand shakes at a few frequencies, less at higher ones."""


@dataclass(frozen=True, slots=True)
class Area:
    """Where a centre may be (pixels)."""

    left: float
    top: float
    right: float
    bottom: float

    @property
    def centre(self) -> tuple[float, float]:
        """Its middle (pixels)."""
        return (self.left + self.right) / 2, (self.top + self.bottom) / 2

    @property
    def reach(self) -> tuple[float, float]:
        """Half its width and height."""
        return (self.right - self.left) / 2, (self.bottom - self.top) / 2


def rests(x: float, y: float) -> Track:
    """Stands still."""
    return lambda times: (np.full_like(times, x), np.full_like(times, y))


def wanders(rng: np.random.Generator, area: Area, speed_px_s: float) -> Track:
    """Swings to and fro in an area, differently in x and y, at a root mean square speed."""
    (x, y), reach = area.centre, area.reach
    # A sine of amplitude a and frequency f has a speed of sqrt(2) pi a f; two of them make the speed together.
    waves = []
    share = rng.uniform(0.35, 0.65)
    for extent, part in zip(reach, (share, 1 - share), strict=True):
        # Slow things do not need the whole area: a period is not longer than about 4 s.
        speed = speed_px_s * np.sqrt(part)
        amplitude = max(min(extent, speed * 4 / (np.sqrt(2) * np.pi)), 0.5)
        waves.append((amplitude, speed / (np.sqrt(2) * np.pi * amplitude), rng.uniform(0, 2 * np.pi)))
    slack = [max(extent - wave[0], 0.0) for extent, wave in zip(reach, waves, strict=True)]
    x, y = (middle + rng.uniform(-1, 1) * room for middle, room in zip((x, y), slack, strict=True))

    def track(times: FloatArray) -> tuple[FloatArray, FloatArray]:
        (ax, fx, px), (ay, fy, py) = waves
        return x + ax * np.sin(2 * np.pi * fx * times + px), y + ay * np.sin(2 * np.pi * fy * times + py)

    return track


def crosses(rng: np.random.Generator, area: Area, speed_px_s: float, duration_s: float) -> Track:
    """Goes through an area from side to side, a little up and down on its way, at most at this speed."""
    x, y = area.centre
    reach_x, reach_y = area.reach
    travel = min(speed_px_s * duration_s, 2 * reach_x)
    side = rng.choice([-1.0, 1.0])
    y += rng.uniform(-0.6, 0.6) * reach_y
    sway, phase = 0.15 * min(reach_y, travel / 4), rng.uniform(0, 2 * np.pi)
    rate_hz = rng.uniform(0.3, 0.8)

    def track(times: FloatArray) -> tuple[FloatArray, FloatArray]:
        along = side * travel * (np.clip(times / duration_s, 0, 1) - 0.5)
        return x + along, y + sway * np.sin(2 * np.pi * rate_hz * times + phase)

    return track


def leaves(inside: Track, leave_s: float, back_s: float | None, shift: tuple[float, float], turn_s: float) -> Track:
    """Another track, which is off by `shift` (pixels) from turn_s after leave_s on, until back_s."""

    def track(times: FloatArray) -> tuple[FloatArray, FloatArray]:
        x, y = inside(times)
        away = smooth_step((times - leave_s) / turn_s)
        if back_s is not None:
            away = away - smooth_step((times - back_s) / turn_s)
        return x + shift[0] * away, y + shift[1] * away

    return track


def slides(rng: np.random.Generator, speed_px_s: float, duration_s: float) -> Track:
    """A camera on a rail: to the side at a speed that ebbs a little; starts and ends off the middle."""
    side = rng.choice([-1.0, 1.0])
    tilt = rng.uniform(-0.15, 0.15)

    def track(times: FloatArray) -> tuple[FloatArray, FloatArray]:
        ebb = 0.04 * np.sin(2 * np.pi * 0.8 * times)
        along = side * speed_px_s * (times + ebb - duration_s / 2)
        return along, tilt * along

    return track


def shakes(rng: np.random.Generator, amplitude_px: float) -> Track:
    """A camera in a hand."""
    phases = rng.uniform(0, 2 * np.pi, (2, len(SHAKE_HZ)))
    rates = np.array(SHAKE_HZ) * rng.uniform(0.8, 1.25, (2, len(SHAKE_HZ)))
    amplitudes = amplitude_px / (1 + np.arange(len(SHAKE_HZ))) ** 1.5

    def axis(times: FloatArray, number: int) -> FloatArray:
        waves = np.sin(2 * np.pi * rates[number] * times[:, None] + phases[number])
        return np.asarray(waves @ amplitudes, np.float64)

    return lambda times: (axis(times, 0), axis(times, 1))


def swings(rng: np.random.Generator, low: float, high: float, duration_s: float) -> Callable[[FloatArray], FloatArray]:
    """A value that goes from low to high and back, geometrically (of scales), once or so in duration_s."""
    rate_hz, phase = rng.uniform(0.6, 1.1) / duration_s, rng.uniform(0, 2 * np.pi)

    def value(times: FloatArray) -> FloatArray:
        share = 0.5 + 0.5 * np.sin(2 * np.pi * rate_hz * times + phase)
        return np.asarray(low * (high / low) ** share, np.float64)

    return value


def smooth_step(share: FloatArray) -> FloatArray:
    """0 before 0, 1 after 1, and without a jerk between."""
    share = np.clip(share, 0, 1)
    return np.asarray(share * share * (3 - 2 * share), np.float64)
