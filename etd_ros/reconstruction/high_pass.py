"""Intensity images from events alone: a per-pixel high-pass filter (Scheerlinck et al. 2018)."""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.borrowing_kernel import borrowing_kernel, borrowing_part
from etd_ros.errors import EtdError
from etd_ros.events import Events, check_pixel_map
from etd_ros.parameters import Parameters, parameter
from etd_ros.reconstruction.grey_range import GreyRange

SPAN = 40.0
"""Time constants after which a contribution counts as gone: exp(-40) is below double precision's step at 1."""
TABLE_BITS = 11
TABLE_SIZE = 1 << TABLE_BITS
TICKS_PER_TIME_CONSTANT = TABLE_SIZE * TABLE_SIZE / SPAN
"""Two tables of 2048 cover the span, so a tick is 1e-5 time constants: the relative error of a contribution's decay."""
FINE_DECAY = np.exp(-np.arange(TABLE_SIZE) / TICKS_PER_TIME_CONSTANT)
COARSE_DECAY = np.append(np.exp(-np.arange(TABLE_SIZE) * (TABLE_SIZE / TICKS_PER_TIME_CONSTANT)), 0.0)
"""Its last entry is for everything past the span."""

PIXEL_DTYPE = np.dtype([("level", np.float32), ("tick", np.int32)], align=True)
"""What is kept of a pixel: 8 bytes in one place, so that an event costs one access to memory."""
TICK_MAX = 2**31 - 1
TICK_MIN = -(2**31)

LEVEL_SHOWN_MAX = 16.0
"""Log intensity above which pixels are equally bright, nine million times a grey one: no overflow, no empty range."""
SHOWN_GAIN = 1.5
"""Shown is exp(L + ln 1.5) - 1 = 1.5 exp(L) - 1: a grey range of exp(L) alone gives the same grey levels."""


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
    decays to the image's stamp. Times are rounded down to ticks of 1e-5 / w_c since a base that hardly ever moves, not
    from event to event, so rounding does not add up; levels are float32. The images depend on the sequence of events
    and stamps, not on batches.
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
        self._state = np.zeros(height * width, PIXEL_DTYPE)
        self._range = GreyRange(
            width,
            height,
            dropped_percent=self._config.dropped_percent,
            range_min=self._config.range_min / SHOWN_GAIN,
            range_time_s=self._config.range_time_s,
        )
        self._brightness = np.empty((height, width), np.float32)
        self._unsmoothed = np.empty((height, width), np.uint8)
        self.reset()
        _rebase(self._state, 0)  # Compiled now, not in the middle of a stream.

    def reset(self) -> None:
        """Forget everything: the next events start a new stream."""
        self._state[:] = 0
        self._base_ns: int | None = None
        self._range.reset()

    def integrate(self, events: Events) -> None:
        """Take events that follow the last ones in time; O(n). Events off the sensor are left out.

        Raises:
            ReconstructionError: the events are of another sensor size, or their arrays differ in length.
        """
        if (events.width, events.height) != (self.width, self.height):
            msg = (
                f"events of a {events.width}x{events.height} sensor for a reconstruction of "
                f"{self.width}x{self.height}: make a new filter when the sensor changes"
            )
            raise ReconstructionError(msg)
        if not len(events.t) == len(events.x) == len(events.y) == len(events.p):
            msg = "the events' arrays t, x, y, p differ in length"
            raise ReconstructionError(msg)
        if not len(events):
            return
        if self._base_ns is None:
            self._base_ns = int(events.t[0])
        for part in self._parts(events):
            _integrate(
                part.t,
                part.x,
                part.y,
                part.p,
                self._base_ns,
                self._ticks_per_ns,
                self._config.contrast_on,
                self._config.contrast_off,
                self._state,
                self.width,
                self.height,
                FINE_DECAY,
                COARSE_DECAY,
            )

    def levels(self, stamp_ns: int) -> npt.NDArray[np.float32]:
        """Log intensity L at a time (ns) not before the last event, float32, shape (height, width)."""
        levels = np.empty((self.height, self.width), np.float32)
        self._decay_into(levels, stamp_ns, math.inf)
        return levels

    def image(self, stamp_ns: int) -> npt.NDArray[np.uint8]:
        """The image at a time (ns) not before the last event, uint8, shape (height, width).

        Shown is exp(L + ln 1.5) - 1, which lies in 0..1 around 0.5 for the log intensity log(1 + I) of an image I
        in 0..1; L above 16 counts as 16. The grey range leaves out `dropped_percent` at either end and follows the
        scene with `range_time_s` over the stamps asked for.
        """
        brightness = self._brightness
        self._decay_into(brightness, stamp_ns, LEVEL_SHOWN_MAX)
        np.exp(brightness, out=brightness)
        low, high = self._range.follow(brightness, stamp_ns)
        smoothing = self._config.smoothing
        image = np.empty_like(self._unsmoothed) if smoothing == "none" else self._unsmoothed
        _spread(brightness.ravel(), low, high, image.ravel())
        if smoothing == "gaussian":
            return np.asarray(cv2.GaussianBlur(image, (5, 5), 0), np.uint8)
        if smoothing == "bilateral":
            return np.asarray(cv2.bilateralFilter(image, 5, 25, 25), np.uint8)
        return image

    def _decay_into(self, levels: npt.NDArray[np.float32], stamp_ns: int, highest: float) -> None:
        tick = 0 if self._base_ns is None else self._tick(stamp_ns)
        _decay(self._state, tick, highest, FINE_DECAY, COARSE_DECAY, levels.ravel())

    def _tick(self, stamp_ns: int) -> int:
        assert self._base_ns is not None
        return int((int(stamp_ns) - self._base_ns) * self._ticks_per_ns)

    def _parts(self, events: Events) -> Iterator[Events]:
        """The events in parts whose ticks fit the pixels'; in between, ticks start to count anew.

        That happens once in 500 spans of the filter's memory, so neither the pass over the pixels nor its rounding
        counts.
        """
        while self._tick(events.t[-1]) > TICK_MAX:
            shift = self._tick(events.t[0])
            if shift > TICK_MAX:
                _rebase(self._state, shift)
                self._base_ns = int(events.t[0])
            else:
                end = bisect.bisect_right(events.t, TICK_MAX, key=self._tick)
                yield events[:end]
                events = events[end:]
        yield events


