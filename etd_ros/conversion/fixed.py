"""Converters that do not adapt: fixed time windows (the paper's ETD-FTW) and fixed numbers of events."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from etd_ros.conversion.accumulator import AccumulatingConverter, FrameAccumulator
from etd_ros.conversion.cell_map import DURATION_MAX_NS
from etd_ros.conversion.frame import Frame, FrameEnd
from etd_ros.events import Events
from etd_ros.parameters import Parameters, parameter


@dataclass(frozen=True)
class FixedWindowConfig(Parameters):
    """Length of the windows."""

    window_s: float = parameter(
        0.009, "Length of a frame (s); the paper's ETD-FTW has 9 ms", low=1e-6, high=DURATION_MAX_NS / 1e9
    )


class FixedWindowConverter(AccumulatingConverter):
    """Events to frames of one duration; a `Converter`.

    Window i holds the events with T_{i-1} < t <= T_i = T_0 + i * window_s, T_0 the time of the stream's first event
    (which the first window holds too). A window without events makes no frame. Grey levels are those of
    `FrameAccumulator`.
    """

    def __init__(self, width: int, height: int, config: FixedWindowConfig | None = None) -> None:
        """Prepare for a sensor of width x height pixels.

        Raises:
            EventsError: an impossible sensor size.
        """
        self.config = config or FixedWindowConfig()
        self._window_ns = round(self.config.window_s * 1e9)
        super().__init__(FrameAccumulator(width, height))

    def convert(self, events: Events) -> Iterator[Frame]:
        """See `Converter.convert`."""
        self._accumulator.accept(events)
        return self._frames(events)

    def _frames(self, events: Events) -> Iterator[Frame]:
        accumulator = self._accumulator
        i = 0
        while True:
            end_ns = accumulator.start_ns + self._window_ns
            step = accumulator.add(events, i, len(events), end_ns)
            if step is None:
                return
            _, i, event_ns, *_ = step
            if accumulator.events:
                frame = accumulator.finish(end_ns, FrameEnd.WINDOW)
                self._begin_window_of(event_ns)
                yield frame
            else:
                self._begin_window_of(event_ns)

    def _begin_window_of(self, event_ns: int) -> None:
        start_ns = self._accumulator.start_ns
        windows_before = (event_ns - start_ns - 1) // self._window_ns
        self._accumulator.start_ns = start_ns + windows_before * self._window_ns


@dataclass(frozen=True)
class FixedCountConfig(Parameters):
    """Number of events in a frame."""

    count: int = parameter(5000, "Events in a frame", low=1, high=100_000_000)
    max_duration_s: float = parameter(
        0.1, "Longest frame (s); quiet scenes end frames by it", low=1e-6, high=DURATION_MAX_NS / 1e9
    )


class FixedCountConverter(AccumulatingConverter):
    """Events to frames of one number of events, or of the longest duration (as in `AtsltdConverter`); a `Converter`.

    A frame starts at the end of the last one, T_{i-1}, and ends with its last event, T_i = t_count. Frames of no
    duration occur where `count` events share one time.
    """

    def __init__(self, width: int, height: int, config: FixedCountConfig | None = None) -> None:
        """Prepare for a sensor of width x height pixels.

        Raises:
            EventsError: an impossible sensor size.
        """
        self.config = config or FixedCountConfig()
        self._max_duration_ns = round(self.config.max_duration_s * 1e9)
        super().__init__(FrameAccumulator(width, height))

    def convert(self, events: Events) -> Iterator[Frame]:
        """See `Converter.convert`."""
        self._accumulator.accept(events)
        return self._frames(events)

    def _frames(self, events: Events) -> Iterator[Frame]:
        accumulator = self._accumulator
        i = 0
        while i < len(events):
            stop = min(len(events), i + self.config.count - accumulator.events)
            step = accumulator.add(events, i, stop, accumulator.start_ns + self._max_duration_ns)
            i = stop if step is None else step[1]
            if step is not None:
                frame = accumulator.skip_late(self._max_duration_ns, step)
            elif accumulator.events == self.config.count:
                frame = accumulator.finish(int(events.t[i - 1]), FrameEnd.COUNT)
            else:
                return
            if frame is not None:
                yield frame
