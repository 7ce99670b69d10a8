"""The whole method, free of ROS: events in; frames, images and boxes out. `track` and the nodes share it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.cadence import Cadence
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
from etd_ros.longest_frames import LongestFrames
from etd_ros.per_sensor import PerSensor
from etd_ros.read_ahead import read_ahead
from etd_ros.reconstruction import HighPassFilter, SynchronisedReconstruction
from etd_ros.recovery import make_recovery
from etd_ros.settings import Settings
from etd_ros.stream import StreamBatch
from etd_ros.targets import TargetStart, check_start, unique_targets
from etd_ros.tracking import DEFAULT_METHOD, Click, Corrector, MultiTracker, Starter, TargetReport, method_named

T = TypeVar("T")

CONVERSIONS = ("atsltd", "atsltd_fine", "fixed_window", "fixed_count")


class EngineError(EtdError):
    """A stage that cannot be built or fed."""


@dataclass(frozen=True, slots=True)
class Part:
    """What goes from stage to stage: a batch, and a frame that it finishes.

    Attributes:
        batch: with the batch's first part only.
        frame: None where the batch finishes no frame.
        has_image: whether the method looks at the frame's intensity image.
        image: the intensity image at the frame's stamp, uint8 (height, width), once it is made.
    """

    batch: StreamBatch | None
    frame: Frame | None
    has_image: bool = True
    image: npt.NDArray[np.uint8] | None = None


@dataclass(frozen=True, slots=True)
class Step:
    """What one frame brought.

    Attributes:
        frame: the frame.
        image: the intensity image at its stamp, uint8 (height, width), where the method looks at one.
        reports: the targets' states, in the order of their start.
        notices: what there is to say of clicks that start nothing.
        waiting_clicks: the names of those that have started nothing yet.
    """

    frame: Frame
    image: npt.NDArray[np.uint8] | None
    reports: tuple[TargetReport, ...]
    notices: tuple[str, ...] = ()
    waiting_clicks: tuple[str, ...] = ()


class SearchRegions:
    """Where the targets are looked for next: what the tracker tells the converter, if NZGE is measured there.

    Attributes:
        boxes: the search regions (pixels), None for the whole sensor.
    """

    def __init__(self) -> None:
        self.boxes: Sequence[Box] | None = None

    def __call__(self) -> Sequence[Box] | None:
        return self.boxes


class FrameSource:
    """Noise filter and converter: the stage that turns events into frames.

    Args:
        conversion: one of CONVERSIONS.
        width: sensor width (pixels).
        height: sensor height (pixels).
        settings: of the filter and the converters.
        regions: where NZGE is measured if `settings.atsltd.entropy_region` says so; emptied here and by `reset`.
        image_interval_s: only the first frame in each such interval is to have an intensity image; 0: every frame.
        longest: how long ATSLTD frames may last beside `settings.atsltd`, if a tracker says so.
    """

    def __init__(
        self,
        conversion: str,
        width: int,
        height: int,
        settings: Settings,
        regions: SearchRegions | None = None,
        image_interval_s: float = 0.0,
        longest: LongestFrames | None = None,
    ) -> None:
        self._cadence = Cadence(image_interval_s)
        self._regions = SearchRegions() if regions is None else regions
        self._longest = longest
        self._forget_tracker()
        self._filter = (
            BackgroundActivityFilter(width, height, settings.noise_filter)
            if settings.noise_filter.window_s > 0
            else None
        )
        self._converter = _make_converter(conversion, width, height, settings, self._regions)

    def frames(self, events: Events) -> Iterator[Frame]:
        """The frames that this batch finishes."""
        frames = self._converter.convert(self._filter.filter(events) if self._filter else events)
        return frames if self._longest is None else self._paced(frames, self._longest)

    def last_at_least(self, duration_s: float) -> None:
        """Have frames that NZGE ends last at least so long (s), from the next one on: fewer frames where a later stage
        does not keep up."""
        if isinstance(self._converter, AtsltdConverter):
            self._converter.last_at_least(duration_s)

    def _paced(self, frames: Iterator[Frame], longest: LongestFrames) -> Iterator[Frame]:
        for frame in frames:
            yield frame
            self._last_at_most(longest.next_s())

    def _last_at_most(self, duration_s: float) -> None:
        if isinstance(self._converter, AtsltdConverter):
            self._converter.last_at_most(duration_s)

    def parts(self, batch: StreamBatch) -> Iterator[Part]:
        """The same for the stages that follow: a part for each frame, and one part where there is none."""
        rest: StreamBatch | None = batch
        for frame in self.frames(batch.events):
            yield Part(rest, frame, self._cadence.is_due(frame.stamp_ns))
            rest = None
        if rest is not None:
            yield Part(rest, None)

    def reset(self) -> None:
        """Start a new stream."""
        self._forget_tracker()
        self._last_at_most(math.inf)
        self._converter.reset()
        if self._filter:
            self._filter.reset()

    def _forget_tracker(self) -> None:
        """What it said of another stream or sensor says nothing about this one."""
        self._regions.boxes = None
        if self._longest is not None:
            self._longest.start_stream()


class ImageSource:
    """Reconstruction: the stage that gives frames their intensity images.

    A frame ends with an event of its batch or before one, so its image is complete once that batch is known.
    """

    def __init__(self, width: int, height: int, settings: Settings) -> None:
        self._reconstruction = SynchronisedReconstruction(HighPassFilter(width, height, settings.reconstruction))

    def take(self, part: Part) -> Part:
        """The part, with its image if it is to have one.

        Raises:
            ReconstructionError: the batch is of another sensor size.
            EngineError: the frame came without the batch that finished it.
        """
        # The stamp goes first: events held back for a stamp that is not known yet are bounded.
        if part.frame is not None and part.has_image:
            self._reconstruction.request(part.frame.stamp_ns)
        if part.batch is not None:
            self._reconstruction.push(part.batch.events)
        if part.frame is None:
            return part
        if not part.has_image:
            self._reconstruction.pass_by(part.frame.stamp_ns)
            return part
        images = dict(self._reconstruction.ready())
        if list(images) != [part.frame.stamp_ns]:
            msg = f"no image for the frame at {part.frame.stamp_ns} ns: the events that finished it were not given"
            raise EngineError(msg)
        return dataclasses.replace(part, image=images[part.frame.stamp_ns])

    def reset(self) -> None:
        """Start a new stream."""
        self._reconstruction.reset()


def nzge_interval(conversion: str, settings: Settings) -> tuple[float, float]:
    """[alpha, beta] in which the NZGE of a conversion's frames is to lie."""
    return (settings.atsltd.fine() if conversion == "atsltd_fine" else settings.atsltd).nzge_interval


