"""What every node has: a life cycle, parameters, a worker, diagnostics, words for what it waits for."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.lifecycle import Node as LifecycleNode
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer

from etd_ros.errors import EtdError
from etd_ros.nodes.compile_notice import compile_notice
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
from etd_ros.nodes.node_parameters import AT_ONCE, NodeOptions, NodeParameters
from etd_ros.nodes.remarks import REMARKS_PERIOD_S, Remarks
from etd_ros.nodes.ros_errors import ros_reason, ros_refusals
from etd_ros.nodes.worker import Worker, WorkerCounters
from etd_ros.settings import Settings
from etd_ros.warm_up import warm_up
from msg_adapters import DiagnosticStatus, Level, encode_diagnostics

DIAGNOSTICS_PERIOD_S = 1.0


class Phase(str, Enum):
    """Where a node is in its life cycle."""

    UNCONFIGURED = "unconfigured"
    INACTIVE = "inactive"
    ACTIVE = "active"
    FINALIZED = "finalized"


class EtdNode(LifecycleNode):
    """Base of the nodes, which say what they do in `configure`, `activate`, `deactivate` and `cleanup`.

    What is made in `configure` is destroyed after `cleanup`, what is made in `activate` after `deactivate`; the worker
    runs while the node is active.
    """

    def __init__(self, name: str, stages: tuple[str, ...], options: type[NodeOptions]) -> None:
        with ros_refusals():
            super().__init__(name)
        self.errors = 0
        self.phase = Phase.UNCONFIGURED
        self.finished = Future()
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
        self._refusal: Exception | None = None
        self._is_starting = False
        self._inputs: list[Input] = []
        self._kept: dict[Phase, set[object]] = {}
        self._rates = Rates()
        self._reported_losses = 0
        self._remarks = Remarks(self)
        self._refuse_wrong_transitions()
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._diagnostics_timer = self.every(DIAGNOSTICS_PERIOD_S, self._publish_diagnostics)
        self._waiting_timer = self.every(REMARKS_PERIOD_S, self._remark)

    # --- what the nodes say they do

    def configure(self) -> None:
        """Make what does the work, and the publishers; `settings` and `options` hold the parameters."""

    def activate(self) -> None:
        """Make the subscriptions, services and timers."""

    def deactivate(self) -> None:
        """Stop what `activate` started, but for what the base does."""

    def cleanup(self) -> None:
        """Let go what `configure` made, but for what the base does."""

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
        self, kind: type, topic: str, callback: Callable[..., None], qos: QoSProfile = FRAME_QOS
    ) -> Subscription:
        """A subscription to a topic's messages as bytes, which says why a publisher's do not arrive; a callback of two
        arguments gets what ROS knows of a message, too."""
        resolved = self.resolve_topic_name(topic)
        return self.create_subscription(
            kind, topic, callback, qos, raw=True, event_callbacks=reader_callbacks(self, resolved, qos)
        )

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

        def on_message(message: bytes, info: Mapping[str, int]) -> None:
            lost = arrivals.note_number(info["publication_sequence_number"], lambda: self.count_publishers(resolved))
            if lost:
                self.warn(
                    f"{resolved}: {lost} message(s) were lost ({arrivals.lost} so far), as this process stood still "
                    "for longer than DDS keeps them: give it more of the machine"
                )
            handle(message, arrivals.note())

        self.reader(kind, topic, on_message, NEEDED_QOS)
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
        self._is_starting = True
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() is not TransitionCallbackReturn.SUCCESS and self._refusal is not None:
                raise self._refusal
        self._is_starting = False

    def on_configure(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Read the parameters, compile, make what does the work."""
        return self._pass(Phase.INACTIVE, self._configure)

    def on_activate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Begin to read."""
        return self._pass(Phase.ACTIVE, self._activate)

    def on_deactivate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Read and publish no more; targets are kept."""
        return self._pass(Phase.INACTIVE, self._deactivate)

    def on_cleanup(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Forget everything but the parameters."""
        return self._pass(Phase.UNCONFIGURED, self._cleanup)

    def on_shutdown(self, _: LifecycleState) -> TransitionCallbackReturn:
        """End the process."""
        return self._pass(Phase.FINALIZED, self._end)

    def on_error(self, _: LifecycleState) -> TransitionCallbackReturn:
        """A transition has failed in a way that nobody foresaw: back to the beginning."""
        return self._pass(Phase.UNCONFIGURED, self._let_go)

    def stop(self) -> None:
        """Let everything go; the node can be destroyed then."""
        self._let_go()

    def destroy_node(self) -> None:
        """Let go of the node, and of the state machine, which would keep it and its shared memory."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def _refuse_wrong_transitions(self) -> None:
        """Answer who asks for what cannot be from here: rclpy would raise, and its caller never hear of it."""
        service = self._service_change_state
        change = service.callback

        def refuse(asked: object, why: str, response: Any) -> Any:
            self.errors += 1
            self.warn(f"transition {asked} is refused: the node is {self.phase.value} ({why})")
            response.success = False
            return response

        def answer(request: Any, response: Any) -> Any:
            label = request.transition.label
            # rclpy would answer a name that it cannot follow in silence.
            labels = {label for _, label, *_ in self._state_machine.available_transitions}
            if label and label not in labels:
                return refuse(label, f"from here it takes {', '.join(sorted(labels))}", response)
            try:
                return change(request, response)
            except RuntimeError as err:  # rclpy's own error for this has no public name
                if not self.context.ok():
                    raise
                return refuse(label or request.transition.id, ros_reason(err), response)

        service.callback = answer

    def _pass(self, phase: Phase, work: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            work()
        except EtdError as err:
            self._refusal = err
            if not self._is_starting:
                self.get_logger().error(" ".join(str(err).split()))
            return TransitionCallbackReturn.FAILURE
        except Exception as err:
            self._refusal = err
            if self.context.ok():  # else the node was told to leave, and whatever it tries fails
                # rclpy would say nothing of it.
                self.get_logger().error("".join(traceback.format_exception(err)))
            return TransitionCallbackReturn.ERROR
        self.phase = phase
        return TransitionCallbackReturn.SUCCESS

    def _configure(self) -> None:
        self.settings = self._declared.settings()
        self.options = self._declared.options(self._options_class)
        self._kept[Phase.UNCONFIGURED] = self._entities()
        try:
            self._warm_up()
            self.configure()
        except EtdError:
            self._destroy_but(self._kept[Phase.UNCONFIGURED])
            raise

    def _activate(self) -> None:
        self._kept[Phase.INACTIVE] = self._entities()
        self.worker = Worker(
            f"{self.get_name()}_worker",
            int(self.options.queue_mib * 2**20),
            self.options.queue_s,
            self.on_worker_error,
            self.dropped,
        )
        self.activate()

    def _deactivate(self) -> None:
        self._inputs.clear()
        self.deactivate()
        self._destroy_but(self._kept[Phase.INACTIVE])
        self.worker.stop()

    def _cleanup(self) -> None:
        self.cleanup()
        self._destroy_but(self._kept[Phase.UNCONFIGURED])

    def _end(self) -> None:
        self._let_go()
        self.finished.set_result(None)

    def _let_go(self) -> None:
        if self.phase is Phase.ACTIVE:
            self._deactivate()
            self.phase = Phase.INACTIVE
        if self.phase is Phase.INACTIVE:
            self._cleanup()
            self.phase = Phase.UNCONFIGURED

    def _entities(self) -> set[object]:
        return {*self.subscriptions, *self.publishers, *self.services, *self.timers}

    def _destroy_but(self, kept: set[object]) -> None:
        destroy: tuple[tuple[Iterable[Any], Callable[[Any], bool]], ...] = (
            (self.subscriptions, self.destroy_subscription),
            (self.timers, self.destroy_timer),
            (self.services, self.destroy_service),
            (self.publishers, self.destroy_publisher),
        )
        if not self.context.ok():
            return  # the node is destroyed as a whole then
        for entities, end in destroy:
            for entity in set(entities) - kept:
                end(entity)

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
