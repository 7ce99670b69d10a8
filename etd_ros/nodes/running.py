"""A node's process: ROS started, the node spun until it is told to leave, a quiet end."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable

import rclpy
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions

from etd_ros.errors import EtdError
from etd_ros.nodes.base import EtdNode
from etd_ros.nodes.ros_errors import ros_refusals

THREAD_SWITCH_S = 0.0005
"""How long a thread may hold the others up (s): Python's 5 ms would be most of a box's latency."""


def start_ros(arguments: list[str] | None) -> None:
    """Start ROS; what stands after --ros-args is checked here.

    Raises:
        RosError: an argument that ROS does not understand, such as a parameter file that is missing, or security that
            is asked for and cannot be had.
    """
    with ros_refusals():
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.ALL)


def run_node(make: Callable[[], EtdNode], arguments: list[str] | None = None) -> int:
    """Spin one node until it is told to stop; bad parameters are one line and exit code 2."""
    node = executor = None
    sys.setswitchinterval(THREAD_SWITCH_S)
    try:
        start_ros(arguments)
        node = make()
        node.start()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        node.finished.add_done_callback(lambda _: executor.wake())
        # Not spin_until_future_complete: that adds a callback to the future at every turn, which is never let go.
        while rclpy.ok() and not node.finished.done():
            executor.spin_once()
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except (EtdError, InvalidParameterTypeException, InvalidParameterValueException) as err:
        print(f"etd_ros: {' '.join(str(err).split())}", file=sys.stderr)  # noqa: T201
        return 2
    # Signals end the context at any moment; then whatever the node is in the middle of fails, each call in its own way.
    except Exception as err:
        if rclpy.ok():
            raise
        get_logger("etd_ros").debug(f"told to leave, while: {err!r}")
        return 0
    finally:
        # Whoever asks twice must not keep the node from leaving in order.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        # It holds on to what it waits for, and with that to shared memory.
        if executor is not None:
            executor.shutdown()
        if node is not None:
            node.stop()
            node.destroy_node()
        rclpy.try_shutdown()
    return 0