def _make_converter(conversion: str, width: int, height: int, settings: Settings, regions: SearchRegions) -> Converter:
    if conversion == "atsltd":
        return AtsltdConverter(width, height, settings.atsltd, regions=regions)
    if conversion == "atsltd_fine":
        return AtsltdConverter(width, height, settings.atsltd.fine(), regions=regions)
    if conversion == "fixed_window":
        return FixedWindowConverter(width, height, settings.fixed_window)
    if conversion == "fixed_count":
        return FixedCountConverter(width, height, settings.fixed_count)
    msg = f"unknown conversion {conversion!r}: choose one of {', '.join(CONVERSIONS)}"
    raise EngineError(msg)


def make_tracker(
    method: str,
    width: int,
    height: int,
    settings: Settings,
    *,
    searches: bool = False,
    clicks: bool = False,
    auto: bool = False,
    search_wait_s: float = math.inf,
    corrector: Corrector | None = None,
) -> MultiTracker:
    """The tracking stage of a method.

    Args:
        method: one of METHODS.
        width: sensor width (pixels).
        height: sensor height (pixels).
        settings: of all stages.
        searches: whether its reports say how the targets were looked for.
        clicks: whether targets may be started by clicks.
        auto: whether moving objects become targets by themselves; clicks are taken, too.
        search_wait_s: how long the search of an image is waited for (s), as for `MultiTracker`.
        corrector: says how far boxes are off, as for `MultiTracker`.

    Raises:
        TrackingError: an unknown method.
        RecoveryError: the recovery tracker cannot be had (OpenCV build, model files).
        DetectionError: an OpenCV build without its contrib modules, for a method that chooses proposals.
    """
    chosen = method_named(method)
    recovery = make_recovery(settings.recovery) if chosen.recovers else None
    contours = settings.contours if chosen.contours else None
    detector = EdgeBoxes(settings.detection) if contours is None else None
    starter = Starter(width, height, settings.discovery, auto=auto) if clicks or auto else None
    return MultiTracker(
        width,
        height,
        settings.tracking,
        detector,
        recovery,
        contours,
        searches=searches,
        starter=starter,
        search_wait_s=search_wait_s,
        corrector=corrector,
    )


