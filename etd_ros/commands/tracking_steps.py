"""What `track` writes, draws and logs, step by step, whichever system made it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from etd_ros.commands.progress import with_image_progress, with_progress
from etd_ros.engine import track
from etd_ros.recordings.interface import RecordedImage, Recording
from etd_ros.settings import Settings
from etd_ros.stream import StreamBatch, StreamConfig
from etd_ros.systems.running import run_system
from etd_ros.targets import TargetStart
from etd_ros.tracking import Click, TargetReport

VERB = "tracking"


@dataclass(frozen=True, slots=True)
class TrackedStep:
    """A step of any system.

    Attributes:
        stamp_ns: its time (ns).
        picture: what the system saw, uint8, shape (h, w), (h, w, 2) or (h, w, 3), as in `SystemStep`.
        reports: the targets' states.
        image: the engine's intensity image at the frame's stamp, uint8, shape (h, w), where its method recovers.
        notices: what the engine has to say of clicks that start nothing.
        waiting_clicks: the names of those that have started nothing yet.
        nzge: of the engine's frame; None for other systems.
    """

    stamp_ns: int
    picture: npt.NDArray[np.uint8]
    reports: tuple[TargetReport, ...]
    image: npt.NDArray[np.uint8] | None = None
    notices: tuple[str, ...] = ()
    waiting_clicks: tuple[str, ...] = ()
    nzge: float | None = None


@contextmanager
def engine_steps(
    recording: Recording,
    targets: Sequence[TargetStart],
    clicks: Sequence[Click],
    *,
    auto: bool,
    method: str,
    settings: Settings,
    searches: bool,
) -> Iterator[Iterator[TrackedStep]]:
    """The steps of one of the engine's methods; the arguments are those of `track`. Its thread ends with the context.

    Raises:
        EtdError: while iterating, as `track`.
    """
    with with_progress(recording.streams(settings.stream), VERB) as batches:
        made = track(batches, targets, clicks=clicks, auto=auto, method=method, settings=settings, searches=searches)
        with closing(made) as steps:
            yield (
                TrackedStep(
                    step.frame.stamp_ns,
                    step.frame.data,
                    step.reports,
                    step.image,
                    step.notices,
                    step.waiting_clicks,
                    step.frame.nzge,
                )
                for step in steps
            )


@contextmanager
def compared_steps(
    recording: Recording, targets: Sequence[TargetStart], system: str, settings: Settings
) -> Iterator[Iterator[TrackedStep]]:
    """The steps of a compared system.

    Raises:
        EtdError: at once or while iterating, as `run_system`.
    """
    with closing(run_system(system, _Watched(recording), targets, settings)) as steps:
        yield (TrackedStep(step.stamp_ns, step.picture, step.reports) for step in steps)


class _Watched:
    """A recording whose events and images are counted on a progress line as they are taken."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self.width, self.height = recording.width, recording.height

    def streams(self, config: StreamConfig | None = None) -> Iterator[StreamBatch]:
        with with_progress(self._recording.streams(config), VERB) as batches:
            yield from batches

    def images(self) -> Iterator[RecordedImage]:
        with with_image_progress(self._recording.images(), VERB) as images:
            yield from images
