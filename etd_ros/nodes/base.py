"""What every node has: described parameters, a worker, diagnostics, words for what it waits for, a quiet end."""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.timer import Timer

from etd_ros.errors import EtdError
from etd_ros.nodes.worker import Worker
from etd_ros.parameters import Description, Parameters, from_mapping, parameter
from etd_ros.parameters import described as described_options
from etd_ros.settings import Settings, described_settings, settings_from_mapping
from etd_ros.warm_up import warm_up
from msg_adapters import DiagnosticStatus, Level, encode_diagnostics

EVENT_QOS = QoSProfile(
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
    history=HistoryPolicy.KEEP_LAST,
    depth=1000,
)
"""As the drivers send: a reliable subscriber would get nothing from them."""

FRAME_QOS = QoSProfile(
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
)
"""For frames, images and boxes: few and each of them matters."""

SLOW_START_S = 2.0
WARNING_PERIOD_S = 5.0
DIAGNOSTICS_PERIOD_S = 1.0
_FLOAT_MAX = sys.float_info.max
_INT_MAX = 2**63 - 1


@dataclass(frozen=True, slots=True)
class NodeOptions(Parameters):
    """Parameters that every node has."""

    queue_mib: float = parameter(
        64.0,
        "longest queue of messages (MiB); beyond it the oldest are dropped and counted",
        low=1.0,
        high=4096.0,
    )


class RosError(EtdError):
    """ROS refuses to start."""


OptionsT = TypeVar("OptionsT", bound=NodeOptions)


@dataclass(frozen=True, slots=True)
class Input:
    """One thing that a node needs from others.

    Attributes:
        topic: resolved name.
        type_name: what is expected there, in words where several types are.
        qos: in words.
        provider: which executable or driver brings it.
        messages: how many have come so far.
        wanted: whether the node reads it now.
    """

    topic: str
    type_name: str
    qos: str
    provider: str
    messages: Callable[[], int]
    wanted: Callable[[], bool]


class EtdNode(Node):
    """Base of the nodes. Subclasses read `settings` and `options`, and submit messages to `worker`."""

    def __init__(self, name: str, stages: tuple[str, ...], options: type[OptionsT]) -> None:
        super().__init__(name)
        self.errors = 0
        self.settings = self._declare_settings(stages)
        self.options: Any = from_mapping(options, self._declare(described_options(options)))
        self._warm_up(stages)
        self.worker = Worker(f"{name}_worker", int(self.options.queue_mib * 2**20), self._on_worker_error)
        self._inputs: list[Input] = []
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._diagnostics_timer = self.every(DIAGNOSTICS_PERIOD_S, self._publish_diagnostics)
        self._waiting_timer = self.every(WARNING_PERIOD_S, self._say_what_is_missing)

    def add_input(self, needed: Input) -> None:
        """Name a need, so that the node can say what it waits for."""
        self._inputs.append(needed)

    def every(self, period_s: float, callback: Callable[[], None]) -> Timer:
        """A timer on the machine's clock: with use_sim_time a ROS timer would stand still until /clock runs, and
        a replay that waits for this node would wait forever."""
        return self.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def warn(self, text: str) -> None:
        """A warning, at most every few seconds from one place."""
        self.get_logger().warning(text, throttle_duration_sec=WARNING_PERIOD_S)

    def count_error(self, err: EtdError) -> None:
        """Bad input: warn, count, go on."""
        self.errors += 1
        self.warn(f"{' '.join(str(err).split())} ({self.errors} so far)")

    def diagnostics(self) -> dict[str, object]:
        """Figures for /diagnostics; subclasses add theirs."""
        return {
            "errors": self.errors,
            "dropped messages": self.worker.counters.dropped_messages,
            "dropped bytes": self.worker.counters.dropped_bytes,
            "queued bytes": self.worker.queued_bytes,
        }

    def missing(self) -> list[str]:
        """What the node waits for, a sentence each."""
        return [_missing(self, needed) for needed in self._inputs if needed.wanted() and not needed.messages()]

    def stop(self) -> None:
        """End the worker; the node can be destroyed then."""
        self.worker.stop()

    def _warm_up(self, stages: tuple[str, ...]) -> None:
        """Before anything is subscribed: a node that compiles while events come falls behind before it has begun."""
        text = "compiling for this machine, which takes a few seconds to a minute; the next start finds it done"
        notice = threading.Timer(SLOW_START_S, self.get_logger().info, (text,))
        notice.start()
        try:
            warm_up(stages)
        finally:
            notice.cancel()

    def _declare_settings(self, stages: tuple[str, ...]) -> Settings:
        return settings_from_mapping(self._declare(described_settings(stages)))

    def _declare(self, described: Any) -> dict[str, Any]:
        values = {}
        for name, default, description in described:
            initial = list(default) if isinstance(default, tuple) else default
            value = self.declare_parameter(name, initial, _descriptor(default, description)).value
            values[name] = tuple(value) if isinstance(default, tuple) else value
        return values

    def _publish_diagnostics(self) -> None:
        missing = self.missing()
        dropped = self.worker.counters.dropped_messages
        status = DiagnosticStatus(
            level=Level.STALE if missing else Level.WARN if dropped or self.errors else Level.OK,
            name=self.get_fully_qualified_name().lstrip("/"),
            message="; ".join(missing) or ("running, with losses" if dropped or self.errors else "running"),
            hardware_id="",
            values=tuple((key, str(value)) for key, value in self.diagnostics().items()),
        )
        stamp_ns = self.get_clock().now().nanoseconds
        self._diagnostics.publish(encode_diagnostics([status], stamp_ns=stamp_ns, frame_id=""))

    def _say_what_is_missing(self) -> None:
        sentences = self.missing()
        if sentences:
            self.get_logger().info("; ".join(sentences), throttle_duration_sec=2 * WARNING_PERIOD_S)

    def _on_worker_error(self, err: Exception) -> None:
        if isinstance(err, EtdError):
            self.count_error(err)
            return
        if isinstance(err, RuntimeError) and not self.context.ok():
            return  # the node was told to leave while it worked: nothing can be published any more
        self.errors += 1
        text = "".join(traceback.format_exception(err))
        self.get_logger().error(f"internal error, please report it:\n{text}", throttle_duration_sec=WARNING_PERIOD_S)


