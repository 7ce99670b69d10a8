"""Subscriptions that take all that waits at a turn: rclpy hands over one message at each, and a turn costs it several
times what the message does, so a reader that has fallen behind would stay behind until DDS has no room left."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

MessageInfo = Mapping[str, int]
"""What ROS knows of a message: `source_timestamp`, `received_timestamp` (ns), `publication_sequence_number`."""

AT_A_TURN_MAX = 100
"""Then the node's other topics, timers and services have theirs."""


def read_all(
    node: Node,
    kind: type,
    topic: str,
    take: Callable[[bytes, MessageInfo], None],
    qos: QoSProfile,
    event_callbacks: SubscriptionEventCallbacks | None = None,
    has_room: Callable[[], bool] = lambda: True,
) -> Subscription:
    """Subscribe to a topic's messages as bytes, up to AT_A_TURN_MAX at each turn of the node's executor, or one where
    there is no room for more: what waits in DDS is kept, and does not become old there."""

    def on_turn(message: bytes, info: MessageInfo) -> None:
        take(message, info)
        for _ in range(AT_A_TURN_MAX - 1):
            waiting = _next_of(subscription) if has_room() else None
            if waiting is None:
                return
            take(*waiting)

    # rclpy has types for callbacks of one argument only.
    callback: Callable[..., None] = on_turn
    subscription = node.create_subscription(kind, topic, callback, qos, raw=True, event_callbacks=event_callbacks)
    return subscription


def _next_of(subscription: Subscription) -> tuple[bytes, MessageInfo] | None:
    """None where nothing waits, or where the last message had the subscription ended."""
    try:
        with subscription.handle:
            taken: Any = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    except InvalidHandle:
        return None
    return None if taken is None else (taken[0], taken[1])
