"""An event camera in front of a scene (Gallego et al. 2020, Sec. 2.4): events where log intensity has changed by a
pixel's contrast threshold since its last event, and noise."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.events import EVENT_DTYPE, Events
from etd_ros.parameters import Parameters, parameter
from etd_ros.simulation.motion import FloatArray
from etd_ros.simulation.photoreceptors import Photoreceptors
from etd_ros.simulation.rendering import TILE, Renderer, Tiles
from etd_ros.simulation.scene import Scene
from etd_ros.simulation.steps import step_times_us

NS_PER_S = 1_000_000_000
NS_PER_US = 1_000
CROSSINGS_MAX = 16
"""Events of one pixel in one step at most; more means that the steps are too long for the motion."""

STEPS_SHARE = 0.5
"""Of the time constant of a pixel in full light, that a step lasts at most."""


@dataclass(frozen=True, slots=True)
class SensorConfig(Parameters):
    """A simulated sensor."""

    contrast_threshold: float = parameter(0.25, "change of log intensity that makes an event", low=0.02, high=2.0)
    threshold_spread: float = parameter(0.03, "standard deviation of the threshold over pixels", low=0.0, high=0.5)
    threshold_bias: float = parameter(
        0.0, "how much larger thresholds of falling light are than those of rising light (natural logarithm)",
        low=-2.0, high=2.0,
    )  # fmt: skip
    bandwidth_hz: float = parameter(
        0.0, "how fast a pixel in full light follows (Hz), in the dark a tenth of it; 0: at once", low=0.0, high=5e3
    )
    refractory_s: float = parameter(0.0005, "dead time of a pixel after an event (s)", low=0.0, high=1.0)
    noise_rate_hz: float = parameter(2000.0, "background events of the whole sensor (events/s)", low=0.0, high=1e6)
    leak_rate_hz: float = parameter(
        0.0, "events of rising light that come without a change, of the whole sensor (events/s)", low=0.0, high=1e6
    )
    hot_pixels: int = parameter(0, "pixels that fire all the time", low=0, high=100_000)
    hot_pixel_rate_hz: float = parameter(200.0, "events of each of them (events/s)", low=0.0, high=1e5)
    step_s: float = parameter(0.001, "time between renderings (s); the longest where they adapt", low=1e-5, high=0.1)
    step_px: float = parameter(
        0.0, "motion between renderings (pixels) that shortens their time; 0: all are equally long", low=0.0, high=10.0
    )


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
    thresholds *= np.exp(config.threshold_bias * np.array([0.5, -0.5]))[:, None, None]
    times_us = step_times_us(scene, step_s=_longest_step_s(config), step_px=config.step_px)
    renderer = Renderer(scene, times_us / 1e6)
    renderer.advance(0)
    receptors = Photoreceptors(renderer.after, config.bandwidth_hz) if config.bandwidth_hz > 0 else None
    # Each pixel starts somewhere between two events, or all would wait equally long for their first.
    reference = renderer.after + thresholds[0] * rng.uniform(-1, 1, shape) / 2
    pixels = _Pixels(thresholds, reference, round(config.refractory_s * 1e6))
    hot = rng.integers(0, reference.size, config.hot_pixels)
    for number, (first_us, end_us) in enumerate(zip(times_us[:-1].tolist(), times_us[1:].tolist(), strict=True), 1):
        renderer.advance(number)
        if receptors is not None:
            receptors.advance(renderer.before, renderer.after, renderer.changed, (end_us - first_us) / 1e6)
        seen = receptors or renderer
        # Thresholds that differ by polarity may make pixels fire at the start that nothing moved in.
        tiles = seen.changed if number > 1 else np.ones_like(seen.changed)
        signal = pixels.events(seen.before, seen.after, tiles, first_us, end_us)
        batch = np.concatenate([signal, _noise(rng, config, scene, hot, first_us, end_us)])
        if len(batch):
            batch = batch[np.argsort(batch["t"], kind="stable")]
            batch["t"] = start_ns + batch["t"] * NS_PER_US
            yield Events.from_structured(batch, scene.width, scene.height)


def _longest_step_s(config: SensorConfig) -> float:
    """The time between renderings (s), short enough that what follows the light does so evenly meanwhile."""
    if config.bandwidth_hz == 0:
        return config.step_s
    return min(config.step_s, STEPS_SHARE / (2 * math.pi * config.bandwidth_hz))


def _noise(
    rng: np.random.Generator,
    config: SensorConfig,
    scene: Scene,
    hot: npt.NDArray[np.int64],
    first_us: int,
    end_us: int,
) -> npt.NDArray[np.void]:
    """Events without a cause, anywhere and of any polarity, of leaking pixels, and of the hot ones (flat indices)."""
    rates_hz = config.noise_rate_hz, config.leak_rate_hz, len(hot) * config.hot_pixel_rate_hz
    anywhere, leaked, of_hot = rng.poisson(np.array(rates_hz) * (end_us - first_us) / 1e6).tolist()
    count = anywhere + leaked + of_hot
    noise = np.empty(count, EVENT_DTYPE)
    noise["t"] = rng.integers(first_us, end_us, count)
    noise["x"] = rng.integers(0, scene.width, count)
    noise["y"] = rng.integers(0, scene.height, count)
    noise["p"] = rng.integers(0, 2, count)
    noise["p"][anywhere : anywhere + leaked] = 1
    if of_hot:
        noise["y"][-of_hot:], noise["x"][-of_hot:] = np.divmod(rng.choice(hot, of_hot), scene.width)
    return noise


class _Pixels:
    """The sensor's pixels: the level of each at its last event, and the time of it.

    Args:
        thresholds: downwards and upwards, float64, shape (2, height, width).
        reference: log intensity that each pixel compares with, float64, shape (height, width).
        refractory_us: their dead time (us).
    """

    def __init__(self, thresholds: FloatArray, reference: FloatArray, refractory_us: int) -> None:
        self._thresholds = thresholds
        self._smallest = np.minimum(thresholds[0], thresholds[1])
        self._reference = reference
        self._last_us = np.full(reference.shape, -(2**62), np.int64)
        self._refractory_us = refractory_us

    def events(
        self, before: FloatArray, after: FloatArray, tiles: Tiles, first_us: int, end_us: int
    ) -> npt.NDArray[np.void]:
        """Events of one step in the tiles that have changed, ordered by pixel; times in microseconds."""
        capacity = _count_max(after, self._reference, self._smallest, tiles)
        t, x, y, p = (np.empty(capacity, EVENT_DTYPE[name]) for name in ("t", "x", "y", "p"))
        count = _fill_crossings(
            before, after, self._reference, self._thresholds, self._smallest, self._last_us, tiles,
            first_us, end_us, self._refractory_us, t, x, y, p,
        )  # fmt: skip
        events = np.empty(count, EVENT_DTYPE)
        events["t"], events["x"], events["y"], events["p"] = t[:count], x[:count], y[:count], p[:count]
        return events


@njit(cache=True, nogil=True)
def _count_max(after: FloatArray, reference: FloatArray, smallest: FloatArray, tiles: Tiles) -> int:
    """How many events one step can have at most."""
    count = 0
    height, width = after.shape
    for row in range(height):
        for tile in range(tiles.shape[1]):
            if tiles[row // TILE, tile]:
                for column in range(tile * TILE, min(width, (tile + 1) * TILE)):
                    change = abs(after[row, column] - reference[row, column])
                    if change >= smallest[row, column]:
                        count += CROSSINGS_MAX
    return count


@njit(cache=True, nogil=True)
def _fill_crossings(
    before: FloatArray,
    after: FloatArray,
    reference: FloatArray,
    thresholds: FloatArray,
    smallest: FloatArray,
    last_us: npt.NDArray[np.int64],
    tiles: Tiles,
    first_us: int,
    end_us: int,
    refractory_us: int,
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
) -> int:
    """Linear interpolation between two renderings gives each crossing's time; returns the number of events.

    `reference` and `last_us` move on.
    """
    count = 0
    height, width = before.shape
    for row in range(height):
        for tile in range(tiles.shape[1]):
            if not tiles[row // TILE, tile]:
                continue
            for column in range(tile * TILE, min(width, (tile + 1) * TILE)):
                if abs(after[row, column] - reference[row, column]) < smallest[row, column]:
                    continue
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
