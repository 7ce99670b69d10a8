"""An event camera in front of a scene (Gallego et al. 2020, Sec. 2.4): events where log intensity has changed by a
pixel's contrast threshold since its last event, and noise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.events import EVENT_DTYPE, Events
from etd_ros.parameters import Parameters, parameter
from etd_ros.simulation.scene import Scene

NS_PER_S = 1_000_000_000
NS_PER_US = 1_000
CROSSINGS_MAX = 16
"""Events of one pixel in one step at most; more means that the steps are too long for the motion."""


@dataclass(frozen=True, slots=True)
class SensorConfig(Parameters):
    """A simulated sensor."""

    contrast_threshold: float = parameter(0.25, "change of log intensity that makes an event", low=0.02, high=2.0)
    threshold_spread: float = parameter(0.03, "standard deviation of the threshold over pixels", low=0.0, high=0.5)
    refractory_s: float = parameter(0.0005, "dead time of a pixel after an event (s)", low=0.0, high=1.0)
    noise_rate_hz: float = parameter(2000.0, "background events of the whole sensor (events/s)", low=0.0, high=1e6)
    step_s: float = parameter(0.001, "time between renderings (s)", low=1e-5, high=0.1)


def simulate(scene: Scene, *, seed: int, start_ns: int = 0, config: SensorConfig | None = None) -> Iterator[Events]:
    """A scene's events, lazily, a batch per rendering step; times are whole microseconds, as a sensor's.

    Args:
        scene: what the sensor sees.
        seed: of thresholds and noise; the same seed gives the same events.
        start_ns: time of the scene's start on the ROS clock (ns).
        config: the sensor.
    """
    config = config or SensorConfig()
    rng = np.random.default_rng(seed)
    shape = (scene.height, scene.width)
    spread = config.threshold_spread * rng.standard_normal((2, *shape))
    thresholds = np.maximum(config.contrast_threshold + spread, config.contrast_threshold / 4)
    before = scene.render(0.0)
    # Each pixel starts somewhere between two events, or all would wait equally long for their first.
    reference = before + thresholds[0] * rng.uniform(-1, 1, shape) / 2
    last_us = np.full(shape, -(2**62), np.int64)
    for step in range(round(scene.duration_s / config.step_s)):
        first_us, end_us = (round(number * config.step_s * 1e6) for number in (step, step + 1))
        after = scene.render((step + 1) * config.step_s)
        signal = _crossings(
            before, after, reference, thresholds, last_us, first_us, end_us, round(config.refractory_s * 1e6)
        )
        noise = _noise(rng, config, scene, first_us, end_us)
        before = after
        batch = np.concatenate([signal, noise])
        if len(batch):
            batch = batch[np.argsort(batch["t"], kind="stable")]
            batch["t"] = start_ns + batch["t"] * NS_PER_US
            yield Events.from_structured(batch, scene.width, scene.height)


def _noise(
    rng: np.random.Generator, config: SensorConfig, scene: Scene, first_us: int, end_us: int
) -> npt.NDArray[np.void]:
    count = rng.poisson(config.noise_rate_hz * config.step_s)
    noise = np.empty(count, EVENT_DTYPE)
    noise["t"] = rng.integers(first_us, end_us, count)
    noise["x"] = rng.integers(0, scene.width, count)
    noise["y"] = rng.integers(0, scene.height, count)
    noise["p"] = rng.integers(0, 2, count)
    return noise


def _crossings(
    before: npt.NDArray[np.float64],
    after: npt.NDArray[np.float64],
    reference: npt.NDArray[np.float64],
    thresholds: npt.NDArray[np.float64],
    last_us: npt.NDArray[np.int64],
    first_us: int,
    end_us: int,
    refractory_us: int,
) -> npt.NDArray[np.void]:
    """Events of one step, ordered by pixel; `reference` and `last_us` move on. Times in microseconds."""
    changed = np.abs(after - reference) >= np.minimum(thresholds[0], thresholds[1])
    capacity = int(np.count_nonzero(changed)) * CROSSINGS_MAX
    t, x, y, p = (np.empty(capacity, EVENT_DTYPE[name]) for name in ("t", "x", "y", "p"))
    count = _fill_crossings(before, after, reference, thresholds, last_us, first_us, end_us, refractory_us, t, x, y, p)
    events = np.empty(count, EVENT_DTYPE)
    events["t"], events["x"], events["y"], events["p"] = t[:count], x[:count], y[:count], p[:count]
    return events


@njit(cache=True, nogil=True)
def _fill_crossings(
    before: npt.NDArray[np.float64],
    after: npt.NDArray[np.float64],
    reference: npt.NDArray[np.float64],
    thresholds: npt.NDArray[np.float64],
    last_us: npt.NDArray[np.int64],
    first_us: int,
    end_us: int,
    refractory_us: int,
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
) -> int:
    """Linear interpolation between two renderings gives each crossing's time; returns the number of events."""
    count = 0
    height, width = before.shape
    for row in range(height):
        for column in range(width):
            rising = after[row, column] > reference[row, column]
            threshold = thresholds[1, row, column] if rising else -thresholds[0, row, column]
            for _ in range(CROSSINGS_MAX):
                level = reference[row, column] + threshold
                if (after[row, column] < level) if rising else (after[row, column] > level):
                    break
                reference[row, column] = level
                change = after[row, column] - before[row, column]
                share = (level - before[row, column]) / change if change != 0.0 else 0.0
                time_us = first_us + int(min(max(share, 0.0), 1.0) * (end_us - 1 - first_us))
                if time_us - last_us[row, column] < refractory_us or count == len(t):
                    continue
                last_us[row, column] = time_us
                t[count], x[count], y[count], p[count] = time_us, column, row, 1 if rising else 0
                count += 1
    return count
