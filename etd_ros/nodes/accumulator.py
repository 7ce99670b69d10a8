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

STAGES = ("stream", "noise_filter", "atsltd", "fixed_window", "fixed_count")


@dataclass(frozen=True, slots=True)
class AccumulatorOptions(NodeOptions):
    """Parameters of the accumulator."""

    conversion: str = parameter("atsltd", "how events become frames", choices=CONVERSIONS)


class Accumulator(EtdNode):
    """Publishes `~/frames` while somebody subscribes to it.

    With `atsltd.entropy_region: targets` it listens to the tracker: NZGE is measured round its last boxes.
    """

    def __init__(self) -> None:
        super().__init__("accumulator", STAGES, AccumulatorOptions)
        self._frames = self.create_publisher(Image, "~/frames", FRAME_QOS)
        self._regions = SearchRegions()
        self._sources = PerSensor(lambda w, h: FrameSource(self.options.conversion, w, h, self.settings, self._regions))
        if self.settings.atsltd.entropy_region == ENTROPY_TARGETS:
            self._boxes = self.create_subscription(
                Detection2DArray, "tracker/detections", self._on_boxes, FRAME_QOS, raw=True
            )
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
            "reading events": self._input.subscribed,
            "frame subscribers": self._frames.get_subscription_count(),
        }

    def _on_boxes(self, message: bytes) -> None:
        self.worker.submit(self._take_boxes, message)

    def _take_boxes(self, message: bytes) -> None:
        scale = self.settings.detection.search_scale
        boxes = [detection.box.scaled(scale) for detection in decode_detections(message).detections]
        self._regions.boxes = boxes or None

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
