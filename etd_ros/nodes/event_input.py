"""Events from a topic: subscribed while they are wanted, decoded from bytes, in streams without surprises."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Callable, Iterator

from rclpy.subscription import Subscription

from etd_ros.nodes.base import EVENT_QOS, EtdNode, Input
from etd_ros.settings import Settings
from etd_ros.stream import Restart, StreamBatch, StreamGuard
from msg_adapters import EVENT_TYPES, EventMessage, Layout, SensorClock, decoder_for

POLL_PERIOD_S = 0.2


class EventDecoding:
    """One publisher's messages to guarded batches on the ROS clock.

    Args:
        type_name: ROS 2 type of the messages.
        settings: of the node.
        resumes: whether events were read before: what was missed since then ends their stream.
    """

    def __init__(self, type_name: str, settings: Settings, *, resumes: bool) -> None:
        self.messages = 0
        self.events = 0
        self.skipped_words = 0
        self.off_sensor = 0
        self.guard = StreamGuard(settings.stream)
        self._decoder = decoder_for(type_name, Layout.ROS2)
        self._clock = SensorClock()
        self._resumes = resumes

    def decode(self, message: bytes) -> Iterator[tuple[EventMessage, StreamBatch]]:
        """The message's batches, each with the message it came from.

        Raises:
            MessageError: the message cannot be decoded.
        """
        decoded = self._decoder.decode(message)
        self.messages += 1
        self.events += len(decoded.events)
        self.skipped_words += decoded.skipped_words
        self.off_sensor += decoded.off_sensor
        events = self._clock.to_ros(decoded)
        for batch in self.guard.feed(events, seq=decoded.seq, encoding=decoded.encoding):
            if self._resumes:
                self._resumes = False
                batch = dataclasses.replace(batch, restart=Restart.GAP)
            yield decoded, batch


class EventInput:
    """The subscription to `~/events` of a node.

    It exists only while `wanted()` says so, so that an idle node costs nothing, and takes whichever of the known
    event types is published.
    """

    def __init__(
        self, node: EtdNode, handle: Callable[[EventMessage, StreamBatch], None], wanted: Callable[[], bool]
    ) -> None:
        self._node = node
        self._handle = handle
        self._wanted = wanted
        self._topic = node.resolve_topic_name("~/events")
        self._subscription: Subscription | None = None
        self._decoding: EventDecoding | None = None
        self._type_name = ""
        self._received = 0
        self._refused_types: set[str] = set()
        self._timer = node.every(POLL_PERIOD_S, self._poll)
        node.add_input(
            Input(
                topic=self._topic,
                type_name="event_camera_msgs/msg/EventPacket or another event type",
                qos="best effort, keep last 1000",
                provider=(
                    "start a camera driver or `ros2 run etd_ros replay`, and remap with "
                    "`--ros-args -r '~/events:=/your_camera/events'`"
                ),
                messages=lambda: self._received,
                wanted=wanted,
            )
        )

    @property
    def subscribed(self) -> bool:
        """Whether events are read now."""
        return self._subscription is not None

    def diagnostics(self) -> dict[str, object]:
        """Counters for /diagnostics."""
        if self._decoding is None:
            return {"event messages": 0, "events": 0}
        counters = self._decoding.guard.counters
        return {
            "event messages": self._decoding.messages,
            "events": self._decoding.events,
            "skipped words": self._decoding.skipped_words,
            "events off the sensor": self._decoding.off_sensor,
            "lost messages": counters.lost_messages,
            "stream restarts": counters.restarts,
            "events clamped in time": counters.clamped_events,
        }

    def _poll(self) -> None:
        if not self._wanted():
            self._unsubscribe()
        elif self._subscription is None:
            self._subscribe()
        elif (types := self._published_types()) and self._type_name not in types:
            # Another publisher has taken the first one's place.
            self._unsubscribe()
            self._subscribe()

    def _published_types(self) -> set[str]:
        return {info.topic_type for info in self._node.get_publishers_info_by_topic(self._topic)}

    def _subscribe(self) -> None:
        types = self._published_types()
        known = sorted(types & EVENT_TYPES)
        if not known:
            for type_name in sorted(types - self._refused_types):
                self._refused_types.add(type_name)
                self._node.get_logger().warning(
                    f"{self._topic} carries {type_name}, not events: known are {', '.join(sorted(EVENT_TYPES))}"
                )
            return
        type_name = known[0]
        message_class = _message_class(type_name)
        if message_class is None:
            self._node.warn(f"{self._topic} carries {type_name}: build and source {type_name.split('/')[0]}")
            return
        decoding = EventDecoding(type_name, self._node.settings, resumes=self._decoding is not None)

        def on_message(message: bytes) -> None:
            self._received += 1
            self._node.worker.submit(lambda data: self._decode(decoding, data), message)

        self._decoding = decoding
        self._type_name = type_name
        self._subscription = self._node.create_subscription(message_class, self._topic, on_message, EVENT_QOS, raw=True)
        self._node.get_logger().info(f"reading {type_name} from {self._topic}")

    def _unsubscribe(self) -> None:
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None
            self._node.get_logger().info(f"not reading {self._type_name} from {self._topic} any more")

    def _decode(self, decoding: EventDecoding, message: bytes) -> None:
        for decoded, batch in decoding.decode(message):
            if batch.restart is not None:
                self._node.warn(f"the event stream starts anew: {batch.restart.value}")
            self._handle(decoded, batch)


def _message_class(type_name: str) -> type | None:
    package, _, name = type_name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)  # type: ignore[no-any-return]
    except ModuleNotFoundError:
        return None
