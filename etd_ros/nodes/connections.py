"""How nodes are connected: qualities of service, what arrives, and words for what does not."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy, qos_policy_name_from_kind
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

EVENT_QOS = QoSProfile(
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
    history=HistoryPolicy.KEEP_LAST,
    depth=1000,
)
"""As the drivers send: a reliable subscriber would get nothing from them."""


def _reliable(depth: int) -> QoSProfile:
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.VOLATILE,
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
    )


FRAME_QOS = _reliable(100)
"""For frames, images and boxes: few and each of them matters."""

NEEDED_QOS = _reliable(500)
"""For a node that reads frames or images: Python may stand still for half a second, as when a library is loaded, while
DDS receives. Only what waits takes memory; a publisher that keeps as much would hold it for every viewer that is
stopped."""

LISTENER_QOS = _reliable(2000)
"""Deeper than the nodes' own: a recorder reads several topics, may not run for a second or more on a busy machine, and
must lose nothing."""

SILENCE_S = 2.0
"""Without a message for longer (s), a node that wants some says so."""


@dataclass(slots=True)
class Arrivals:
    """What has come on a topic.

    Attributes:
        messages: how many.
        lost: how many their publisher sent between these without that they came.
        last_s: when the last one came (s, monotonic).
    """

    messages: int = 0
    lost: int = 0
    last_s: float = field(default_factory=time.monotonic)
    _last_number: int | None = None

    def note(self) -> float:
        """A message has come; returns when (s, monotonic)."""
        self.messages += 1
        self.last_s = time.monotonic()
        return self.last_s

    def note_number(self, number: int, publishers: Callable[[], int]) -> int:
        """A message has come that is its publisher's `number`th; returns how many before it are lost.

        A publisher that has started anew counts from 1 again. Where `publishers()` are several, which is asked only of
        numbers that do not go up by one, nobody can tell.
        """
        last, self._last_number = self._last_number, number
        if last is None or number <= last + 1 or publishers() != 1:
            return 0
        self.lost += number - last - 1
        return number - last - 1


@dataclass(frozen=True, slots=True)
class Input:
    """One thing that a node needs from others.

    Attributes:
        topic: resolved name.
        type_names: the types of messages that are taken.
        qos: in words.
        provider: which executable or driver brings it.
        arrivals: of its messages.
        wanted: whether the node reads it now.
        is_optional: whether the node goes on without.
    """

    topic: str
    type_names: frozenset[str]
    qos: str
    provider: str
    arrivals: Arrivals
    wanted: Callable[[], bool]
    is_optional: bool = False

    def missing(self, node: Node) -> str | None:
        """Why nothing comes, and the cure, in a sentence; None where it comes or is not wanted."""
        arrivals = self.arrivals
        if not self.wanted() or (arrivals.messages and time.monotonic() - arrivals.last_s < SILENCE_S):
            return None
        publishers = node.get_publishers_info_by_topic(self.topic)
        what = f"{self.topic} ({_any_of(self.type_names)}, {self.qos})"
        if not publishers:
            return f"waiting for {what}: nobody publishes it; {self.provider}"
        types = {info.topic_type for info in publishers}
        if not types & self.type_names:
            return (
                f"{self.topic} carries {_any_of(types)}, which is not {_any_of(self.type_names)}: remap this node's "
                f"topic to the right one; {self.provider}"
            )
        since = "any more" if arrivals.messages else "yet"
        return f"waiting for {what}: {len(publishers)} publisher(s) of {_any_of(types)}, no message {since}"


def reader_callbacks(node: Node, topic: str, qos: QoSProfile) -> SubscriptionEventCallbacks:
    """Says in one line why a publisher's messages do not arrive, and the cure."""

    def mismatch(event: object) -> None:
        policy = _policy_name(event)
        node.get_logger().warning(
            f"{topic}: a publisher offers another {policy} than this node reads ({_in_words(qos)}), so nothing arrives "
            f"from it: start it with {_in_words(qos)}, or remap this node to a topic that has it"
        )

    return SubscriptionEventCallbacks(incompatible_qos=mismatch)


def writer_callbacks(node: Node, topic: str, qos: QoSProfile) -> PublisherEventCallbacks:
    """Says in one line why a subscriber gets nothing, and the cure."""

    def mismatch(event: object) -> None:
        policy = _policy_name(event)
        node.get_logger().warning(
            f"{topic}: a subscriber asks for another {policy} than this node offers ({_in_words(qos)}), so it gets "
            f"nothing: have it subscribe with {_in_words(qos)}"
        )

    return PublisherEventCallbacks(incompatible_qos=mismatch)


def other_types(node: Node, endpoint: Publisher | Subscription) -> list[str]:
    """A sentence for each other node that has another type of message on the topic of a publisher or subscription:
    nothing goes between the two."""
    topic, own = endpoint.topic_name, type_name_of(endpoint.msg_type)
    others = [*node.get_publishers_info_by_topic(topic), *node.get_subscriptions_info_by_topic(topic)]
    return [
        f"{topic} is {own} here, but {info.topic_type} at {full_name(info)}, so nothing arrives: remap one of the two"
        for info in others
        if info.topic_type != own
    ]


def type_name_of(kind: Any) -> str:
    """The ROS name of a message class, such as sensor_msgs/msg/Image."""
    return f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"


def full_name(info: TopicEndpointInfo) -> str:
    """Name and namespace of the node that publishes or subscribes."""
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def _policy_name(event: object) -> str:
    return str(qos_policy_name_from_kind(event.last_policy_kind)).lower()  # type: ignore[attr-defined]


def _in_words(qos: QoSProfile) -> str:
    return f"{qos.reliability.name}, {qos.durability.name}".lower().replace("_", " ")


def _any_of(type_names: set[str] | frozenset[str]) -> str:
    return " or ".join(sorted(type_names))
