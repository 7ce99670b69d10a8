"""Frames with clear contours from a recording, and the NZGE interval that they give (paper section 3.2).

The paper samples its frames by eye. Here each sample is the sharpest of many frames of different lengths that start at
one instant, by a measure in which entropy has no part (`Clarity`); docs/calibration.md compares it with others.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.conversion.frame import ConversionError
from etd_ros.conversion.nzge import CELL_SIZE, LOG_BASE, check_grid, confidence_interval, nzge
from etd_ros.events import Events, concatenate
from etd_ros.parameters import Parameters, parameter
from etd_ros.stream import StreamBatch

SAMPLES_MIN = 10
NEIGHBOURS_MIN = 2
"""A pixel in the course of a contour has one on either side."""

_NEIGHBOURHOOD = (3, 3)
_NEIGHBOURS = 8


@dataclass(frozen=True, slots=True)
class CalibrationConfig(Parameters):
    """Which frames are compared, and which of the best ones count as clear."""

    events_min: int = parameter(100, "Events of the shortest frame", low=10, high=1_000_000)
    growth: float = parameter(1.2, "Events of a frame over those of the next shorter one", low=1.01, high=2.0)
    duration_max_s: float = parameter(0.5, "Longest frame (s)", low=1e-4, high=2.0)
    connectedness_min: float = parameter(0.5, "Frames of lower connectedness show no contours", low=0.0, high=1.0)
    decline: float = parameter(
        0.7, "No longer frames are tried once the clarity has fallen to this share of the best", low=0.0, high=1.0
    )


@dataclass(frozen=True, slots=True)
class Clarity:
    """How clear the contours of a frame are.

    Attributes:
        sharpness: energy of the grey levels' gradient over their own, sum |grad F|^2 / sum F^2 (Sobel 3x3). It falls
            as moving contours smear, because a wide smear has gradients at its sides only.
        connectedness: share of event pixels with at least two event pixels of their polarity round them, less what
            as many pixels strewn at random would have, over what that leaves: 0 for noise, 1 without loose pixels.
            It rises as the gaps in contours close.
    """

    sharpness: float
    connectedness: float

    @property
    def value(self) -> float:
        """Sharpness times connectedness: largest where contours are closed and not smeared yet."""
        return self.sharpness * self.connectedness


@dataclass(frozen=True, slots=True)
class Sample:
    """The clearest frame of one instant.

    Attributes:
        events: the events from the instant on, at least those of the frame.
        count: number of events in the frame, which begins with the first event and ends with its last one.
        nzge: its Non-Zero Grid Entropy.
        clarity: how clear it is.
    """

    events: Events
    count: int
    nzge: float
    clarity: Clarity

    @property
    def duration_s(self) -> float:
        """T_i - T_{i-1} (s)."""
        return (int(self.events.t[self.count - 1]) - int(self.events.t[0])) / 1e9

    def frame_data(self, scale: float = 1.0) -> npt.NDArray[np.uint8]:
        """The frame, or one of `scale` times its events, as far as there are any; see `frame_data`."""
        count = min(max(1, round(self.count * scale)), len(self.events))
        return frame_data(self.events[:count])


@dataclass(frozen=True, slots=True)
class Calibration:
    """What sampled frames say of a sensor.

    Attributes:
        values: NZGE of each frame, float64, shape (n,).
        mean, std: their mean and standard deviation (with n - 1).
        interval: [alpha, beta], the confidence interval of the mean.
    """

    values: npt.NDArray[np.float64]
    mean: float
    std: float
    interval: tuple[float, float]


def calibrate(values: npt.NDArray[np.float64], significance: float = 0.05) -> Calibration:
    """The NZGE interval of sampled frames (paper equations 5 to 7).

    Raises:
        ConversionError: fewer than SAMPLES_MIN frames, or significance out of range.
    """
    if len(values) < SAMPLES_MIN:
        msg = (
            f"{len(values)} frames with clear contours are too few, {SAMPLES_MIN} are needed: "
            "record more motion, or filter noise with --set noise_filter.window_s=0.01"
        )
        raise ConversionError(msg)
    interval = confidence_interval(values, significance)
    return Calibration(values, float(values.mean()), float(values.std(ddof=1)), interval)


def frame_data(events: Events, start_ns: int | None = None) -> npt.NDArray[np.uint8]:
    """The frame of these events, T_i being the time of the last one; grey levels as in `FrameAccumulator`.

    Args:
        events: one or more events.
        start_ns: T_{i-1} (ns), by default the time of the first event.

    Returns:
        uint8, shape (height, width, 2).
    """
    start_ns = int(events.t[0]) if start_ns is None else start_ns
    duration_ns = int(events.t[-1]) - start_ns
    age_ns = events.t - start_ns
    # Halves are rounded up, in whole numbers: floats would depend on the machine.
    levels = (510 * age_ns + duration_ns) // (2 * duration_ns) if duration_ns else np.full(len(events), 255)
    data = np.zeros((events.height, events.width, 2), np.uint8)
    # Where a pixel has several events, NumPy keeps what was assigned last: the latest one.
    data[events.y, events.x, 1 - events.p] = np.maximum(levels, 1)
    return data


def clarity(data: npt.NDArray[np.uint8]) -> Clarity:
    """How clear the contours of a frame are, both polarities taken together.

    Args:
        data: uint8, shape (height, width, 2).
    """
    energy = float(cv2.norm(data, cv2.NORM_L2SQR))
    gradients = (cv2.Sobel(data, cv2.CV_32F, dx, dy, ksize=3) for dx, dy in ((1, 0), (0, 1)))
    gradient_energy = sum(float(cv2.norm(gradient, cv2.NORM_L2SQR)) for gradient in gradients)
    return Clarity(gradient_energy / energy if energy else 0.0, _connectedness(data))


def _connectedness(data: npt.NDArray[np.uint8]) -> float:
    has_event = (data > 0).view(np.uint8)
    around = cv2.boxFilter(has_event, -1, _NEIGHBOURHOOD, normalize=False, borderType=cv2.BORDER_CONSTANT)
    pixels = int(np.count_nonzero(has_event))
    connected = int(np.count_nonzero(has_event & (around > NEIGHBOURS_MIN)))
    density = pixels / data.size
    expected = 1 - (1 - density) ** _NEIGHBOURS - _NEIGHBOURS * density * (1 - density) ** (_NEIGHBOURS - 1)
    if not pixels or expected >= 1:
        return 0.0
    return max(0.0, (connected / pixels - expected) / (1 - expected))


def clearest_frame(
    events: Events, config: CalibrationConfig, cell_size: int = CELL_SIZE, log_base: float = LOG_BASE
) -> Sample | None:
    """Of all frames that begin with the first of these events, the one with the clearest contours.

    Returns:
        None where none is clear: no contours, too few events, or the longest one is the clearest, so that a longer one
        might be clearer still.

    Raises:
        ConversionError: cell_size or log_base out of range.
    """
    best, best_count, longest = Clarity(0.0, 0.0), 0, 0
    for count in _ladder(events, config):
        longest = count
        current = clarity(frame_data(events[:count]))
        if current.value > best.value:
            best, best_count = current, count
        elif best.connectedness >= config.connectedness_min and current.value < config.decline * best.value:
            break
    if best_count == longest or best.connectedness < config.connectedness_min:
        return None
    return Sample(events, best_count, nzge(frame_data(events[:best_count]), cell_size, log_base), best)


def _ladder(events: Events, config: CalibrationConfig) -> Iterator[int]:
    """Numbers of events from events_min up, each `growth` times the one before."""
    count = float(config.events_min)
    while count <= len(events):
        if events.t[round(count) - 1] > events.t[0]:
            yield round(count)
        count *= config.growth


def clear_frames(
    batches: Iterable[StreamBatch],
    spacing: int,
    config: CalibrationConfig,
    cell_size: int = CELL_SIZE,
    log_base: float = LOG_BASE,
) -> Iterator[Sample]:
    """The clearest frame of each of many instants, where there is one.

    The instants lie `spacing` events apart, or farther where a frame is longer, since samples that share events are
    not independent. No frame is longer than `config.duration_max_s` or has more events than the sensor has pixels.

    Args:
        batches: one sensor's events, as from `Recording.streams`; no frame goes beyond the end of a stream.
        spacing: distance of the instants (events), at least 1.
        config: which frames are compared.
        cell_size: side of NZGE's cells (pixels).
        log_base: base of NZGE's logarithm.

    Raises:
        ConversionError: spacing below 1, or cell_size or log_base out of range.
    """
    if spacing < 1:
        msg = f"instants {spacing} events apart are impossible: choose 1 or more"
        raise ConversionError(msg)
    check_grid(cell_size, log_base)
    sampler = _Sampler(spacing, config, cell_size, log_base)
    for batch in batches:
        if batch.restart is not None:
            yield from sampler.finish()
        yield from sampler.feed(batch.events)
    yield from sampler.finish()


class _Sampler:
    """Holds as many events as the longest frame from the next instant on may have, and no more than one batch above."""

    def __init__(self, spacing: int, config: CalibrationConfig, cell_size: int, log_base: float) -> None:
        self._spacing = spacing
        self._config = config
        self._grid = (cell_size, log_base)
        self._duration_max_ns = round(config.duration_max_s * 1e9)
        self._held: list[Events] = []
        self._to_skip = 0

    def feed(self, events: Events) -> Iterator[Sample]:
        """Take the next batch of the stream; yield the samples whose frames it completes."""
        skipped = min(self._to_skip, len(events))
        self._to_skip -= skipped
        if skipped < len(events):
            self._held.append(events[skipped:])
        while self._held and self._holds_longest_frame():
            yield from self._take()

    def finish(self) -> Iterator[Sample]:
        """Yield the stream's last samples; the next batch starts a new stream."""
        while sum(map(len, self._held)) >= self._config.events_min:
            yield from self._take()
        self._held = []
        self._to_skip = 0

    def _holds_longest_frame(self) -> bool:
        first, last = self._held[0], self._held[-1]
        is_long = int(last.t[-1]) - int(first.t[0]) > self._duration_max_ns
        return is_long or sum(map(len, self._held)) >= first.width * first.height

    def _take(self) -> Iterator[Sample]:
        """The sample of the next instant, if it has one; go on to the instant after it."""
        events = concatenate(self._held)
        in_time = int(np.searchsorted(events.t, int(events.t[0]) + self._duration_max_ns, side="right"))
        sample = clearest_frame(events[: min(in_time, events.width * events.height)], self._config, *self._grid)
        advance = max(self._spacing, sample.count if sample else self._config.events_min)
        self._to_skip = max(0, advance - len(events))
        self._held = [events[advance:]] if advance < len(events) else []
        if sample is not None:
            yield sample
