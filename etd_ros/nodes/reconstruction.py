"""`reconstruction`: events in, intensity images out (sensor_msgs/Image mono8) at the stamps of the frames."""

from __future__ import annotations

import sys
from collections import deque

from sensor_msgs.msg import Image

from etd_ros.nodes.base import FRAME_QOS, EtdNode, Input, NodeOptions, run_node
from etd_ros.nodes.event_input import EventInput
from etd_ros.reconstruction import HighPassFilter, SynchronisedReconstruction
from etd_ros.stream import StreamBatch
from msg_adapters import EventMessage, MessageError, decode_image, encode_image

STAGES = ("stream", "reconstruction")
EARLY_STAMPS_MAX = 1000


class Reconstruction(EtdNode):
    """Publishes `~/image_raw` while somebody subscribes to it; reads `accumulator/frames` for their stamps alone."""

    def __init__(self) -> None:
        super().__init__("reconstruction", STAGES, NodeOptions)
        self._images = self.create_publisher(Image, "~/image_raw", FRAME_QOS)
        self._reconstruction: SynchronisedReconstruction | None = None
        self._size = (0, 0)
        self._frame_id = ""
        self._early_stamps: deque[int] = deque(maxlen=EARLY_STAMPS_MAX)
        self._stamps = 0
        self._published = 0
        self._events = EventInput(self, self._on_events, self._wanted)
        self._frames = self.create_subscription(Image, "accumulator/frames", self._on_frame, FRAME_QOS, raw=True)
        self.add_input(
            Input(
                topic=self._frames.topic_name,
                type_name="sensor_msgs/msg/Image",
                qos="reliable",
                provider="start `ros2 run etd_ros accumulator`",
                messages=lambda: self._stamps,
                wanted=self._wanted,
            )
        )

    def diagnostics(self) -> dict[str, object]:
        """Figures for /diagnostics."""
        held = self._reconstruction
        return {
            **super().diagnostics(),
            **self._events.diagnostics(),
            "stamps": self._stamps,
            "images": self._published,
            "events integrated before their stamp": held.integrated_early if held else 0,
            "reading events": self._events.subscribed,
            "image subscribers": self._images.get_subscription_count(),
        }

    def _wanted(self) -> bool:
        return self._images.get_subscription_count() > 0

    def _on_frame(self, message: bytes) -> None:
        self._stamps += 1
        try:
            stamp_ns = decode_image(message).stamp_ns
        except MessageError as err:
            self.count_error(err)
            return
        # The pixels are not queued: they would take the events' room.
        self.worker.submit(lambda _: self._on_stamp(stamp_ns), b"")

    def _on_stamp(self, stamp_ns: int) -> None:
        if self._reconstruction is None:
            self._early_stamps.append(stamp_ns)
        else:
            self._reconstruction.request(stamp_ns)
            self._publish_ready()

    def _on_events(self, message: EventMessage, batch: StreamBatch) -> None:
        events = batch.events
        self._frame_id = message.frame_id
        if self._reconstruction is None or (events.width, events.height) != self._size:
            self._size = (events.width, events.height)
            self._reconstruction = SynchronisedReconstruction(HighPassFilter(*self._size, self.settings.reconstruction))
            for stamp_ns in self._early_stamps:
                self._reconstruction.request(stamp_ns)
            self._early_stamps.clear()
        elif batch.restart is not None:
            self._reconstruction.reset()
        self._reconstruction.push(events)
        self._publish_ready()

    def _publish_ready(self) -> None:
        assert self._reconstruction is not None
        for stamp_ns, image in self._reconstruction.ready():
            self._published += 1
            self._images.publish(encode_image(image, stamp_ns=stamp_ns, frame_id=self._frame_id))


def main() -> int:
    """Entry point of `ros2 run etd_ros reconstruction`."""
    return run_node(Reconstruction)


if __name__ == "__main__":
    sys.exit(main())
