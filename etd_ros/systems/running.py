"""Any system on any recording: pictures or events in, boxes out, each with the time that the system took."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from etd_ros.engine import track
from etd_ros.events import Events
from etd_ros.recordings.loaded import EventSource
from etd_ros.recovery import make_recovery
from etd_ros.settings import Settings
from etd_ros.stream import StreamBatch
from etd_ros.systems.interface import Answer, CompareError, EventTracker, PictureTracker
from etd_ros.systems.pictures import PICTURES_OF_EVENTS, Given, video_pictures
from etd_ros.systems.reading import Stopwatch, one_stream, since
from etd_ros.systems.registry import EventSystem, PictureSystem, System, system_named
from etd_ros.targets import TargetStart, unique_targets
from etd_ros.tracking import TargetReport, TargetState, method_named

GIVEN_SCORE = 1.0
"""Of the box that a target starts with."""


@dataclass(frozen=True, slots=True)
class SystemStep:
    """What one picture, frame or packet of events brought.

    Attributes:
        stamp_ns: its time (ns).
        picture: what the system saw: a grey picture, uint8, shape (h, w), a colour one in OpenCV's order, (h, w, 3), or
            a frame of On and Off events, (h, w, 2).
        reports: the targets' states, in the order of the starts. Scores are NaN where the system does not say how sure
            it is.
        seconds: what the system took since the last step (s): conversion or reconstruction, and tracking, but not
            reading. Where `threads` has the engine read beside its work: the time until the step was there.
    """

    stamp_ns: int
    picture: npt.NDArray[np.uint8]
    reports: tuple[TargetReport, ...]
    seconds: float


def run_system(
    name: str,
    recording: EventSource,
    starts: Iterable[TargetStart],
    settings: Settings | None = None,
    *,
    from_ns: int | None = None,
    seed: int = 0,
    threads: bool = False,
) -> Generator[SystemStep, None, None]:
    """Run a system on a recording. Each target has a tracker of its own and is started once: on the picture nearest to
    its stamp, which its box fits best, though its first answer is on the first one at or after the stamp (the engine's
    methods: on the first frame that ends there, which is what they are given, too).

    Args:
        name: one of SYSTEMS.
        recording: a `Recording`, or a `LoadedRecording` of it.
        starts: what to track, one or more.
        settings: of all stages.
        from_ns: what comes before this time (ns) is not given to the system, to start in the middle. Conversion and
            reconstruction have no past then: leave them some time before the first target starts.
        seed: of what is random, 0 or above.
        threads: whether the engine's methods read, convert and reconstruct in a thread of their own. The boxes are the
            same without.

    Raises:
        CompareError: an unknown system, one that cannot be made, or a recording that it cannot be given.
        TargetError: two targets of one name, or one that starts before the recording.
        BoxError: a box that lies off the sensor, or is too small to be followed.
    """
    system = system_named(name)
    settings = settings or Settings()
    targets = unique_targets(starts)
    _check_starts(recording, targets, settings)
    given = recording if from_ns is None else since(recording, from_ns)
    if not isinstance(system, (PictureSystem, EventSystem)):
        # To the engine a scene at rest in the middle would be one before its first event.
        starts = targets if from_ns is None else _from_first_event(given, targets, settings)
        return _run_engine(system, given, starts, settings, threads=threads)
    for target in targets:
        target.box.check_start(f"box of target {target.name!r}")
        target.box.check(recording.width, recording.height, f"box of target {target.name!r}")
    if system.feed == "video" and next(iter(recording.images()), None) is None:
        msg = (
            f"system {name!r} needs video, and the recording holds no images: record the camera's frames too, or "
            "choose a system that is fed with events"
        )
        raise CompareError(msg)
    if isinstance(system, PictureSystem):
        return _run_on_pictures(system, given, targets, settings, seed)
    return _run_on_events(system, given, targets, settings, seed)


def check_named_models(names: Iterable[str], settings: Settings) -> None:
    """Try systems with the model files that the settings name, if any, so that a wrong one is told before the work.

    Raises:
        CompareError: an unknown system, or one that cannot use its file.
        RecoveryError: a method of the engine whose recovery cannot.
    """
    if not settings.recovery.names_model:
        return
    for name in names:
        system = system_named(name)
        if isinstance(system, (PictureSystem, EventSystem)):
            system.maker(settings, 0)
        elif method_named(name).recovers:
            make_recovery(settings.recovery)


def _run_engine(
    system: System, recording: EventSource, targets: Sequence[TargetStart], settings: Settings, *, threads: bool
) -> Generator[SystemStep, None, None]:
    stopwatch = Stopwatch()
    batches = recording.streams(settings.stream)
    given = batches if threads else stopwatch.waiting(batches)
    with closing(track(given, targets, method=system.name, settings=settings, threads=threads)) as steps:
        for step, seconds in stopwatch.steps(steps):
            yield SystemStep(step.frame.stamp_ns, step.frame.data, step.reports, seconds)


def _run_on_pictures(
    system: PictureSystem, recording: EventSource, targets: Sequence[TargetStart], settings: Settings, seed: int
) -> Generator[SystemStep, None, None]:
    make = system.maker(settings, seed)
    followed = [_OnPictures(target, make) for target in targets]
    stopwatch = Stopwatch()

    def steps() -> Iterator[SystemStep]:
        for given in _pictures(system, recording, settings, stopwatch):
            reports = tuple(target.take(given) for target in followed)
            yield SystemStep(given.stamp_ns, given.shown, reports, 0.0)

    for step, seconds in stopwatch.steps(steps()):
        yield dataclasses.replace(step, seconds=seconds)


def _pictures(system: System, recording: EventSource, settings: Settings, stopwatch: Stopwatch) -> Iterator[Given]:
    if system.feed == "video":
        images = stopwatch.waiting(recording.images())
        return video_pictures(images, recording.width, recording.height, system.name)
    batches = stopwatch.waiting(one_stream(recording.streams(settings.stream), system.name))
    return PICTURES_OF_EVENTS[system.feed](batches, settings)


class _OnPictures:
    """A target that a picture tracker follows, once it has started."""

    def __init__(self, target: TargetStart, make: Callable[[], PictureTracker]) -> None:
        self._target = target
        self._tracker = make()
        self._has_started = False
        self._before: Given | None = None

    def take(self, given: Given) -> TargetReport:
        """Where it is in the next picture."""
        if given.stamp_ns < self._target.stamp_ns:
            self._before = given
            return TargetReport(self._target.name, TargetState.IDLE, None, 0.0)
        answer = self._tracker.update(given.picture) if self._has_started else self._started(given)
        return _report(self._target.name, answer)

    def _started(self, given: Given) -> Answer:
        """The answer on the first picture at or after the start's stamp."""
        self._has_started = True
        before, self._before = self._before, None
        stamp_ns, box = self._target.stamp_ns, self._target.box
        if before is not None and stamp_ns - before.stamp_ns < given.stamp_ns - stamp_ns:
            self._tracker.start(before.picture, box)
            return self._tracker.update(given.picture)
        self._tracker.start(given.picture, box)
        return Answer(box, GIVEN_SCORE)


