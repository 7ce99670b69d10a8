"""`accumulator`: events in, ATSLTD frames out (sensor_msgs/Image 8UC2, On and Off, stamped with their end)."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from sensor_msgs.msg import Image
from vision_msgs.msg import Detection2DArray

from etd_ros.conversion import ENTROPY_TARGETS, FrameEnd
from etd_ros.engine import CONVERSIONS, FrameSource, PerSensor, SearchRegions
from etd_ros.nodes.base import FRAME_QOS, EtdNode, NodeOptions, run_node
from etd_ros.nodes.event_input import EventInput
from etd_ros.parameters import parameter
from etd_ros.stream import StreamBatch
from msg_adapters import EventMessage, decode_detections, encode_image

TRACKER_CHECK_PERIOD_S = 1.0
STAGES = ("stream", "noise_filter", "atsltd", "fixed_window", "fixed_count")


@dataclass(frozen=True, slots=True)
class AccumulatorOptions(NodeOptions):
    """Parameters of the accumulator."""

    conversion: str = parameter(
        "atsltd_fine", "how events become frames: atsltd_fine for etd-plus", choices=CONVERSIONS
    )


class Accumulator(EtdNode):
    """Publishes `~/frames` while somebody subscribes to it.

    With `atsltd.entropy_region: targets` it listens to the tracker: NZGE is measured where that looks next.
    """

    def __init__(self) -> None:
        super().__init__("accumulator", STAGES, AccumulatorOptions)
        self._frames = self.create_publisher(Image, "~/frames", FRAME_QOS)
        self._regions = SearchRegions()
        self._sources = PerSensor(lambda w, h: FrameSource(self.options.conversion, w, h, self.settings, self._regions))
        if self.settings.atsltd.entropy_region == ENTROPY_TARGETS:
            self._region_input = self.create_subscription(
                Detection2DArray, "tracker/search_regions", self._on_regions, FRAME_QOS, raw=True
            )
            self._tracker_timer = self.every(TRACKER_CHECK_PERIOD_S, self._check_tracker)
        self._finished = dict.fromkeys(FrameEnd, 0)
        self._last_nzge = 0.0
        self._input = EventInput(self, self._on_events, lambda: self._frames.get_subscription_count() > 0)

    def diagnostics(self) -> dict[str, object]:
        """Figures for /diagnostics."""
        return {
            **super().diagnostics(),
            **self._input.diagnostics(),
            **{f"frames ended by {end.value}": count for end, count in self._finished.items()},
            "frames": sum(self._finished.values()),
            "last NZGE": f"{self._last_nzge:.4f}",
            "search regions": len(self._regions.boxes or ()),
            "reading events": self._input.subscribed,
            "frame subscribers": self._frames.get_subscription_count(),
        }

    def _on_regions(self, message: bytes) -> None:
        self.worker.submit(self._take_regions, message)

    def _take_regions(self, message: bytes) -> None:
        self._regions.boxes = [detection.box for detection in decode_detections(message).detections] or None

    def _check_tracker(self) -> None:
        """A tracker that is gone does not look anywhere any more."""
        if self.count_publishers(self._region_input.topic_name) == 0:
            self.worker.submit(self._forget_regions, b"")

    def _forget_regions(self, _: bytes) -> None:
        self._regions.boxes = None

    def _on_events(self, message: EventMessage, batch: StreamBatch) -> None:
        for frame in self._sources.at(batch).frames(batch.events):
            self._finished[frame.end] += 1
            self._last_nzge = frame.nzge
            self._frames.publish(encode_image(frame.data, stamp_ns=frame.stamp_ns, frame_id=message.frame_id))


def main() -> int:
    """Entry point of `ros2 run etd_ros accumulator`."""
    return run_node(Accumulator)


if __name__ == "__main__":
    sys.exit(main())
