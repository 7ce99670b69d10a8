"""What every node has beside its life cycle: parameters, a worker, diagnostics, words for what it waits for."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from etd_ros.compile_notice import compile_notice
from etd_ros.errors import EtdError
from etd_ros.nodes.connections import (
    FRAME_QOS,
    NEEDED_QOS,
    Arrivals,
    Input,
    reader_callbacks,
    type_name_of,
    writer_callbacks,
)
from etd_ros.nodes.figures import Latencies, Rates
from etd_ros.nodes.life_cycle import ManagedNode, Phase
from etd_ros.nodes.node_parameters import AT_ONCE, NodeOptions, NodeParameters
from etd_ros.nodes.reading import MessageInfo, read_all
from etd_ros.nodes.remarks import REMARKS_PERIOD_S, Remarks
from etd_ros.nodes.worker import Worker, WorkerCounters
from etd_ros.settings import Settings
from etd_ros.warm_up import warm_up
from msg_adapters import DiagnosticStatus, Level, encode_diagnostics

DIAGNOSTICS_PERIOD_S = 1.0


class EtdNode(ManagedNode):
    """Base of the nodes: `settings` and `options` hold the parameters from `configure` on, the worker runs while a node
    is active."""

    def __init__(self, name: str, stages: tuple[str, ...], options: type[NodeOptions]) -> None:
        super().__init__(name)
        self.errors = 0
        self.dropped = WorkerCounters()
        self.latencies = Latencies()
        self.settings = Settings()
        self.options: Any = options()
        self.worker: Worker
        self._stages = stages
        self._options_class = options
        self._declared = NodeParameters(
            self,
            stages,
            options,
            at_once=options.AT_ONCE,
            is_configured=lambda: self.phase in (Phase.INACTIVE, Phase.ACTIVE),
            changed=self._change_parameters,
        )
        self._inputs: list[Input] = []
        self._rates = Rates()
        self._reported_losses = 0
        self._remarks = Remarks(self)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._diagnostics_timer = self.every(DIAGNOSTICS_PERIOD_S, self._publish_diagnostics)
        self._waiting_timer = self.every(REMARKS_PERIOD_S, self._remark)

    # --- what the nodes say they do, beside what a managed node does

    def change(self, stages: set[str]) -> None:
        """Have changed settings of these stages hold; `settings` and `options` are the new ones."""

    def counts(self) -> dict[str, int]:
        """Counters whose rates are reported."""
        return {}

    def level(self) -> tuple[Level, str]:
        """How the node fares where its inputs come, and in words."""
        return Level.OK, "running"

    def diagnostics(self) -> dict[str, object]:
        """Figures for /diagnostics; subclasses add theirs."""
        return {
            "errors": self.errors,
            "dropped messages": self.dropped.dropped_messages,
            "dropped bytes": self.dropped.dropped_bytes,
            "queued bytes": self.worker.queued_bytes if self.phase is Phase.ACTIVE else 0,
        }

    def losses(self) -> int:
        """How much went wrong so far; where it rises, the node warns."""
        return self.errors + self.dropped.dropped_messages + sum(needed.arrivals.lost for needed in self._inputs)

    def missing(self) -> list[str]:
        """What the node waits for, a sentence each."""
        return self._missing(is_optional=False)

    def lacking(self) -> list[str]:
        """What the node goes on without until it comes, a sentence each."""
        return self._missing(is_optional=True)

    # --- what they do it with

    def add_input(self, needed: Input) -> None:
        """Name a need, so that the node can say what it waits for."""
        self._inputs.append(needed)

    def publisher(self, kind: type, topic: str) -> Publisher:
        """A publisher that says why a subscriber gets nothing."""
        resolved = self.resolve_topic_name(topic)
        return self.create_publisher(
            kind, topic, FRAME_QOS, event_callbacks=writer_callbacks(self, resolved, FRAME_QOS)
        )

    def reader(
        self, kind: type, topic: str, callback: Callable[[bytes], None], qos: QoSProfile = FRAME_QOS
    ) -> Subscription:
        """A subscription to a topic's messages as bytes, which says why a publisher's do not arrive."""
        return self._reader(kind, topic, lambda message, _: callback(message), qos)

    def needed_reader(
        self,
        kind: type,
        topic: str,
        provider: str,
        handle: Callable[[bytes, float], None],
        *,
        is_optional: bool = False,
    ) -> Arrivals:
        """A reader whose messages the node waits for, or goes on without; `handle` gets each with when it came (s,
        monotonic)."""
        arrivals = Arrivals()
        resolved = self.resolve_topic_name(topic)

        def on_message(message: bytes, info: MessageInfo) -> None:
            lost = arrivals.note_number(info["publication_sequence_number"], lambda: self.count_publishers(resolved))
            if lost:
                self.warn(
                    f"{resolved}: {lost} message(s) were lost ({arrivals.lost} so far), as this process stood still "
                    "for longer than DDS keeps them: give it more of the machine"
                )
            handle(message, arrivals.note())

        self._reader(kind, topic, on_message, NEEDED_QOS)
        self.add_input(
            Input(
                resolved,
                frozenset({type_name_of(kind)}),
                "reliable",
                provider,
                arrivals,
                wanted=self.is_wanted,
                is_optional=is_optional,
            )
        )
        return arrivals

    def is_wanted(self) -> bool:
        """Whether somebody wants what the node makes."""
        return True

    def every(self, period_s: float, callback: Callable[[], None]) -> Timer:
        """A timer on the machine's clock: with use_sim_time a ROS timer would stand still until /clock runs, and
        a replay that waits for this node would wait forever."""
        return self.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    @property
    def can_go_on(self) -> bool:
        """Whether callbacks can run, between two of them: rclpy lets none run any more where one could not be begun."""
        return bool(self.default_callback_group.can_execute(self._diagnostics_timer))

    def request(self, task: Callable[[], None]) -> None:
        """Have the worker do a task between two messages; at once where the node is not active."""
        if self.phase is Phase.ACTIVE:
            self.worker.submit_request(lambda _: task())
        else:
            task()

    def warn(self, text: str) -> None:
        """A warning, the same one at most every few seconds."""
        self._remarks.warn(text)

    def count_error(self, err: EtdError) -> None:
        """Bad input: warn, count, go on."""
        self.errors += 1
        self.warn(f"{' '.join(str(err).split())} ({self.errors} so far)")

    def on_worker_error(self, err: Exception) -> None:
        """What is done with what a thread's task raises, or what comes by ROS and cannot be taken in."""
        if isinstance(err, EtdError):
            self.count_error(err)
            return
        if isinstance(err, RuntimeError) and not self.context.ok():
            return  # the node was told to leave while it worked: nothing can be published any more
        self.errors += 1
        text = "".join(traceback.format_exception(err))
        self.get_logger().error(f"internal error, please report it:\n{text}", throttle_duration_sec=REMARKS_PERIOD_S)

    # --- the life cycle

    def start(self) -> None:
        """Configure and activate, unless the parameter `autostart` says that somebody else does.

        Raises:
            EtdError: the parameters make no node.
        """
        if not self._declared.options(self._options_class).autostart:
            node = self.get_fully_qualified_name()
            self.get_logger().info(f"unconfigured: `ros2 lifecycle set {node} configure`, then activate, starts it")
            return
        self.configure_and_activate()

    def on_wrong_transition(self, text: str) -> None:
        """Warn, and count it as an error."""
        self.errors += 1
        self.warn(text)

    def _configure(self) -> None:
        self.settings = self._declared.settings()
        self.options = self._declared.options(self._options_class)
        self._warm_up()
        super()._configure()

    def _activate(self) -> None:
        self.worker = Worker(
            f"{self.get_name()}_worker",
            int(self.options.queue_mib * 2**20),
            self.options.queue_s,
            self.on_worker_error,
            self.dropped,
        )
        try:
            super()._activate()
        except Exception:
            self._inputs.clear()
            self.worker.stop()
            raise

    def _deactivate(self) -> None:
        self._inputs.clear()
        super()._deactivate()
        self.worker.stop()

    def _reader(
        self, kind: type, topic: str, take: Callable[[bytes, MessageInfo], None], qos: QoSProfile
    ) -> Subscription:
        callbacks = reader_callbacks(self, self.resolve_topic_name(topic), qos)
        return read_all(self, kind, topic, take, qos, callbacks, self._has_room)

    def _has_room(self) -> bool:
        """A worker that is behind would drop as too old what is handed to it all at once."""
        return self.phase is Phase.ACTIVE and self.worker.keeps_up

    def _warm_up(self) -> None:
        """Before anything is subscribed: a node that compiles while events come falls behind before it has begun."""
        text = "compiling for this machine, which takes a few seconds to a minute; the next start finds it done"
        with compile_notice(lambda: self.get_logger().info(text)):
            warm_up(self._stages)

    def _change_parameters(self, names: set[str]) -> None:
        self.settings = self._declared.settings()
        self.options = self._declared.options(self._options_class)
        if self.phase is Phase.ACTIVE:
            self.worker.max_bytes = int(self.options.queue_mib * 2**20)
            self.worker.max_age_s = self.options.queue_s
        stages = {name.partition(".")[0] for name in names if "." in name}
        self.change(stages)
        later = sorted(name for name in names if name.partition(".")[0] in stages - AT_ONCE)
        if later:
            self.get_logger().info(f"{', '.join(later)}: holds for targets once they start again (~/reset)")

    # --- what it says of itself

    def _publish_diagnostics(self) -> None:
        level, message = self._health()
        values: dict[str, object] = {"life cycle": self.phase.value}
        if self.phase in (Phase.INACTIVE, Phase.ACTIVE):
            values |= {**self.diagnostics(), **self._rates.per_s(self.counts()), **self.latencies.diagnostics()}
        status = DiagnosticStatus(
            level=level,
            name=self.get_fully_qualified_name().lstrip("/"),
            message=message,
            hardware_id="",
            values=tuple((key, str(value)) for key, value in values.items()),
        )
        stamp_ns = self.get_clock().now().nanoseconds
        self._diagnostics.publish(encode_diagnostics([status], stamp_ns=stamp_ns, frame_id=""))

    def _health(self) -> tuple[Level, str]:
        """Level and words of the last second: no data outweighs what was made of the data before."""
        if self.phase is not Phase.ACTIVE:
            return Level.STALE, self.phase.value
        losses = self.losses()
        new_losses, self._reported_losses = losses - self._reported_losses, losses
        missing, lacking = self.missing(), self.lacking()
        if missing:
            return Level.STALE, "; ".join([*missing, *lacking])
        if not self.is_wanted():
            return Level.STALE, "idle: nobody reads what it makes, so it reads no events"
        level, words = self.level()
        if new_losses > 0:
            level, words = max(level, Level.WARN), f"{words}, with losses"
        return level, "; ".join([words, *lacking])

    def _missing(self, *, is_optional: bool) -> list[str]:
        inputs = [needed for needed in self._inputs if needed.is_optional == is_optional]
        return [sentence for needed in inputs if (sentence := needed.missing(self)) is not None]

    def _remark(self) -> None:
        self._remarks.say_what_is_missing([*self.missing(), *self.lacking()] if self.phase is Phase.ACTIVE else [])
        self._remarks.say_what_has_another_type(needed.topic for needed in self._inputs)
