"""A node's parameters: declared when it starts, read when it is configured; some may change while it runs."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import yaml
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterUninitializedException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from etd_ros.nodes.arguments import given_parameters, warn_of_files_without_parameters, warn_of_unknown_parameters
from etd_ros.parameters import Description, ParameterError, Parameters, from_mapping, kind_of, parameter
from etd_ros.parameters import described as described_options
from etd_ros.settings import Settings, described_settings, settings_from_mapping

AT_ONCE = frozenset({"stream", "noise_filter", "atsltd", "fixed_window", "fixed_count", "reconstruction"})
"""Stages whose parameters hold from the next events on."""
_WIRING = frozenset({"atsltd.entropy_region"})
"""What decides how the parts of a node are connected."""
_FLOAT_MAX = sys.float_info.max
_INT_MAX = 2**63 - 1

OptionsT = TypeVar("OptionsT", bound=Parameters)


@dataclass(frozen=True, slots=True)
class NodeOptions(Parameters):
    """Parameters that every node has."""

    AT_ONCE: ClassVar[frozenset[str]] = frozenset({"queue_mib", "queue_s"})
    """Those that hold at once when they are set while the node runs."""

    autostart: bool = parameter(True, "configure and activate at the start; else the life cycle's services do")
    queue_mib: float = parameter(
        64.0,
        "longest queue of messages (MiB); beyond it the oldest are dropped and counted",
        low=1.0,
        high=4096.0,
    )
    queue_s: float = parameter(
        0.08,
        "longest wait of a message in the queue (s); beyond it the older half is dropped and counted",
        low=0.001,
        high=3600.0,
    )


class NodeParameters:
    """Declares the parameters, and answers whoever sets one.

    Args:
        node: whose parameters they are.
        stages: of `Settings`.
        options: configuration class of the node's own parameters.
        at_once: those options that may change while the node runs.
        is_configured: whether the node has read its parameters.
        changed: called with the full names of those that were changed since.
    """

    def __init__(
        self,
        node: Node,
        stages: tuple[str, ...],
        options: type[Parameters],
        *,
        at_once: Iterable[str],
        is_configured: Callable[[], bool],
        changed: Callable[[set[str]], None],
    ) -> None:
        self._node = node
        self._options = options
        self._at_once = frozenset(at_once)
        self._is_configured = is_configured
        self._changed = changed
        self._settings_names = self._declare(described_settings(stages))
        self._options_names = self._declare(described_options(options))
        warn_of_unknown_parameters(node)
        warn_of_files_without_parameters(node)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._take)

    def settings(self) -> Settings:
        """Of the method's stages, as the parameters are now.

        Raises:
            ParameterError: they contradict each other.
        """
        return settings_from_mapping(self._values(self._settings_names))

    def options(self, config: type[OptionsT]) -> OptionsT:
        """The node's own, as the parameters are now.

        Raises:
            ParameterError: one of them is out of range.
        """
        return from_mapping(config, self._values(self._options_names))

    def _values(self, names: Iterable[str]) -> dict[str, Any]:
        return {name: self._value(name) for name in names}

    def _value(self, name: str) -> Any:
        try:
            return _plain(self._node.get_parameter(name).value)
        except ParameterUninitializedException:
            # A list of nothing is of no type: ROS takes it for no value.
            return ()

    def _declare(self, described: Iterable[tuple[str, Any, Description]]) -> list[str]:
        names = []
        for name, default, description in described:
            initial = list(default) if isinstance(default, tuple) else default
            try:
                self._node.declare_parameter(name, initial, _descriptor(default, description))
            except (InvalidParameterTypeException, InvalidParameterValueException) as err:
                raise _refused(name, given_parameters(self._node)[name].value, default, description) from err
            names.append(name)
        return names

    def _check(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        new = {parameter.name: _plain(parameter.value) for parameter in parameters}
        try:
            settings_from_mapping({**self._values(self._settings_names), **_only(new, self._settings_names)})
            from_mapping(self._options, {**self._values(self._options_names), **_only(new, self._options_names)})
        except ParameterError as err:
            return SetParametersResult(successful=False, reason=str(err))
        fixed = [name for name, value in new.items() if not self._may_become(name, value)]
        if self._is_configured() and fixed:
            node = self._node.get_fully_qualified_name()
            reason = (
                f"{fixed[0]} is read when the node is configured: `ros2 lifecycle set {node}` deactivate and cleanup, "
                "set it, then configure and activate"
            )
            return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)

    def _may_become(self, name: str, value: Any) -> bool:
        """Whether a configured node can go on with this value."""
        if name not in self._settings_names and name not in self._options_names:
            return True  # not ours, such as use_sim_time
        if value == self._value(name) or name in self._at_once:
            return True
        return name in self._settings_names and name not in _WIRING

    def _take(self, parameters: Sequence[Parameter]) -> None:
        names = {parameter.name for parameter in parameters} & {*self._settings_names, *self._options_names}
        if self._is_configured() and names:
            self._changed(names)


def _only(values: dict[str, Any], names: Iterable[str]) -> dict[str, Any]:
    return {name: values[name] for name in names if name in values}


def _plain(value: Any) -> Any:
    """A parameter's value as the configuration classes take it: lists come as arrays."""
    return value if isinstance(value, str | bool | int | float) or value is None else tuple(value)


def _refused(name: str, value: Any, default: Any, description: Description) -> ParameterError:
    """Why a parameter cannot be declared with a value, with an example: ROS takes no 1 for 1.0, and no 5 for a text."""
    example = yaml.safe_dump(
        str(value) if isinstance(default, str) else default, default_flow_style=True, width=_INT_MAX
    )
    limits = "".join(
        f" {word} {limit:g}"
        for word, limit in (("from", description.low), ("to", description.high))
        if limit is not None
    )
    return ParameterError(
        f"parameter {name} needs {kind_of(default)}{limits}, not {value!r}: write it as in {example.splitlines()[0]}"
    )


def _descriptor(default: Any, description: Description) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=description.text)
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
