"""A node's life cycle: what is made on the way forth is destroyed on the way back, and what cannot be is refused."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable
from enum import Enum
from typing import Any

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.lifecycle import Node as LifecycleNode
from rclpy.task import Future

from etd_ros.errors import EtdError
from etd_ros.nodes.ros_errors import ros_reason, ros_refusals


class Phase(str, Enum):
    """Where a node is in its life cycle."""

    UNCONFIGURED = "unconfigured"
    INACTIVE = "inactive"
    ACTIVE = "active"
    FINALIZED = "finalized"


class ManagedNode(LifecycleNode):
    """A node that says what it does in `configure`, `activate`, `deactivate` and `cleanup`.

    Publishers, subscriptions, services and timers that `configure` makes are destroyed after `cleanup`, those that
    `activate` makes after `deactivate`, and either where they fail.

    Attributes:
        phase: where it is.
        finished: done once it was shut down.

    Raises:
        RosError: on construction, ROS refuses to make it.
    """

    def __init__(self, name: str) -> None:
        with ros_refusals():
            super().__init__(name)
        self.phase = Phase.UNCONFIGURED
        self.finished = Future()
        self._refusal: Exception | None = None
        self._is_starting = False
        self._kept: dict[Phase, set[object]] = {}
        self._refuse_wrong_transitions()

    # --- what a node says it does

    def configure(self) -> None:
        """Make what does the work, and the publishers."""

    def activate(self) -> None:
        """Make the subscriptions, services and timers."""

    def deactivate(self) -> None:
        """Stop what `activate` started, but for what the base does."""

    def cleanup(self) -> None:
        """Let go what `configure` made, but for what the base does."""

    def on_wrong_transition(self, text: str) -> None:
        """Say that somebody asked for what cannot be from here."""
        self.get_logger().warning(text)

    # --- the transitions

    def configure_and_activate(self) -> None:
        """Begin, without anybody who asks for it.

        Raises:
            EtdError: the parameters make no node.
        """
        self._is_starting = True
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() is not TransitionCallbackReturn.SUCCESS and self._refusal is not None:
                raise self._refusal
        self._is_starting = False

    def on_configure(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Make what does the work."""
        return self._pass(Phase.INACTIVE, self._configure)

    def on_activate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Begin to read."""
        return self._pass(Phase.ACTIVE, self._activate)

    def on_deactivate(self, _: LifecycleState) -> TransitionCallbackReturn:
        """Read and publish no more, and keep what does the work."""
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
            self.on_wrong_transition(f"transition {asked} is refused: the node is {self.phase.value} ({why})")
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
        self._add_by(self.configure)

    def _activate(self) -> None:
        self._add_by(self.activate)

    def _add_by(self, work: Callable[[], None]) -> None:
        """Have some work add what is read and published; what this phase had is kept for the way back, and all that
        there is if the work fails."""
        kept = self._kept[self.phase] = self._entities()
        try:
            work()
        except Exception:
            self._destroy_but(kept)
            raise

    def _deactivate(self) -> None:
        self.deactivate()
        self._destroy_but(self._kept[Phase.INACTIVE])

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
