"""A node's process: ROS started, the node spun until it is told to leave, a quiet end."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

import rclpy
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions, install_signal_handlers, uninstall_signal_handlers

from etd_ros.errors import EtdError
from etd_ros.nodes.arguments import refuse_stray_words
from etd_ros.nodes.base import EtdNode
from etd_ros.nodes.memory import hold_memory
from etd_ros.nodes.programs import LEAVE, handled
from etd_ros.nodes.ros_errors import ros_refusals

THREAD_SWITCH_S = 0.0005
"""How long a thread may hold the others up (s): Python's 5 ms would be most of a box's latency."""

FAILING_MAX_S = 5.0
"""A node in which nothing has succeeded for so long (s) is broken itself."""
COMPILER = "llvmlite"
AGAIN_S, AGAIN_SOON_S = 0.2, 0.005


def start_ros(arguments: list[str], signals: SignalHandlerOptions = SignalHandlerOptions.ALL) -> None:
    """Start ROS; what stands after --ros-args is checked here.

    Args:
        arguments: the program's.
        signals: those that ROS shall hear.

    Raises:
        RosError: an argument that ROS does not understand, such as a parameter file that is missing, or security that
            is asked for and cannot be had.
    """
    with ros_refusals():
        rclpy.init(args=arguments, signal_handler_options=signals)


def run_node(make: Callable[[], EtdNode]) -> int:
    """Spin one node until it is told to stop; bad parameters are one line and exit code 2."""
    node = executor = None
    sys.setswitchinterval(THREAD_SWITCH_S)
    try:
        with _beginning() as beginning:
            refuse_stray_words(sys.argv)
            start_ros(sys.argv, SignalHandlerOptions.NO)
            node = make()
            beginning.made()
            node.start()
            hold_memory()
        install_signal_handlers(SignalHandlerOptions.ALL)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        node.finished.add_done_callback(lambda _: executor.wake())
        # Not spin_until_future_complete: that adds a callback to the future at every turn, which is never let go.
        spinner = _Spinner(executor, node)
        while rclpy.ok() and not node.finished.done():
            spinner.spin_once()
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
        _let_go(node, executor)
    return 0


class _Spinner:
    """What cannot be taken in (a parameter of no type, a negative time on /clock) must not end the node; a node that
    can take in nothing any more must, so that it is started again."""

    def __init__(self, executor: SingleThreadedExecutor, node: EtdNode) -> None:
        self._executor = executor
        self._node = node
        self._failing_since_s: float | None = None

    def spin_once(self) -> None:
        try:
            self._executor.spin_once()
        except ExternalShutdownException:
            raise
        except Exception as err:
            now_s = time.monotonic()
            since_s = self._failing_since_s = self._failing_since_s or now_s
            if not rclpy.ok() or not self._node.can_go_on or now_s - since_s > FAILING_MAX_S:
                raise
            self._node.on_worker_error(err)
        else:
            self._failing_since_s = None


@contextmanager
def _beginning() -> Iterator[_Beginning]:
    """For as long as a node is made and started."""
    beginning = _Beginning()
    with handled((*LEAVE, signal.SIGALRM), beginning.hear):
        try:
            yield beginning
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)


class _Beginning:
    """What signals do until a node spins, which is when ROS begins to hear them.

    While it is being made they are remembered: half a node could not be let go. From then on they raise
    KeyboardInterrupt, again and again: one would be lost where libraries swallow it, and the node go on compiling.
    """

    def __init__(self) -> None:
        self._has_node = self._is_told = False

    def made(self) -> None:
        """From now on there is a node to let go."""
        self._has_node = True
        if self._is_told:
            raise KeyboardInterrupt

    def hear(self, _: int, frame: FrameType | None) -> None:
        self._is_told = True
        if not self._has_node:
            return
        if _is_called_by_compiler(frame):
            signal.setitimer(signal.ITIMER_REAL, AGAIN_SOON_S)
            return
        signal.setitimer(signal.ITIMER_REAL, AGAIN_S)
        raise KeyboardInterrupt


def _is_called_by_compiler(frame: FrameType | None) -> bool:
    """Whether an exception would go to compiled code, which prints it and goes on."""
    while frame is not None:
        if frame.f_globals.get("__name__", "").startswith(COMPILER):
            return True
        frame = frame.f_back
    return False


def _let_go(node: EtdNode | None, executor: SingleThreadedExecutor | None) -> None:
    # Whoever asks twice must not keep the node from leaving in order.
    for number in LEAVE:
        signal.signal(number, signal.SIG_IGN)
    # ROS's thread for signals wakes every executor, after Python has heard the signal: this waits for its end, else it
    # would reach for an executor that is gone. For a microsecond in it, a signal does what it did before ROS heard it.
    uninstall_signal_handlers()
    # It holds on to what it waits for, and with that to shared memory.
    if executor is not None:
        executor.shutdown()
    if node is not None:
        node.stop()
        node.destroy_node()
    rclpy.try_shutdown()