def track(
    streams: Iterable[StreamBatch],
    targets: Iterable[TargetStart],
    *,
    clicks: Iterable[Click] = (),
    auto: bool = False,
    method: str = DEFAULT_METHOD,
    settings: Settings | None = None,
    threads: bool = True,
    searches: bool = False,
    corrector: Corrector | None = None,
) -> Generator[Step, None, None]:
    """Track targets through one sensor's events, as they come from `Recording.streams` or a `StreamGuard`.

    Args:
        streams: iterated some frames ahead, in another thread.
        targets: what to track.
        clicks: points on what is to be tracked: what moves, or rests before a moving camera.
        auto: whether moving objects become targets by themselves.
        method: one of `METHODS`.
        settings: of all stages.
        threads: whether all before the tracking (reading `streams`, conversion, reconstruction) has a thread beside the
            caller's, a few frames ahead. The steps are the same without. Where NZGE is measured in the targets' search
            regions, each frame waits for the boxes of the last one, and that thread only reads.
        searches: whether reports say how the targets were looked for (`TargetReport.search`), to be drawn.
        corrector: says how far boxes of `etd-plus` are off, instead of the network that ships.

    Raises:
        BoxError, TrackingError, TargetError: a target that cannot be started.
        TrackingError, RecoveryError, DetectionError: as `make_tracker` does.
    """
    settings = settings or Settings()
    everything: list[TargetStart | Click] = [*targets, *clicks]
    starts = unique_targets(everything)
    frames_wait = settings.atsltd.follows_targets
    regions, longest = SearchRegions() if frames_wait else None, LongestFrames()
    with _ahead(streams, threads and frames_wait) as batches:
        parts = _frames(batches, method, settings, regions, longest)
        if method_named(method).recovers:
            parts = _images(parts, settings)
        with _ahead(parts, threads and not frames_wait) as made, closing(longest):
            has_clicks = any(isinstance(start, Click) for start in starts)
            make = partial(
                make_tracker, method, settings=settings, searches=searches, clicks=has_clicks, auto=auto,
                corrector=corrector,
            )  # fmt: skip
            yield from _steps(made, starts, make, regions, longest)


@contextmanager
def _ahead(items: Iterable[T], in_thread: bool) -> Iterator[Iterable[T]]:
    """The items, made in a thread or not. The thread has ended when the context has, also where an error keeps the
    generator that reads them from being let go."""
    if not in_thread:
        yield items
        return
    with closing(read_ahead(items)) as ahead:
        yield ahead


def _frames(
    streams: Iterable[StreamBatch],
    method: str,
    settings: Settings,
    regions: SearchRegions | None,
    longest: LongestFrames,
) -> Iterator[Part]:
    chosen = method_named(method)
    sources = PerSensor(
        lambda w, h: FrameSource(chosen.conversion, w, h, settings, regions, chosen.image_interval_s, longest)
    )
    for batch in streams:
        yield from sources.at(batch).parts(batch)


def _images(parts: Iterable[Part], settings: Settings) -> Iterator[Part]:
    sources = PerSensor(lambda width, height: ImageSource(width, height, settings))
    for part in parts:
        yield sources.at(part.batch).take(part)


def _steps(
    parts: Iterable[Part],
    starts: list[TargetStart | Click],
    make: Callable[[int, int], MultiTracker],
    regions: SearchRegions | None,
    longest: LongestFrames,
) -> Iterator[Step]:
    size: tuple[int, int] | None = None
    for part in parts:
        if part.batch is not None:
            events = part.batch.events
            if size is None:
                for start in starts:
                    check_start(start, int(events.t[0]))
            if (events.width, events.height) != size:
                size = (events.width, events.height)
                tracker = make(*size)
                for start in starts:
                    _begin(tracker, start)
        if part.frame is not None:
            reports = tracker.update(part.frame.stamp_ns, part.frame.data, part.image, part.frame.start_ns)
            if regions is not None:
                regions.boxes = tracker.search_regions()
            longest.ask(tracker.longest_frame_s())
            notices, waiting = tuple(tracker.take_notices()), tuple(tracker.waiting_clicks)
            yield Step(part.frame, part.image, reports, notices, waiting)


def _begin(tracker: MultiTracker, start: TargetStart | Click) -> None:
    if isinstance(start, Click):
        tracker.click(start)
    else:
        tracker.start(start.name, start.box, start.stamp_ns, start.class_id)
