"""What a node says in its log: neither a flood, nor one thing that hides another."""

from __future__ import annotations

import re
import threading
import time
from collections import deque
from collections.abc import Iterable

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from etd_ros.nodes.connections import other_types

REMARKS_PERIOD_S = 5.0
KINDS_PER_PERIOD = 5
"""So many different warnings are said in one period: bad input of ever new kinds cannot fill a disk."""
REMINDERS_PERIOD = 12
"""What is missing is said again every so many periods, while it stays the same."""
_NUMBERS = re.compile(r"\d+")


class Throttle:
    """Lets a warning through once in a period, and others beside it; numbers in a text make no other warning of it.

    Args:
        period_s: how long (s).
        kinds_max: so many different ones are let through in a period.
    """

    def __init__(self, period_s: float, kinds_max: int = KINDS_PER_PERIOD) -> None:
        self._period_s = period_s
        self._kinds_max = kinds_max
        self._said: deque[tuple[float, str]] = deque()
        self._lock = threading.Lock()

    def lets(self, text: str, now_s: float) -> bool:
        """Whether this is to be said now (s, on a clock that only goes forth). Any thread may ask."""
        with self._lock:
            return self._lets(_NUMBERS.sub("0", text), now_s)

    def _lets(self, kind: str, now_s: float) -> bool:
        said = self._said
        while said and now_s - said[0][0] > self._period_s:
            said.popleft()
        if len(said) >= self._kinds_max or any(kind == earlier for _, earlier in said):
            return False
        said.append((now_s, kind))
        return True


class Remarks:
    """The warnings of one node, and what it says again while it lasts.

    Args:
        node: which speaks.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._throttle = Throttle(REMARKS_PERIOD_S)
        self._missing: list[str] = []
        self._reminder = 0
        self._other_types: set[str] = set()

    def warn(self, text: str) -> None:
        """A warning, the same one at most every few seconds."""
        if self._throttle.lets(text, time.monotonic()):
            self._node.get_logger().warning(text)

    def say_what_is_missing(self, sentences: list[str]) -> None:
        """At once when it changes, and now and then while it lasts."""
        self._reminder = 0 if sentences != self._missing else self._reminder + 1
        if sentences and self._reminder % REMINDERS_PERIOD == 0:
            self._node.get_logger().info("; ".join(sentences))
        self._missing = sentences

    def say_what_has_another_type(self, awaited: Iterable[str]) -> None:
        """Of topics that are not awaited, such as clicks, or who reads the boxes: no middleware says so by itself."""
        left_out = frozenset(awaited)
        endpoints: list[Publisher | Subscription] = [*self._node.publishers, *self._node.subscriptions]
        sentences = {
            sentence
            for endpoint in endpoints
            if endpoint.topic_name not in left_out and self._is_settled(endpoint.topic_name)
            for sentence in other_types(self._node, endpoint)
        }
        for sentence in sorted(sentences - self._other_types):
            self._node.get_logger().warning(sentence)
        self._other_types = sentences

    def _is_settled(self, topic: str) -> bool:
        """Whether ROS finds the topic under its name: a rule that remaps it again would lead it to another."""
        return bool(self._node.resolve_topic_name(topic) == topic)
