"""Listens to the nodes: records what they publish, joins boxes and states into tracks, and keeps the figures."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from diagnostic_msgs.msg import DiagnosticArray
from event_camera_msgs.msg import EventPacket
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image
from vision_msgs.msg import Detection2DArray

from etd_ros.boxes import Box
from etd_ros.nodes.base import EVENT_QOS, FRAME_QOS
from etd_ros.recordings.bag_writer import BagWriter
from etd_ros.tracking import TargetReport, TargetState
from msg_adapters import Layout, decode_detections, decode_diagnostics, decode_image

EVENTS = "/event_camera/events"
FRAMES = "/accumulator/frames"
IMAGES = "/reconstruction/image_raw"
DETECTIONS = "/tracker/detections"
STATUS = "/tracker/status"
DIAGNOSTICS = "/diagnostics"
PENDING_MAX = 256
RATE_PERIOD_S = 1.0


@dataclass(slots=True)
class _Pending:
    frame: npt.NDArray[np.uint8] | None = None
    image: npt.NDArray[np.uint8] | None = None
    boxes: dict[str, Box] | None = None
    states: dict[str, tuple[str, float]] | None = None


@dataclass(slots=True)
class Figures:
    """What the live table shows."""

    states: dict[str, str] = field(default_factory=dict)
    diagnostics: dict[str, dict[str, str]] = field(default_factory=dict)
    messages: dict[str, int] = field(default_factory=dict)
    last_data_s: float = field(default_factory=time.monotonic)
    """When a message other than diagnostics last came (s, monotonic)."""
    rates: dict[str, float] = field(default_factory=dict)
    """Messages per second of each topic, over the last second."""


@dataclass(frozen=True, slots=True)
class TrackedFrame:
    """Everything that belongs to one stamp."""

    stamp_ns: int
    frame: npt.NDArray[np.uint8]
    image: npt.NDArray[np.uint8] | None
    reports: tuple[TargetReport, ...]


class Monitor(Node):
    """Calls `on_frame` for each frame whose boxes and states have come."""

    def __init__(self, recorder: BagWriter, on_frame: Callable[[TrackedFrame], None]) -> None:
        super().__init__("monitor")
        self.figures = Figures()
        self._recorder = recorder
        self._on_frame = on_frame
        self._pending: OrderedDict[int, _Pending] = OrderedDict()
        self._rate_timer = self.create_timer(RATE_PERIOD_S, self._update_rates)
        self._counted: dict[str, int] = {}
        self._listeners = [
            self._listen(EVENTS, EventPacket, reliable=False),
            self._listen("/clock", Clock, reliable=False),
            self._listen(FRAMES, Image, self._take_frame),
            self._listen(IMAGES, Image, self._take_image),
            self._listen(DETECTIONS, Detection2DArray, self._take_detections),
            self._listen(STATUS, DiagnosticArray, self._take_status),
            self._listen(DIAGNOSTICS, DiagnosticArray, self._take_diagnostics),
        ]

    def figure(self, node: str, key: str) -> str:
        """A value of a node's diagnostics, empty while it has sent none."""
        return self.figures.diagnostics.get(node, {}).get(key, "")

    def _listen(
        self, topic: str, message_class: type, take: Callable[[bytes], None] | None = None, *, reliable: bool = True
    ) -> object:
        type_name = f"{message_class.__module__.split('.')[0]}/msg/{message_class.__name__}"
        self._recorder.add_topic(topic, type_name, reliable=reliable)
        self.figures.messages[topic] = 0

        def on_message(message: bytes) -> None:
            self._recorder.write(topic, time.time_ns(), message)
            self.figures.messages[topic] += 1
            if topic != DIAGNOSTICS:
                self.figures.last_data_s = time.monotonic()
            if take is not None:
                take(message)

        return self.create_subscription(
            message_class, topic, on_message, FRAME_QOS if reliable else EVENT_QOS, raw=True
        )

    def _update_rates(self) -> None:
        counts = {**self.figures.messages, "events": int(self.figure("accumulator", "events") or 0)}
        self.figures.rates = {
            name: (count - self._counted.get(name, 0)) / RATE_PERIOD_S for name, count in counts.items()
        }
        self._counted = counts

    def _at(self, stamp_ns: int) -> _Pending:
        pending = self._pending.setdefault(stamp_ns, _Pending())
        while len(self._pending) > PENDING_MAX:
            self._pending.popitem(last=False)
        return pending

    def _take_frame(self, message: bytes) -> None:
        frame = decode_image(message, Layout.ROS2)
        self._at(frame.stamp_ns).frame = frame.data
        self._hand_on(frame.stamp_ns)

    def _take_image(self, message: bytes) -> None:
        image = decode_image(message, Layout.ROS2)
        self._at(image.stamp_ns).image = image.data

    def _take_detections(self, message: bytes) -> None:
        decoded = decode_detections(message)
        self._at(decoded.stamp_ns).boxes = {item.id: item.box for item in decoded.detections}
        self._hand_on(decoded.stamp_ns)

    def _take_status(self, message: bytes) -> None:
        decoded = decode_diagnostics(message)
        values = [dict(status.values) for status in decoded.statuses]
        states = {value["target"]: (value["state"], float(value["score"])) for value in values}
        self._at(decoded.stamp_ns).states = states
        self.figures.states = {name: state for name, (state, _) in states.items()}
        self._hand_on(decoded.stamp_ns)

    def _take_diagnostics(self, message: bytes) -> None:
        for status in decode_diagnostics(message).statuses:
            self.figures.diagnostics[status.name] = dict(status.values)

    def _hand_on(self, stamp_ns: int) -> None:
        pending = self._pending[stamp_ns]
        if pending.frame is None or pending.boxes is None or pending.states is None:
            return
        reports = tuple(
            TargetReport(name, TargetState(state), pending.boxes.get(name), score)
            for name, (state, score) in pending.states.items()
        )
        self._on_frame(TrackedFrame(stamp_ns, pending.frame, pending.image, reports))
        del self._pending[stamp_ns]
