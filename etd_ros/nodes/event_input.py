"""Events from a topic: subscribed while they are wanted, decoded from bytes, in streams without surprises."""

from __future__ import annotations

import dataclasses
import importlib
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from etd_ros.nodes.base import EtdNode
from etd_ros.nodes.connections import EVENT_QOS, Arrivals, Input, full_name
from etd_ros.settings import Settings
from etd_ros.stream import Restart, StreamBatch, StreamCounters, StreamGuard
from msg_adapters import EVENT_TYPES, EventMessage, Layout, MessageError, SensorClock, decoder_for

POLL_PERIOD_S = 0.2
UNSEEN_TYPE = "event_camera_msgs/msg/EventPacket"
"""What drivers publish, where nobody says what is published."""

BatchHandler = Callable[[EventMessage, StreamBatch, float], None]
"""Gets a message, a batch of it, and when the message was received (s, monotonic)."""


@dataclass(slots=True)
class EventCounters:
    """What has come, from whichever publishers there were."""

    messages: int = 0
    events: int = 0
    skipped_words: int = 0
    off_sensor: int = 0
    errors: int = 0
    stream: StreamCounters = field(default_factory=StreamCounters)

    def diagnostics(self) -> dict[str, object]:
        """For /diagnostics."""
        return {
            "event messages": self.messages,
            "events": self.events,
            "decode errors": self.errors,
            "skipped words": self.skipped_words,
            "events off the sensor": self.off_sensor,
            "sequence gaps": self.stream.gaps,
            "lost messages": self.stream.lost_messages,
            "stream restarts": self.stream.restarts,
            "steps back in time": self.stream.steps_back,
            "events clamped in time": self.stream.clamped_events,
        }


class EventDecoding:
    """One publisher's messages to guarded batches on the ROS clock.

    Args:
        type_name: ROS 2 type of the messages.
        settings: of the node.
        resumes: whether events were read before: what was missed since then ends their stream.
        counters: of all publishers so far.
        dropped: how many messages the node has dropped so far.
    """

    def __init__(
        self,
        type_name: str,
        settings: Settings,
        *,
        resumes: bool,
        counters: EventCounters | None = None,
        dropped: int = 0,
    ) -> None:
        self._counters = counters or EventCounters()
        self.guard = StreamGuard(settings.stream, self._counters.stream)
        self._decoder = decoder_for(type_name, Layout.ROS2)
        self._clock = SensorClock()
        self._resumes = resumes
        self._dropped = dropped

    def decode(self, message: bytes, dropped: int = 0) -> Iterator[tuple[EventMessage, StreamBatch]]:
        """The message's batches, each with the message it came from.

        Args:
            message: its bytes.
            dropped: how many messages the node has dropped so far, from wherever they came.

        Raises:
            MessageError: the message cannot be decoded.
        """
        counters = self._counters
        try:
            decoded = self._decoder.decode(message)
        except MessageError:
            counters.errors += 1
            raise
        counters.messages += 1
        counters.events += len(decoded.events)
        counters.skipped_words += decoded.skipped_words
        counters.off_sensor += decoded.off_sensor
        events = self._clock.to_ros(decoded)
        just_dropped, self._dropped = max(dropped - self._dropped, 0), dropped
        for batch in self.guard.feed(events, seq=decoded.seq, encoding=decoded.encoding, dropped=just_dropped):
            if self._resumes:
                self._resumes = False
                counters.stream.restarts += 1
                batch = dataclasses.replace(batch, restart=Restart.PAUSE)
            yield decoded, batch


