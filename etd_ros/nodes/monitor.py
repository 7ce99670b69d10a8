"""Listens to the nodes: records what they publish and keeps the figures of the live table."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticArray
from event_camera_msgs.msg import EventPacket
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image
from vision_msgs.msg import Detection2DArray

from etd_ros.nodes.connections import EVENT_QOS, LISTENER_QOS
from etd_ros.nodes.reading import MessageInfo, read_all
from etd_ros.nodes.recorded_tracks import DETECTIONS, FRAMES, IMAGES, STATUS
from etd_ros.recordings.bag_writer import BagWriter
from msg_adapters import decode_diagnostics

EVENTS = "/event_camera/events"
DIAGNOSTICS = "/diagnostics"
RATE_PERIOD_S = 1.0


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


class Monitor(Node):
    """Records every topic of the demo; only states and diagnostics are looked into, the rest stays bytes."""

    def __init__(self, recorder: BagWriter) -> None:
        super().__init__("monitor")
        self.figures = Figures()
        self._recorder = recorder
        self._rate_timer = self.create_timer(RATE_PERIOD_S, self._update_rates)
        self._counted: dict[str, int] = {}
        self._listeners = [
            self._listen(EVENTS, EventPacket, reliable=False),
            self._listen("/clock", Clock, reliable=False),
            self._listen(FRAMES, Image),
            self._listen(IMAGES, Image),
            self._listen(DETECTIONS, Detection2DArray),
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

        def on_message(message: bytes, info: MessageInfo) -> None:
            # Many of one topic may be taken before the first of another.
            self._recorder.write(topic, info["received_timestamp"], message)
            self.figures.messages[topic] += 1
            if topic != DIAGNOSTICS:
                self.figures.last_data_s = time.monotonic()
            if take is not None:
                take(message)

        return read_all(self, message_class, topic, on_message, LISTENER_QOS if reliable else EVENT_QOS)

    def _update_rates(self) -> None:
        counts = {**self.figures.messages, "events": int(self.figure("accumulator", "events") or 0)}
        self.figures.rates = {
            name: (count - self._counted.get(name, 0)) / RATE_PERIOD_S for name, count in counts.items()
        }
        self._counted = counts

    def _take_status(self, message: bytes) -> None:
        values = [dict(status.values) for status in decode_diagnostics(message).statuses]
        self.figures.states = {value["target"]: value["state"] for value in values}

    def _take_diagnostics(self, message: bytes) -> None:
        for status in decode_diagnostics(message).statuses:
            self.figures.diagnostics[status.name] = dict(status.values)
