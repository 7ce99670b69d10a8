"""`pipeline`: accumulator, reconstruction and tracker in one process; events in, boxes out."""

from __future__ import annotations

import sys

from sensor_msgs.msg import Image

from etd_ros.conversion import ENTROPY_TARGETS
from etd_ros.engine import FrameSource, ImageSource, Part, PerSensor, SearchRegions, make_tracker
from etd_ros.nodes.base import FRAME_QOS, EtdNode, run_node
from etd_ros.nodes.event_input import EventInput
from etd_ros.nodes.target_topics import ResetService, TargetInput, TrackingOptions, TrackingOutput
from etd_ros.nodes.worker import Inline, Relay
from etd_ros.settings import STAGES
from etd_ros.stream import StreamBatch
from etd_ros.tracking import MultiTracker, method_named
from msg_adapters import EventMessage, encode_image

PARTS_AHEAD = 8
"""Frames that may wait for reconstruction, and as many for the tracker."""


class Pipeline(EtdNode):
    """Decodes events once and hands frames over without serialisation; publishes only what somebody reads.

    Three threads: the worker decodes and converts, so that it takes a fast camera's events as they come, the next one
    reconstructs, the last one tracks and publishes. Where NZGE is measured in the targets' search regions, the worker
    does it all.
    """

    def __init__(self) -> None:
        super().__init__("pipeline", tuple(STAGES), TrackingOptions)
        make_tracker(self.options.method, 1, 1, self.settings)
        method = method_named(self.options.method)
        self._imaging = self._stage("pipeline_imaging")
        self._tracking = self._stage("pipeline_tracking")
        self._regions = SearchRegions()
        self._recovers = method.recovers
        self._frame_sources = PerSensor(lambda w, h: FrameSource(method.conversion, w, h, self.settings, self._regions))
        self._image_sources = PerSensor(lambda w, h: ImageSource(w, h, self.settings))
        self._tracker: MultiTracker | None = None
        self._tracker_shape = (0, 0)
        self._targets = TargetInput(self, self._tracking.submit)
        self._output = TrackingOutput(self)
        self._frames = self.create_publisher(Image, "~/frames", FRAME_QOS)
        self._images = self.create_publisher(Image, "~/image_raw", FRAME_QOS)
        self._reset = ResetService(self, lambda _: self._tracking.submit(self._forget))
        self._input = EventInput(self, self._on_events, self._wanted)

    def _stage(self, name: str) -> Relay | Inline:
        """A thread, except where each frame waits for the boxes of the last one."""
        if self.settings.atsltd.entropy_region == ENTROPY_TARGETS:
            return Inline(self._on_worker_error)
        return Relay(name, PARTS_AHEAD, self._on_worker_error)

    def diagnostics(self) -> dict[str, object]:
        """Figures for /diagnostics."""
        return {
            **super().diagnostics(),
            **self._input.diagnostics(),
            "reading events": self._input.subscribed,
            "targets": len(self._targets),
            **self._output.diagnostics(),
        }

    def stop(self) -> None:
        """End the threads, the last one first: an earlier one may be waiting for it."""
        self._tracking.stop()
        self._imaging.stop()
        super().stop()
        self._output.close()

    def _wanted(self) -> bool:
        return bool(
            self._output.subscribers or self._frames.get_subscription_count() or self._images.get_subscription_count()
        )

    def _forget(self) -> None:
        self._tracker = None

    def _on_events(self, message: EventMessage, batch: StreamBatch) -> None:
        for part in self._frame_sources.at(batch).parts(batch):
            self._hand_over(part, message.frame_id)

    def _hand_over(self, part: Part, frame_id: str) -> None:
        if self._recovers:
            self._imaging.submit(lambda: self._reconstruct(part, frame_id))
        elif part.frame is not None:
            self._tracking.submit(lambda: self._track(part, frame_id))

    def _reconstruct(self, part: Part, frame_id: str) -> None:
        imaged = self._image_sources.at(part.batch).take(part)
        if imaged.frame is not None:
            self._tracking.submit(lambda: self._track(imaged, frame_id))

    def _track(self, part: Part, frame_id: str) -> None:
        frame, image = part.frame, part.image
        assert frame is not None
        height, width = shape = frame.data.shape[:2]
        if self._tracker is None or shape != self._tracker_shape:
            self._tracker = make_tracker(
                self.options.method, width, height, self.settings, clicks=True, auto=self.options.auto
            )
            self._tracker_shape = shape
            self._targets.start_all(self._tracker, frame.start_ns)
        self._targets.start_new(self._tracker)
        reports = self._tracker.update(frame.stamp_ns, frame.data, image)
        regions = self._regions.boxes = self._tracker.search_regions()
        self._targets.say_notices(self._tracker)
        if self._frames.get_subscription_count():
            self._frames.publish(encode_image(frame.data, stamp_ns=frame.stamp_ns, frame_id=frame_id))
        if image is not None and self._images.get_subscription_count():
            self._images.publish(encode_image(image, stamp_ns=frame.stamp_ns, frame_id=frame_id))
        self._output.publish(frame.stamp_ns, frame_id, frame.data, image, reports, regions, frame.nzge)


def main() -> int:
    """Entry point of `ros2 run etd_ros pipeline`."""
    return run_node(Pipeline)


if __name__ == "__main__":
    sys.exit(main())
