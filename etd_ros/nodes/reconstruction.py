"""`reconstruction`: events in, intensity images out (sensor_msgs/Image mono8) at the stamps of the frames."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from sensor_msgs.msg import Image

from etd_ros.cadence import Cadence
from etd_ros.nodes.base import EtdNode
from etd_ros.nodes.connections import Arrivals
from etd_ros.nodes.event_input import EventInput
from etd_ros.nodes.node_parameters import NodeOptions
from etd_ros.nodes.running import run_node
from etd_ros.parameters import parameter
from etd_ros.reconstruction import HighPassFilter, SynchronisedReconstruction
from etd_ros.stream import StreamBatch
from etd_ros.tracking import DEFAULT_METHOD, METHODS
from msg_adapters import EventMessage, MessageError, decode_image, encode_image

STAGES = ("stream", "reconstruction")
EARLY_STAMPS_MAX = 1000


@dataclass(frozen=True, slots=True)
class ReconstructionOptions(NodeOptions):
    """Parameters of the reconstruction."""

    image_interval_s: float = parameter(
        METHODS[DEFAULT_METHOD].image_interval_s,
        "the first frame in each such interval (s) has an image; 0: every frame, as etd and etd-ftw need it",
        low=0.0,
        high=60.0,
    )


class Reconstruction(EtdNode):
    """Publishes `~/image_raw` while somebody subscribes to it; reads `accumulator/frames` for their stamps alone."""

    def __init__(self) -> None:
        super().__init__("reconstruction", STAGES, ReconstructionOptions)
        self._input = EventInput(self, self._on_events)

    def configure(self) -> None:
        """Start without a filter: the first event tells the sensor's size."""
        self._images = self.publisher(Image, "~/image_raw")
        self._reconstruction: SynchronisedReconstruction | None = None
        self._size = (0, 0)
        self._cadence = Cadence(self.options.image_interval_s)
        self._frame_id = ""
        self._frames = Arrivals()
        self._early_stamps: deque[int] = deque(maxlen=EARLY_STAMPS_MAX)
        self._received_s = 0.0
        self._stamps = 0
        self._published = 0

    def activate(self) -> None:
        """Begin to read."""
        self._input.open()
        self._frames = self.needed_reader(
            Image, "accumulator/frames", "start `ros2 run etd_ros accumulator`", self._on_frame
        )

    def deactivate(self) -> None:
        """Read no more."""
        self._input.close()

    def change(self, stages: set[str]) -> None:
        """From the next message on."""
        self.request(lambda: self._input.use(self.settings))
        if "reconstruction" in stages:
            self.request(self._forget)

    def is_wanted(self) -> bool:
        """Whether somebody reads the images."""
        return self._images.get_subscription_count() > 0

    def counts(self) -> dict[str, int]:
        """Counters whose rates are reported."""
        return {**self._input.counts(), "stamps": self._stamps, "images": self._published}

    def losses(self) -> int:
        """How much went wrong so far."""
        return super().losses() + self._input.losses()

    def diagnostics(self) -> dict[str, object]:
        """Figures for /diagnostics."""
        held = self._reconstruction
        return {
            **super().diagnostics(),
            **self._input.diagnostics(),
            "stamps": self._stamps,
            "stamps lost": self._frames.lost,
            "images": self._published,
            "stamps given up": held.requests_dropped if held else 0,
            "events integrated before their stamp": held.integrated_early if held else 0,
            "image subscribers": self._images.get_subscription_count(),
        }

    def _forget(self) -> None:
        self._reconstruction = None

    def _on_frame(self, message: bytes, _: float) -> None:
        self._stamps += 1
        try:
            stamp_ns = decode_image(message).stamp_ns
        except MessageError as err:
            self.count_error(err)
            return
        if self._cadence.is_due(stamp_ns):
            # The pixels are not queued: they would take the events' room.
            self.request(lambda: self._on_stamp(stamp_ns))

    def _on_stamp(self, stamp_ns: int) -> None:
        if self._reconstruction is None:
            self._early_stamps.append(stamp_ns)
        else:
            self._reconstruction.request(stamp_ns)
            self._publish_ready()

    def _on_events(self, message: EventMessage, batch: StreamBatch, received_s: float) -> None:
        events = batch.events
        self._received_s = received_s
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
            self.latencies.note(self._received_s)


def main() -> int:
    """Entry point of `ros2 run etd_ros reconstruction`."""
    return run_node(Reconstruction)
