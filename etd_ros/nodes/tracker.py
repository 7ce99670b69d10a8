"""`tracker`: frames and images in; boxes, states and an overlay out."""

from __future__ import annotations

import math
import time
from collections import OrderedDict, deque
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import Image

from etd_ros.cadence import Cadence
from etd_ros.nodes.base import EtdNode
from etd_ros.nodes.connections import Arrivals
from etd_ros.nodes.node_tracker import check_tracker, node_tracker
from etd_ros.nodes.running import run_node
from etd_ros.nodes.target_input import TargetInput
from etd_ros.nodes.target_topics import ResetService, TrackingOptions, TrackingOutput
from etd_ros.parameters import parameter
from etd_ros.tracking import MultiTracker, method_named
from msg_adapters import ImageMessage, Layout, Level, MessageError, decode_image

STAGES = ("detection", "tracking", "contours", "discovery", "recovery")
EARLY_IMAGES_MAX = 64
FLUSH_PERIOD_S = 0.1
FIRST_FRAME_MAX_NS = 1_000_000_000
"""How long before its stamp a stream's first frame may have begun: frames do not tell."""


@dataclass(frozen=True, slots=True)
class TrackerOptions(TrackingOptions):
    """Parameters of the tracker."""

    AT_ONCE: ClassVar[frozenset[str]] = TrackingOptions.AT_ONCE | {"image_wait_s"}

    image_wait_s: float = parameter(
        1.0, "longest wait for the intensity image of a frame before it is tracked without (s)", low=0.0, high=60.0
    )


class FramePairs:
    """Joins frames with the images of the same stamps, where there is to be one.

    A frame does not wait longer than `wait_s` seconds, and all that wait hold at most `max_bytes`: beyond it the oldest
    is tracked without its image.
    """

    def __init__(self, wait_s: float, max_bytes: int) -> None:
        self.frames_without_image = 0
        self.wait_s = wait_s
        self._max_bytes = max_bytes
        self._waiting_bytes = 0
        self._frames: deque[tuple[float, ImageMessage, bool]] = deque()
        self._images: OrderedDict[int, npt.NDArray[np.uint8]] = OrderedDict()

    def add_frame(self, frame: ImageMessage, received_s: float, *, has_image: bool = True) -> None:
        """A frame has come, at `received_s` (s, monotonic)."""
        self._frames.append((received_s, frame, has_image))
        self._waiting_bytes += frame.data.nbytes

    def add_image(self, image: ImageMessage) -> None:
        """An image has come, before or after its frame."""
        self._images[image.stamp_ns] = image.data
        while len(self._images) > EARLY_IMAGES_MAX:
            self._images.popitem(last=False)

    def pop(self, known_until_s: float) -> tuple[float, ImageMessage, npt.NDArray[np.uint8] | None] | None:
        """When the oldest frame that is ready was received (s, monotonic), the frame, and its image if there is one.

        Args:
            known_until_s: every image that came before this time (s, monotonic) has been added; -inf where that is
                not known, so that no frame is given up while its image may be waiting for a busy worker.
        """
        if not self._frames:
            return None
        received_s, frame, has_image = self._frames[0]
        image = self._images.pop(frame.stamp_ns, None) if has_image else None
        if has_image and image is None and not self._is_overdue(known_until_s - received_s):
            return None
        self._frames.popleft()
        self._waiting_bytes -= frame.data.nbytes
        self.frames_without_image += has_image and image is None
        return received_s, frame, image

    def _is_overdue(self, waited_s: float) -> bool:
        """Images come in the frames' order: one of a later frame says that this one's will not come."""
        later_has_image = any(later.stamp_ns in self._images for _, later, _ in list(self._frames)[1:])
        is_too_much = self._waiting_bytes > self._max_bytes
        return later_has_image or is_too_much or self.wait_s == 0 or waited_s >= self.wait_s