def start_ros(arguments: list[str] | None) -> None:
    """Start ROS; what stands after --ros-args is checked here.

    Raises:
        RosError: an argument that ROS does not understand, such as a parameter file that is missing.
    """
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.ALL)
    # rclpy's own errors for this have no public name; all of them derive from RuntimeError.
    except RuntimeError as err:
        raise ros_error(err) from err


def ros_error(err: RuntimeError) -> RosError:
    """What rclpy says of the arguments, without the places in its sources."""
    return RosError(f"ROS does not start: {str(err).partition(', at /')[0]}: mend what stands after --ros-args")


def run_node(make: Callable[[], EtdNode], arguments: list[str] | None = None) -> int:
    """Spin one node until it is told to stop; bad parameters are one line and exit code 2."""
    node = None
    try:
        start_ros(arguments)
        node = make()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        executor.spin()
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
        if node is not None:
            node.stop()
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _descriptor(default: Any, description: Description) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=description.text, read_only=True)
    if description.choices:
        descriptor.additional_constraints = f"one of {', '.join(description.choices)}"
    low, high = description.low, description.high
    if isinstance(default, bool) or (low is None and high is None):
        return descriptor
    if isinstance(default, int):
        low_int, high_int = -_INT_MAX if low is None else int(low), _INT_MAX if high is None else int(high)
        descriptor.integer_range = [IntegerRange(from_value=low_int, to_value=high_int, step=0)]
    elif isinstance(default, float):
        low_float, high_float = -_FLOAT_MAX if low is None else float(low), _FLOAT_MAX if high is None else float(high)
        descriptor.floating_point_range = [FloatingPointRange(from_value=low_float, to_value=high_float, step=0.0)]
    return descriptor


def _missing(node: Node, needed: Input) -> str:
    what = f"{needed.topic} ({needed.type_name}, {needed.qos})"
    publishers = node.get_publishers_info_by_topic(needed.topic)
    if not publishers:
        return f"waiting for {what}: nobody publishes it; {needed.provider}"
    types = sorted({info.topic_type for info in publishers})
    return f"waiting for {what}: {len(publishers)} publisher(s) of {', '.join(types)}, no message yet"
