"""A plain node in a context of its own, for programs that watch or feed the nodes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription

__all__ = ["Subscription", "node_in_own_context"]


@contextmanager
def node_in_own_context(name: str, domain: int, namespace: str) -> Iterator[tuple[Node, SingleThreadedExecutor]]:
    """A node in a ROS domain, and its executor. Signals are left to the program."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    node = Node(name, context=context, namespace=namespace)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        yield node, executor
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
