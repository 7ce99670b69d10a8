"""Intensity images from events alone: a per-pixel high-pass filter (Scheerlinck et al. 2018)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.errors import EtdError
from etd_ros.events import Events, check_pixel_map
from etd_ros.parameters import Parameters, parameter

SPAN = 40.0
"""Time constants after which a contribution counts as gone: exp(-40) is below double precision's step at 1."""
TABLE_BITS = 11
TABLE_SIZE = 1 << TABLE_BITS
TICKS_PER_TIME_CONSTANT = TABLE_SIZE * TABLE_SIZE / SPAN
"""Two tables of 2048 cover the span, so a tick is 1e-5 time constants: the relative error of a contribution's decay."""
FINE_DECAY = np.exp(-np.arange(TABLE_SIZE) / TICKS_PER_TIME_CONSTANT)
COARSE_DECAY = np.exp(-np.arange(TABLE_SIZE) * (TABLE_SIZE / TICKS_PER_TIME_CONSTANT))

LOG_OFFSET = math.log(1.5)
BOUND_SAMPLES_MAX = 1 << 16
LEVEL, TICK = 0, 1


class ReconstructionError(EtdError):
    """Events or stamps that do not fit the filter."""


@dataclass(frozen=True)
class HighPassConfig(Parameters):
    """Parameters of the high-pass reconstruction."""

    cutoff_hz: float = parameter(
        3.0,
        "cut-off frequency (Hz): higher forgets sooner, with less noise and shorter trails, but flat areas fade; "
        "0 keeps all",
        low=0.0,
        high=1000.0,
    )
    contrast_on: float = parameter(0.1, "log intensity that an On event adds", low=0.0, high=10.0)
    contrast_off: float = parameter(-0.1, "log intensity that an Off event adds", low=-10.0, high=0.0)
    dropped_percent: float = parameter(
        0.25, "pixels left out at either end when the grey range is set (%)", low=0.0, high=25.0
    )
    range_min: float = parameter(
        0.6, "smallest displayed intensity range spread over 0..255: keeps noise of an empty scene faint", low=0.01
    )
    range_time_s: float = parameter(
        0.5, "time constant with which the grey range follows the scene (s); 0 sets it anew for each image", low=0.0
    )
    smoothing: str = parameter(
        "gaussian", "smoothing of the image (5x5 pixels)", choices=("none", "gaussian", "bilateral")
    )


