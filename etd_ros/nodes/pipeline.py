"""`pipeline`: accumulator, reconstruction and tracker in one process; events in, boxes out."""

from __future__ import annotations

import math
import time
from concurrent.futures import Future
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import Image

from etd_ros.conversion import Frame
from etd_ros.engine import FrameSource, ImageSource, Part, SearchRegions, nzge_interval
from etd_ros.longest_frames import LongestFrames
from etd_ros.nodes.base import EtdNode
from etd_ros.nodes.event_input import EventInput
from etd_ros.nodes.figures import FrameFigures
from etd_ros.nodes.life_cycle import Phase
from etd_ros.nodes.node_tracker import check_tracker, node_tracker
from etd_ros.nodes.running import run_node
from etd_ros.nodes.target_input import TargetInput
from etd_ros.nodes.target_topics import ResetService, TrackingOptions, TrackingOutput
from etd_ros.nodes.worker import Inline, Relay, Task
from etd_ros.per_sensor import PerSensor
from etd_ros.settings import STAGES
from etd_ros.stream import StreamBatch
from etd_ros.tracking import MultiTracker, method_named
from msg_adapters import EventMessage, Level, encode_image

Image8 = npt.NDArray[np.uint8]
PendingImage = Future[Image8 | None]
"""An intensity image, uint8 of shape (height, width), that is being made; None where that fails."""
PARTS_AHEAD = 2
"""Frames that may wait for reconstruction, and as many for the tracker."""
LONGER_FRAMES = ((0.1, 0.004), (0.05, 0.002), (0.0, 0.0))
"""When a message has taken this share of what `queue_s` allows, the next frames last at least so long (s): fewer of
them rather than lost ones."""
IMAGES_SHARE = 0.1
"""A message that is this late is left out of the images, whose making takes as long as all the rest, where the method
looks at one now and then: they serve to remember targets and to find what is lost or has drifted."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a frame comes from.

    Attributes:
        frame_id: of the message that finished it.
        received_s: when that message was received (s, monotonic).
    """

    frame_id: str
    received_s: float