@borrowing_part
def _kept(ticks: int, fine: Any, coarse: Any) -> float:
    """exp(-ticks / TICKS_PER_TIME_CONSTANT) as a product of two table entries; 1 before and 0 past the span."""
    # Clamped and unsigned, so that there is neither a branch nor an index out of the tables.
    index = np.uint64(min(max(ticks, 0), TABLE_SIZE * TABLE_SIZE))
    return coarse[index >> np.uint64(TABLE_BITS)] * fine[index & np.uint64(TABLE_SIZE - 1)]  # type: ignore[no-any-return]


@borrowing_kernel
def _integrate(
    t: Any,
    x: Any,
    y: Any,
    p: Any,
    base_ns: int,
    ticks_per_ns: float,
    contrast_on: float,
    contrast_off: float,
    state: Any,
    width: int,
    height: int,
    fine: Any,
    coarse: Any,
) -> None:
    for i in range(len(t)):
        # Whatever the integers are: a negative one would be an index before the image.
        column, row = np.uint16(x[i]), np.uint16(y[i])
        if column >= width or row >= height:
            continue
        tick = int((t[i] - base_ns) * ticks_per_ns)
        pixel = state[np.uint64(row) * np.uint64(width) + np.uint64(column)]
        kept = _kept(tick - pixel.tick, fine, coarse)
        pixel.level = kept * pixel.level + (contrast_on if p[i] else contrast_off)
        pixel.tick = tick


@borrowing_kernel
def _rebase(state: Any, shift: int) -> None:
    """Count ticks from `shift` later; pixels too old for that have decayed long before."""
    ticks = state["tick"]
    for i in range(len(ticks)):
        ticks[i] = max(ticks[i], TICK_MIN + shift) - shift


@borrowing_kernel
def _decay(state: Any, tick: int, highest: float, fine: Any, coarse: Any, levels: Any) -> None:
    for i in range(len(levels)):
        pixel = state[i]
        levels[i] = min(highest, pixel.level * _kept(tick - pixel.tick, fine, coarse))


@borrowing_kernel
def _spread(brightness: Any, low: float, high: float, image: Any) -> None:
    """Values from low to high spread over 0..255, rounded and clipped; all float32, eight in one instruction."""
    black, scale = np.float32(low), np.float32(255 / (high - low))
    for i in range(len(image)):
        grey = (brightness[i] - black) * scale
        image[i] = np.uint8(min(np.float32(255), max(np.float32(0), grey)) + np.float32(0.5))
