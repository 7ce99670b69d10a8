"""The whole method, free of ROS: events in; frames, images and boxes out. `track` and the nodes share it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from etd_ros.conversion import (
    AtsltdConverter,
    BackgroundActivityFilter,
    Converter,
    FixedCountConverter,
    FixedWindowConverter,
    Frame,
)
from etd_ros.detection import EdgeBoxes
from etd_ros.errors import EtdError
from etd_ros.events import Events
from etd_ros.reconstruction import HighPassFilter, SynchronisedReconstruction
from etd_ros.recovery import make_recovery
from etd_ros.settings import Settings
from etd_ros.stream import StreamBatch
from etd_ros.targets import TargetStart, unique_targets
from etd_ros.tracking import MultiTracker, TargetReport, method_named

CONVERSIONS = ("atsltd", "fixed_window", "fixed_count")


class EngineError(EtdError):
    """An engine that cannot be built or fed."""


@dataclass(frozen=True, slots=True)
class Step:
    """What one frame brought.

    Attributes:
        frame: the frame.
        image: the intensity image at its stamp, uint8 (height, width), where the method recovers.
        reports: the targets' states, in the order of their start.
    """

    frame: Frame
    image: npt.NDArray[np.uint8] | None
    reports: tuple[TargetReport, ...]


class FrameSource:
    """Noise filter and converter: the stage that turns events into frames."""

    def __init__(self, conversion: str, width: int, height: int, settings: Settings) -> None:
        self._filter = (
            BackgroundActivityFilter(width, height, settings.noise_filter)
            if settings.noise_filter.window_s > 0
            else None
        )
        self._converter = _make_converter(conversion, width, height, settings)

    def frames(self, events: Events) -> Iterator[Frame]:
        """The frames that this batch finishes."""
        return self._converter.convert(self._filter.filter(events) if self._filter else events)

    def reset(self) -> None:
        """Start a new stream."""
        self._converter.reset()
        if self._filter:
            self._filter.reset()


def _make_converter(conversion: str, width: int, height: int, settings: Settings) -> Converter:
    if conversion == "atsltd":
        return AtsltdConverter(width, height, settings.atsltd)
    if conversion == "fixed_window":
        return FixedWindowConverter(width, height, settings.fixed_window)
    if conversion == "fixed_count":
        return FixedCountConverter(width, height, settings.fixed_count)
    msg = f"unknown conversion {conversion!r}: choose one of {', '.join(CONVERSIONS)}"
    raise EngineError(msg)


def make_tracker(method: str, width: int, height: int, settings: Settings) -> MultiTracker:
    """The tracking stage of a method.

    Raises:
        TrackingError: an unknown method.
        RecoveryError: the recovery tracker cannot be had (OpenCV build, model files).
    """
    recovery = make_recovery(settings.recovery) if method_named(method).recovers else None
    return MultiTracker(width, height, settings.tracking, EdgeBoxes(settings.detection), recovery)


class Engine:
    """One sensor's events to boxes."""

    def __init__(self, width: int, height: int, *, method: str = "etd", settings: Settings | None = None) -> None:
        settings = settings or Settings()
        self.width = width
        self.height = height
        self.tracker = make_tracker(method, width, height, settings)
        self._source = FrameSource(method_named(method).conversion, width, height, settings)
        self._reconstruction = (
            SynchronisedReconstruction(HighPassFilter(width, height, settings.reconstruction))
            if method_named(method).recovers
            else None
        )
        self._waiting: deque[Frame] = deque()

    def feed(self, events: Events) -> Iterator[Step]:
        """Take a batch that follows the last one in time; yield a step for each frame it finishes.

        Raises:
            ConversionError: the batch is of another sensor size.
        """
        if self._reconstruction is None:
            for frame in self._source.frames(events):
                yield Step(frame, None, self.tracker.update(frame.stamp_ns, frame.data, None))
            return
        for frame in self._source.frames(events):
            self._waiting.append(frame)
            self._reconstruction.request(frame.stamp_ns)
        self._reconstruction.push(events)
        for stamp_ns, image in self._reconstruction.ready():
            frame = self._waiting.popleft()
            if frame.stamp_ns != stamp_ns:
                msg = f"image at {stamp_ns} ns does not belong to the frame at {frame.stamp_ns} ns"
                raise EngineError(msg)
            yield Step(frame, image, self.tracker.update(stamp_ns, frame.data, image))

    def reset(self) -> None:
        """Start a new stream; the targets stay."""
        self._source.reset()
        self._waiting.clear()
        if self._reconstruction:
            self._reconstruction.reset()


def track(
    streams: Iterable[StreamBatch],
    targets: Iterable[TargetStart],
    *,
    method: str = "etd",
    settings: Settings | None = None,
) -> Iterator[Step]:
    """Track targets through one sensor's events, as they come from `Recording.streams` or a `StreamGuard`.

    Raises:
        BoxError, TrackingError, TargetError: a target that cannot be started.
    """
    settings = settings or Settings()
    targets = unique_targets(targets)
    engine: Engine | None = None
    for batch in streams:
        events = batch.events
        if engine is None or (events.width, events.height) != (engine.width, engine.height):
            if engine is None:
                for target in targets:
                    target.check_start(int(events.t[0]))
            engine = Engine(events.width, events.height, method=method, settings=settings)
            for target in targets:
                engine.tracker.start(target.name, target.box, target.stamp_ns)
        elif batch.restart is not None:
            engine.reset()
        yield from engine.feed(events)