class Pipeline(EtdNode):
    """Decodes events once and hands frames over without serialisation; publishes only what somebody reads.

    Three threads: the worker decodes and converts, so that it takes a fast camera's events as they come, one
    reconstructs, one tracks and publishes, which waits for the images that it looks at. Where NZGE is measured in the
    targets' search regions, the worker does it all.
    """

    def __init__(self) -> None:
        super().__init__("pipeline", tuple(STAGES), TrackingOptions)
        self._input = EventInput(self, self._on_events)

    def configure(self) -> None:
        """Make the stages, each for a thread of its own."""
        check_tracker(self)
        method = self._method = method_named(self.options.method)
        self._regions, self._longest = SearchRegions(), LongestFrames()
        self._frame_sources = PerSensor(
            lambda w, h: FrameSource(
                method.conversion, w, h, self.settings, self._regions, method.image_interval_s, self._longest
            )
        )
        self._image_sources = PerSensor(lambda w, h: ImageSource(w, h, self.settings))
        self._events_not_imaged = 0
        self._figures = FrameFigures(nzge_interval(method.conversion, self.settings))
        self._tracker: MultiTracker | None = None
        self._tracker_shape = (0, 0)
        self._targets = TargetInput(self, self._in_tracking)
        self._output = TrackingOutput(self)
        self._frames = self.publisher(Image, "~/frames")
        self._images = self.publisher(Image, "~/image_raw")

    def activate(self) -> None:
        """Begin to read; start the threads, after all that may fail and would leave them behind."""
        self._targets.open()
        ResetService(self, lambda: self._in_tracking(self._forget))
        self._input.open()
        self._longest.open()
        self._imaging = self._stage("pipeline_imaging")
        self._tracking = self._stage("pipeline_tracking")

    def deactivate(self) -> None:
        """Read no more, and end the threads. The tracking waits for the imaging, so it ends first."""
        self._input.close()
        self._longest.close()
        self._tracking.stop()
        self._imaging.stop()

    def cleanup(self) -> None:
        """End the log to the viewer."""
        self._output.close()

    def change(self, stages: set[str]) -> None:
        """From the next message on."""
        self._figures.interval = nzge_interval(self._method.conversion, self.settings)
        self.request(lambda: self._input.use(self.settings))
        if stages & {"noise_filter", "atsltd", "fixed_window", "fixed_count"}:
            self.request(self._frame_sources.forget)
        if "reconstruction" in stages:
            self.request(lambda: self._in_imaging(self._image_sources.forget))

    def is_wanted(self) -> bool:
        """Whether somebody reads what it makes."""
        return bool(
            self._output.subscribers or self._frames.get_subscription_count() or self._images.get_subscription_count()
        )

    def counts(self) -> dict[str, int]:
        """Counters whose rates are reported."""
        return {**self._input.counts(), "frames": self._figures.frames, **self._output.counts()}

    def losses(self) -> int:
        """How much went wrong so far."""
        return super().losses() + self._input.losses()

    def level(self) -> tuple[Level, str]:
        """As the targets fare."""
        return self._output.level()

    def diagnostics(self) -> dict[str, object]:
        """Figures for /diagnostics."""
        return {
            **super().diagnostics(),
            **self._input.diagnostics(),
            **self._figures.diagnostics(),
            "events left out of images": self._events_not_imaged,
            "targets": len(self._targets),
            **self._output.diagnostics(),
        }

    def _stage(self, name: str) -> Relay | Inline:
        """A thread, except where each frame waits for the boxes of the last one."""
        if self.settings.atsltd.follows_targets:
            return Inline(self.on_worker_error)
        return Relay(name, PARTS_AHEAD, self.on_worker_error)

    def _in_imaging(self, task: Task) -> None:
        if self.phase is Phase.ACTIVE:
            self._imaging.submit(task)
        else:
            task()

    def _in_tracking(self, task: Task) -> None:
        if self.phase is Phase.ACTIVE:
            self._tracking.submit(task)
        else:
            task()

    def _forget(self) -> None:
        self._tracker = None

    def _on_events(self, message: EventMessage, batch: StreamBatch, received_s: float) -> None:
        origin = Origin(message.frame_id, received_s)
        source = self._frame_sources.at(batch)
        is_late = self._is_late_for_image(batch, received_s)
        if is_late:
            self._events_not_imaged += len(batch.events)
        for part in source.parts(batch):
            if part.frame is not None:
                self._figures.note(part.frame)
            self._hand_over(part, origin, is_imaged=self._method.recovers and not is_late)
            late_s = time.monotonic() - received_s
            source.last_at_least(next(s for share, s in LONGER_FRAMES if late_s >= share * self.options.queue_s))

    def _is_late_for_image(self, batch: StreamBatch, received_s: float) -> bool:
        # What starts a stream has to reach the images: those of the last one are not to be gone on with. What is
        # missing within a stream fades from them as all do.
        if batch.restart is not None or not self._method.image_interval_s:
            return False
        return bool(time.monotonic() - received_s >= IMAGES_SHARE * self.options.queue_s)

    def _hand_over(self, part: Part, origin: Origin, *, is_imaged: bool) -> None:
        frame, image = part.frame, None
        if is_imaged:
            image = PendingImage() if frame is not None and part.has_image else None
            self._imaging.submit(lambda: self._reconstruct(part, image))
        if frame is not None:
            self._tracking.submit(lambda: self._track(frame, image, origin))

    def _reconstruct(self, part: Part, pending: PendingImage | None) -> None:
        image = None
        try:
            image = self._image_sources.at(part.batch).take(part).image
        finally:
            if pending is not None:
                pending.set_result(image)

    def _track(self, frame: Frame, pending: PendingImage | None, origin: Origin) -> None:
        longest_s = math.inf
        try:
            longest_s = self._track_on(frame, pending.result() if pending is not None else None, origin)
        finally:
            self._longest.ask(longest_s)

    def _track_on(self, frame: Frame, image: Image8 | None, origin: Origin) -> float:
        """Track, and publish what is read; how long the next frames may last (s)."""
        frame_id = origin.frame_id
        height, width = shape = frame.data.shape[:2]
        if self._tracker is None or shape != self._tracker_shape:
            self._tracker = node_tracker(self, width, height)
            self._tracker_shape = shape
            self._targets.start_all(self._tracker, frame.stamp_ns, frame.start_ns)
        self._targets.start_new(self._tracker, frame.stamp_ns)
        reports = self._tracker.update(frame.stamp_ns, frame.data, image, frame.start_ns)
        if self.settings.atsltd.follows_targets:
            self._regions.boxes = self._tracker.search_regions()
        self._targets.note(frame.stamp_ns, self._tracker, reports)
        if self._frames.get_subscription_count():
            self._frames.publish(encode_image(frame.data, stamp_ns=frame.stamp_ns, frame_id=frame_id))
        if image is not None and self._images.get_subscription_count():
            self._images.publish(encode_image(image, stamp_ns=frame.stamp_ns, frame_id=frame_id))
        self._output.publish(
            frame.stamp_ns,
            frame_id,
            frame.data,
            image,
            reports,
            self._tracker.search_regions,
            self._targets.class_of,
            frame.nzge,
        )
        self.latencies.note(origin.received_s)
        return self._tracker.longest_frame_s()


def main() -> int:
    """Entry point of `ros2 run etd_ros pipeline`."""
    return run_node(Pipeline)
