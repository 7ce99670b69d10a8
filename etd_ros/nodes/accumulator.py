"""`accumulator`: events in, ATSLTD frames out (sensor_msgs/Image 8UC2, On and Off, stamped with their end)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sensor_msgs.msg import Image
from vision_msgs.msg import Detection2DArray

from etd_ros.boxes import Box
from etd_ros.engine import CONVERSIONS, FrameSource, SearchRegions, nzge_interval
from etd_ros.nodes.base import EtdNode
from etd_ros.nodes.event_input import EventInput
from etd_ros.nodes.figures import FrameFigures
from etd_ros.nodes.node_parameters import NodeOptions
from etd_ros.nodes.running import run_node
from etd_ros.parameters import parameter
from etd_ros.per_sensor import PerSensor
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
        self._input = EventInput(self, self._on_events)

    def configure(self) -> None:
        """Make the converters."""
        self._frames = self.publisher(Image, "~/frames")
        self._regions = SearchRegions()
        self._sources = PerSensor(lambda w, h: FrameSource(self.options.conversion, w, h, self.settings, self._regions))
        self._figures = FrameFigures(nzge_interval(self.options.conversion, self.settings))

    def activate(self) -> None:
        """Begin to read."""
        self._input.open()
        if self.settings.atsltd.follows_targets:
            self._region_input = self.reader(Detection2DArray, "tracker/search_regions", self._on_regions)
            self.every(TRACKER_CHECK_PERIOD_S, self._check_tracker)

    def deactivate(self) -> None:
        """Read no more."""
        self._input.close()

    def change(self, stages: set[str]) -> None:
        """From the next message on."""
        self._figures.interval = nzge_interval(self.options.conversion, self.settings)
        self.request(lambda: self._input.use(self.settings))
        if stages - {"stream"}:
            self.request(self._sources.forget)

    def is_wanted(self) -> bool:
        """Whether somebody reads what it makes."""
        return self._frames.get_subscription_count() > 0

    def counts(self) -> dict[str, int]:
        """Counters whose rates are reported."""
        return {**self._input.counts(), "frames": self._figures.frames}

    def losses(self) -> int:
        """How much went wrong so far."""
        return super().losses() + self._input.losses()

    def diagnostics(self) -> dict[str, object]:
        """Figures for /diagnostics."""
        return {
            **super().diagnostics(),
            **self._input.diagnostics(),
            **self._figures.diagnostics(),
            "search regions": len(self._regions.boxes or ()),
            "frame subscribers": self._frames.get_subscription_count(),
        }

    def _on_regions(self, message: bytes) -> None:
        self.worker.submit_request(self._take_regions, message)

    def _take_regions(self, message: bytes) -> None:
        boxes = [detection.box for detection in decode_detections(message).detections]
        regions = [box for box in boxes if _is_region(box)]
        self._regions.boxes = regions or None
        if wrong := len(boxes) - len(regions):
            self.errors += wrong
            self.warn(
                f"{self._region_input.topic_name}: {wrong} box(es) are left out, as their edges are not finite or hold "
                f"no area: remap it to the tracker's search regions ({self.errors} so far)"
            )

    def _check_tracker(self) -> None:
        """A tracker that is gone does not look anywhere any more."""
        if self.count_publishers(self._region_input.topic_name) == 0:
            self.request(self._forget_regions)

    def _forget_regions(self) -> None:
        self._regions.boxes = None

    def _on_events(self, message: EventMessage, batch: StreamBatch, received_s: float) -> None:
        for frame in self._sources.at(batch).frames(batch.events):
            self._figures.note(frame)
            self._frames.publish(encode_image(frame.data, stamp_ns=frame.stamp_ns, frame_id=message.frame_id))
            self.latencies.note(received_s)


def _is_region(box: Box) -> bool:
    """Whether a box has finite edges and an area; how much of it is on the sensor does not matter."""
    edges = (box.x, box.y, box.x + box.w, box.y + box.h)
    return all(map(math.isfinite, edges)) and box.w > 0 and box.h > 0


def main() -> int:
    """Entry point of `ros2 run etd_ros accumulator`."""
    return run_node(Accumulator)