def _report(name: str, answer: Answer) -> TargetReport:
    if answer.box is None:
        return TargetReport(name, TargetState.LOST, None, 0.0)
    return TargetReport(name, TargetState.TRACKING, answer.box, answer.score)


def _run_on_events(
    system: EventSystem, recording: EventSource, targets: Sequence[TargetStart], settings: Settings, seed: int
) -> Generator[SystemStep, None, None]:
    make = system.maker(settings, seed)
    followed = [_OnEvents(target, make) for target in targets]
    stopwatch = Stopwatch()
    batches = stopwatch.waiting(one_stream(recording.streams(settings.stream), system.name))
    seen = _SeenEvents(recording.width, recording.height)
    seconds = 0.0
    for (batch, stamps_ns), of_batch in stopwatch.steps(_answered(batches, followed)):
        seconds += of_batch
        seen.add(batch.events)
        for stamp_ns in stamps_ns:
            reports = tuple(target.report(stamp_ns) for target in followed)
            yield SystemStep(stamp_ns, seen.until(stamp_ns), reports, seconds / len(stamps_ns))
        seconds = 0.0 if stamps_ns else seconds


def _answered(batches: Iterable[StreamBatch], followed: Sequence[_OnEvents]) -> Iterator[tuple[StreamBatch, list[int]]]:
    """The batches with the times (ns), in order, at which targets have answered."""
    for batch in batches:
        yield batch, sorted({stamp_ns for target in followed for stamp_ns in target.take(batch.events)})


class _OnEvents:
    """A target that an event tracker follows."""

    def __init__(self, target: TargetStart, make: Callable[[], EventTracker]) -> None:
        self._name = target.name
        self._tracker = make()
        self._tracker.start(target.stamp_ns, target.box)
        self._answers: list[tuple[int, Answer]] = []

    def take(self, events: Events) -> list[int]:
        """The times (ns) of the answers that these events bring."""
        new = list(self._tracker.update(events))
        self._answers = [*self._answers[-1:], *new]
        return [stamp_ns for stamp_ns, _ in new]

    def report(self, stamp_ns: int) -> TargetReport:
        """Its last answer at a time (ns) that lies in the last events."""
        answers = [answer for answered_ns, answer in self._answers if answered_ns <= stamp_ns]
        if not answers:
            return TargetReport(self._name, TargetState.IDLE, None, 0.0)
        return _report(self._name, answers[-1])


class _SeenEvents:
    """The events between two steps as a frame to look at."""

    def __init__(self, width: int, height: int) -> None:
        self._shape = height, width, 2
        self._events: list[Events] = []

    def add(self, events: Events) -> None:
        """Take the next events."""
        self._events.append(events)

    def until(self, stamp_ns: int) -> npt.NDArray[np.uint8]:
        """Those up to a time (ns) that were not shown yet: uint8, shape (h, w, 2), 255 where there is one."""
        frame = np.zeros(self._shape, np.uint8)
        rest = []
        for events in self._events:
            count = int(np.searchsorted(events.t, stamp_ns, side="right"))
            frame[events.y[:count], events.x[:count], 1 - events.p[:count]] = 255
            if count < len(events):
                rest.append(events[count:])
        self._events = rest
        return frame


def _from_first_event(recording: EventSource, targets: Iterable[TargetStart], settings: Settings) -> list[TargetStart]:
    """The targets, those that start before the first event from there on."""
    first_ns = _first_event_ns(recording, settings)
    return [dataclasses.replace(target, stamp_ns=max(target.stamp_ns, first_ns)) for target in targets]


def _check_starts(recording: EventSource, targets: Iterable[TargetStart], settings: Settings) -> None:
    """Refuse targets that start before the recording, as the engine does.

    Raises:
        TargetError: a stamp on another clock, or too early.
    """
    first_ns = _first_event_ns(recording, settings)
    for target in targets:
        target.check_start(first_ns)


def _first_event_ns(recording: EventSource, settings: Settings) -> int:
    """Of a recording without events 0."""
    first = next(iter(recording.streams(settings.stream)), None)
    return 0 if first is None else int(first.events.t[0])