class EventInput:
    """The subscription to `~/events` of a node.

    It exists only while the node is active and `is_wanted()` says so, so that an idle node costs nothing, and takes
    whichever of the known event types is published.
    """

    def __init__(self, node: EtdNode, handle: BatchHandler) -> None:
        self.counters = EventCounters()
        self._node = node
        self._handle = handle
        self._topic = node.resolve_topic_name("~/events")
        self._subscription: Subscription | None = None
        self._decoding: EventDecoding | None = None
        self._type_name = ""
        self._arrivals = Arrivals()
        self._refused_types: set[str] = set()

    def open(self) -> None:
        """Read while events are wanted."""
        self._node.every(POLL_PERIOD_S, self._poll)
        self._node.add_input(
            Input(
                topic=self._topic,
                type_names=EVENT_TYPES,
                qos="best effort, keep last 1000",
                provider=(
                    "start a camera driver or `ros2 run etd_ros replay`, and remap with "
                    "`--ros-args -r '~/events:=/your_camera/events'`"
                ),
                arrivals=self._arrivals,
                wanted=self._node.is_wanted,
            )
        )

    def close(self) -> None:
        """Read no more. What is missed until the next `open` ends the stream."""
        self._unsubscribe()

    def use(self, settings: Settings) -> None:
        """Have other settings of the stream hold for the events to come. Call it in the worker's thread."""
        if self._decoding is not None:
            self._decoding.guard.use(settings.stream)

    @property
    def subscribed(self) -> bool:
        """Whether events are read now."""
        return self._subscription is not None

    def counts(self) -> dict[str, int]:
        """Counters whose rates are reported."""
        return {"event messages": self.counters.messages, "events": self.counters.events}

    def losses(self) -> int:
        """How often messages were missing."""
        return self.counters.stream.gaps

    def diagnostics(self) -> dict[str, object]:
        """Counters for /diagnostics."""
        return {
            **self.counters.diagnostics(),
            "reading events": self.subscribed,
            "event publishers": ", ".join(map(full_name, self._publishers())),
        }

    def _poll(self) -> None:
        if not self._node.is_wanted():
            self._unsubscribe()
            return
        publishers = self._publishers()
        if len(publishers) > 1:
            self._node.warn(
                f"{self._topic} has {len(publishers)} publishers ({', '.join(map(full_name, publishers))}): messages "
                "seem lost where they take turns: have one publish there, and remap or stop the rest"
            )
        types = {info.topic_type for info in publishers}
        if self._subscription is None:
            self._subscribe(types)
        elif types and self._type_name not in types:
            # Another publisher has taken the first one's place.
            self._unsubscribe()
            self._subscribe(types)

    def _publishers(self) -> list[TopicEndpointInfo]:
        return sorted(self._node.get_publishers_info_by_topic(self._topic), key=full_name)

    def _subscribe(self, types: set[str]) -> None:
        is_unseen = not types and _sees_only_what_it_reads()
        known = [UNSEEN_TYPE] if is_unseen else sorted(types & EVENT_TYPES)
        if not known:
            for type_name in sorted(types - self._refused_types):
                self._refused_types.add(type_name)
                self._node.get_logger().warning(
                    f"{self._topic} carries {type_name}, not events: remap `~/events` to a topic of one of "
                    f"{', '.join(sorted(EVENT_TYPES))}"
                )
            return
        type_name = known[0]
        message_class = _message_class(type_name)
        if message_class is None:
            self._node.warn(f"{self._topic} carries {type_name}: build and source {type_name.split('/')[0]}")
            return
        resumes = self._decoding is not None
        decoding = EventDecoding(
            type_name,
            self._node.settings,
            resumes=resumes,
            counters=self.counters,
            dropped=self._node.dropped.dropped_messages,
        )

        def on_message(message: bytes) -> None:
            received_s = self._arrivals.note()
            self._node.worker.submit(lambda data: self._decode(decoding, data, received_s), message)

        self._decoding = decoding
        self._type_name = type_name
        self._subscription = self._node.reader(message_class, self._topic, on_message, EVENT_QOS)
        why = ", whose type the discovery server does not tell: ROS_SUPER_CLIENT=TRUE lets it" if is_unseen else ""
        self._node.get_logger().info(f"reading {type_name} from {self._topic}{why}")

    def _unsubscribe(self) -> None:
        if self._subscription is not None and self._node.context.ok():
            self._node.destroy_subscription(self._subscription)
            self._subscription = None
            self._node.get_logger().info(f"not reading {self._type_name} from {self._topic} any more")

    def _decode(self, decoding: EventDecoding, message: bytes, received_s: float) -> None:
        for decoded, batch in decoding.decode(message, self._node.dropped.dropped_messages):
            if batch.restart is not None:
                say = self._node.get_logger().info if batch.restart is Restart.PAUSE else self._node.warn
                say(f"the event stream starts anew: {batch.restart.value}")
            self._handle(decoded, batch, received_s)


def _sees_only_what_it_reads() -> bool:
    """Whether this is a mere client of a discovery server: it is told of a topic once it reads it, and not before."""
    return bool(os.environ.get("ROS_DISCOVERY_SERVER")) and os.environ.get("ROS_SUPER_CLIENT", "").upper() != "TRUE"


def _message_class(type_name: str) -> type | None:
    package, _, name = type_name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)  # type: ignore[no-any-return]
    except ModuleNotFoundError:
        return None