class HighPassFilter:
    """Log intensity per pixel, up to what the high-pass filter forgets.

    An event of polarity c after dt without one: L <- exp(-w_c dt) L + c, w_c = 2 pi cutoff_hz. At output every pixel
    decays to the image's stamp. Times are rounded down to ticks of 1e-5 / w_c, absolutely and not from event to event,
    so rounding does not add up. The images depend on the sequence of events and stamps, not on batches.
    """

    def __init__(self, width: int, height: int, config: HighPassConfig | None = None) -> None:
        """A filter for a width x height sensor (pixels).

        Raises:
            EventsError: an impossible sensor size.
        """
        check_pixel_map(width, height)
        self.width = width
        self.height = height
        self._config = config or HighPassConfig()
        self._ticks_per_ns = 2 * math.pi * self._config.cutoff_hz * 1e-9 * TICKS_PER_TIME_CONSTANT
        # Level and tick lie side by side, so that an event costs one cache line.
        self._state = np.zeros((height, width, 2), np.float64)
        self._sampling = max(1, math.ceil(math.sqrt(width * height / BOUND_SAMPLES_MAX)))
        self.reset()

    def reset(self) -> None:
        """Forget everything: the next events start a new stream."""
        self._state[:] = 0.0
        self._origin_ns: int | None = None
        self._bounds: tuple[float, float] | None = None
        self._bounds_ns = 0

    def integrate(self, events: Events) -> None:
        """Take events that follow the last ones in time; O(n).

        Raises:
            ReconstructionError: the events are of another sensor size.
        """
        if (events.width, events.height) != (self.width, self.height):
            msg = (
                f"events of a {events.width}x{events.height} sensor for a reconstruction of "
                f"{self.width}x{self.height}: make a new filter when the sensor changes"
            )
            raise ReconstructionError(msg)
        if not len(events):
            return
        if self._origin_ns is None:
            self._origin_ns = int(events.t[0])
        _integrate(
            events.t,
            events.x,
            events.y,
            events.p,
            self._origin_ns,
            self._ticks_per_ns,
            self._config.contrast_on,
            self._config.contrast_off,
            self._state,
            FINE_DECAY,
            COARSE_DECAY,
        )

    def levels(self, stamp_ns: int) -> npt.NDArray[np.float32]:
        """Log intensity L at a time (ns) not before the last event, float32, shape (height, width)."""
        levels = np.empty((self.height, self.width), np.float32)
        origin_ns = stamp_ns if self._origin_ns is None else self._origin_ns
        tick = math.floor((stamp_ns - origin_ns) * self._ticks_per_ns)
        _decay(self._state, tick, FINE_DECAY, COARSE_DECAY, levels)
        return levels

    def image(self, stamp_ns: int) -> npt.NDArray[np.uint8]:
        """The image at a time (ns) not before the last event, uint8, shape (height, width).

        Shown is exp(L + ln 1.5) - 1, which lies in 0..1 around 0.5 for the log intensity log(1 + I) of an image I
        in 0..1. The grey range leaves out `dropped_percent` at either end and follows the scene with
        `range_time_s` over the stamps asked for.
        """
        intensity = np.exp(self.levels(stamp_ns) + np.float32(LOG_OFFSET)) - np.float32(1)
        low, high = self._follow(self._robust_bounds(intensity), stamp_ns)
        image: npt.NDArray[np.uint8] = _grey(intensity, low, high)
        if self._config.smoothing == "gaussian":
            image = np.asarray(cv2.GaussianBlur(image, (5, 5), 0), np.uint8)
        elif self._config.smoothing == "bilateral":
            image = np.asarray(cv2.bilateralFilter(image, 5, 25, 25), np.uint8)
        return image

    def _robust_bounds(self, intensity: npt.NDArray[np.float32]) -> tuple[float, float]:
        """The range left when the extreme pixels are dropped, at least `range_min` wide."""
        sample = intensity[:: self._sampling, :: self._sampling].ravel()
        first = int(len(sample) * self._config.dropped_percent / 100)
        last = len(sample) - 1 - first
        ordered = np.partition(sample, (first, last))
        low, high = float(ordered[first]), float(ordered[last])
        missing = max(0.0, self._config.range_min - (high - low))
        return low - missing / 2, high + missing / 2

    def _follow(self, bounds: tuple[float, float], stamp_ns: int) -> tuple[float, float]:
        """The grey range after a first-order low-pass over the stamps."""
        if self._bounds is not None and self._config.range_time_s > 0:
            kept = math.exp(-max(0, stamp_ns - self._bounds_ns) * 1e-9 / self._config.range_time_s)
            low, high = (kept * old + (1 - kept) * new for old, new in zip(self._bounds, bounds, strict=True))
            bounds = low, high
        self._bounds, self._bounds_ns = bounds, stamp_ns
        return bounds


@njit(cache=True, nogil=True)
def _factor(ticks: float, fine: Any, coarse: Any) -> float:
    """exp(-ticks / TICKS_PER_TIME_CONSTANT) as a product of two table entries; 1 before and 0 past the span."""
    if ticks <= 0:
        return 1.0
    if ticks >= TABLE_SIZE * TABLE_SIZE:
        return 0.0
    index = int(ticks)
    return coarse[index >> TABLE_BITS] * fine[index & (TABLE_SIZE - 1)]  # type: ignore[no-any-return]


@njit(cache=True, nogil=True)
def _integrate(
    t: Any,
    x: Any,
    y: Any,
    p: Any,
    origin_ns: int,
    ticks_per_ns: float,
    contrast_on: float,
    contrast_off: float,
    state: Any,
    fine: Any,
    coarse: Any,
) -> None:
    height, width, _ = state.shape
    for i in range(len(t)):
        column, row = x[i], y[i]
        if column >= width or row >= height:
            continue
        tick = math.floor((t[i] - origin_ns) * ticks_per_ns)
        kept = _factor(tick - state[row, column, TICK], fine, coarse)
        state[row, column, LEVEL] = kept * state[row, column, LEVEL] + (contrast_on if p[i] else contrast_off)
        state[row, column, TICK] = tick


@njit(cache=True, nogil=True)
def _decay(state: Any, tick: float, fine: Any, coarse: Any, levels: Any) -> None:
    height, width, _ = state.shape
    for row in range(height):
        for column in range(width):
            level = state[row, column, LEVEL]
            if level != 0.0:
                level *= _factor(tick - state[row, column, TICK], fine, coarse)
            levels[row, column] = level


@njit(cache=True, nogil=True)
def _grey(intensity: Any, low: float, high: float) -> Any:
    """Intensities spread over 0..255, rounded and clipped, uint8."""
    height, width = intensity.shape
    image = np.empty((height, width), np.uint8)
    scale = 255.0 / (high - low)
    for row in range(height):
        for column in range(width):
            value = (intensity[row, column] - low) * scale
            image[row, column] = np.uint8(min(255.0, max(0.0, value)) + 0.5)
    return image