class Tracker(EtdNode):
    """Tracks the targets of its parameters and of `~/targets` on `accumulator/frames`."""

    def __init__(self) -> None:
        super().__init__("tracker", STAGES, TrackerOptions)

    def configure(self) -> None:
        """Make what does not wait for a frame to tell the sensor's size."""
        check_tracker(self)
        method = method_named(self.options.method)
        self._recovers = method.recovers
        self._cadence = Cadence(method.image_interval_s)
        self._targets = TargetInput(self)
        self._output = TrackingOutput(self)
        self._pairs = FramePairs(0.0, int(self.options.queue_mib * 2**20))
        self._tracker: MultiTracker | None = None
        self._size = (0, 0)
        self._stamp_ns = -math.inf
        self._steps_back = 0
        self._frames = self._images = Arrivals()

    def activate(self) -> None:
        """Begin to read."""
        self._targets.open()
        self._frames = self.needed_reader(
            Image, "accumulator/frames", "start `ros2 run etd_ros accumulator`", self._on_frame
        )
        if self._recovers:
            self._images = self.needed_reader(
                Image,
                "reconstruction/image_raw",
                "start `ros2 run etd_ros reconstruction`",
                self._on_image,
                is_optional=True,
            )
        ResetService(self, self._forget)
        self.every(FLUSH_PERIOD_S, self._flush)

    def cleanup(self) -> None:
        """End the log to the viewer."""
        self._output.close()

    def counts(self) -> dict[str, int]:
        """Counters whose rates are reported."""
        return {"frames": self._frames.messages, "images": self._images.messages, **self._output.counts()}

    def level(self) -> tuple[Level, str]:
        """As the targets fare."""
        return self._output.level()

    def diagnostics(self) -> dict[str, object]:
        """Figures for /diagnostics."""
        return {
            **super().diagnostics(),
            "frames received": self._frames.messages,
            "frames lost": self._frames.lost,
            "steps back in time": self._steps_back,
            "images received": self._images.messages,
            "images lost": self._images.lost,
            "frames without image": self._pairs.frames_without_image if self._recovers else 0,
            "targets": len(self._targets),
            **self._output.diagnostics(),
        }

    def missing(self) -> list[str]:
        """What the node waits for."""
        return [*super().missing(), *self._targets.missing()]

    def _on_frame(self, message: bytes, received_s: float) -> None:
        self.worker.submit(lambda data: self._take_frame(data, received_s), message)

    def _on_image(self, message: bytes, _: float) -> None:
        self.worker.submit(self._take_image, message)

    def _take_frame(self, message: bytes, received_s: float) -> None:
        frame = decode_image(message, Layout.ROS2)
        if frame.encoding != "8UC2":
            topic = self.resolve_topic_name("accumulator/frames")
            msg = f"{topic}: encoding {frame.encoding} is not 8UC2: remap it to frames"
            raise MessageError(msg)
        self._pairs.add_frame(frame, received_s, has_image=self._cadence.is_due(frame.stamp_ns))
        self._advance()

    def _take_image(self, message: bytes) -> None:
        self._pairs.add_image(decode_image(message, Layout.ROS2))
        self._advance()

    def _flush(self) -> None:
        """Frames whose image is overdue go on without; where nobody makes images, none is waited for."""
        has_images = self._recovers and self.count_publishers(self.resolve_topic_name("reconstruction/image_raw")) > 0
        self._pairs.wait_s = self.options.image_wait_s if has_images else 0.0
        now_s = time.monotonic()
        self.request(lambda: self._advance(now_s))

    def _forget(self) -> None:
        self._tracker = None

    def _advance(self, known_until_s: float = -math.inf) -> None:
        while (pair := self._pairs.pop(known_until_s)) is not None:
            self._track(*pair)

    def _track(self, received_s: float, frame: ImageMessage, image: npt.NDArray[np.uint8] | None) -> None:
        if frame.stamp_ns < self._stamp_ns:
            self._steps_back += 1
            self.warn(f"{self.resolve_topic_name('accumulator/frames')}: time went back, and the stream starts anew")
        self._stamp_ns = frame.stamp_ns
        height, width = frame.data.shape[:2]
        if self._tracker is None or (width, height) != self._size:
            self._size = (width, height)
            self._tracker = node_tracker(self, width, height)
            self._targets.start_all(self._tracker, frame.stamp_ns, frame.stamp_ns - FIRST_FRAME_MAX_NS)
        self._targets.start_new(self._tracker, frame.stamp_ns)
        reports = self._tracker.update(frame.stamp_ns, frame.data, image)
        self._targets.note(frame.stamp_ns, self._tracker, reports)
        self._output.publish(
            frame.stamp_ns,
            frame.frame_id,
            frame.data,
            image,
            reports,
            self._tracker.search_regions,
            self._targets.class_of,
        )
        self.latencies.note(received_s)


def main() -> int:
    """Entry point of `ros2 run etd_ros tracker`."""
    return run_node(Tracker)
