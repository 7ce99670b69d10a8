"""Typed, described, ranged parameters: one frozen dataclass an area serves as configuration, as ROS
parameters, as command-line settings and as the README's tables."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from etd_ros.errors import EtdError

T = TypeVar("T", bound="Parameters")
KINDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


class ParameterError(EtdError):
    """A parameter that is unknown, of the wrong type, or out of its range."""


@dataclass(frozen=True, slots=True)
class Description:
    """What a parameter means and may be. `low` and `high` are inclusive and hold for every element of a tuple."""

    text: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()


def parameter(
    default: Any,
    text: str,
    *,
    low: float | None = None,
    high: float | None = None,
    choices: Sequence[str] = (),
) -> Any:
    """A dataclass field with a default (bool, int, float, str, or a tuple of floats or of texts) and a description. A
    tuple of floats keeps its length, one of texts may have any."""
    return dataclasses.field(default=default, metadata={"description": Description(text, low, high, tuple(choices))})


class Parameters:
    """Base of configuration dataclasses: checks every described field on construction."""

    def __post_init__(self) -> None:
        for name, _, description in described(type(self)):
            _check(name, getattr(self, name), description)


def described(config: type[Parameters]) -> Iterator[tuple[str, Any, Description]]:
    """(name, default, description) of each parameter of a configuration class, in order."""
    for field in dataclasses.fields(config):  # type: ignore[arg-type]
        if "description" in field.metadata:
            yield field.name, field.default, field.metadata["description"]


def from_mapping(config: type[T], values: Mapping[str, Any]) -> T:
    """A configuration from names and values, each converted to the type of its default.

    Raises:
        ParameterError: an unknown name, a value of another type, or one out of range.
    """
    defaults = {name: default for name, default, _ in described(config)}
    unknown = sorted(set(values) - set(defaults))
    if unknown:
        msg = f"unknown parameter {unknown[0]!r}{meant(unknown[0], defaults)}: known are {', '.join(sorted(defaults))}"
        raise ParameterError(msg)
    return config(**{name: _convert(name, value, defaults[name]) for name, value in values.items()})


def meant(name: str, known: Iterable[str]) -> str:
    """After a name that is not known, for a message: which one may be meant, "" if none is like it."""
    near = nearest(name, known)
    return f" (is {near} meant?)" if near else ""


def nearest(name: str, known: Iterable[str], likeness_min: float = 0.6) -> str | None:
    """The known name that is most like another one, if it is so much so (0 to 1, as difflib has it)."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=likeness_min)
    return near[0] if near else None


def kind_of(default: Any) -> str:
    """What a parameter with this default takes, in words."""
    if isinstance(default, tuple):
        return "a list of texts" if isinstance(default[0], str) else f"a list of {len(default)} numbers"
    return KINDS[type(default)]


def _convert(name: str, value: Any, default: Any) -> Any:
    if isinstance(default, tuple):
        of_texts = isinstance(default[0], str)
        is_list = isinstance(value, Sequence) and not isinstance(value, str | bytes)
        if not is_list or not (of_texts or len(value) == len(default)):
            msg = f"parameter {name} needs {kind_of(default)}, not {value!r}"
            raise ParameterError(msg)
        return tuple(_convert(name, item, default[0]) for item in value)
    if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not type(default):
        msg = f"parameter {name} needs {kind_of(default)}, not {value!r}"
        raise ParameterError(msg)
    return value


def _check(name: str, value: Any, description: Description) -> None:
    for item in value if isinstance(value, tuple) else (value,):
        if isinstance(item, float) and not math.isfinite(item):
            msg = f"parameter {name} = {item} is not a finite number"
            raise ParameterError(msg)
        below = description.low is not None and item < description.low
        above = description.high is not None and item > description.high
        if below or above:
            low = "-inf" if description.low is None else f"{description.low:g}"
            high = "inf" if description.high is None else f"{description.high:g}"
            msg = f"parameter {name} = {item} is out of range [{low}, {high}]"
            raise ParameterError(msg)
        if description.choices and item not in description.choices:
            msg = f"parameter {name} = {item!r} is unknown: choose one of {', '.join(description.choices)}"
            raise ParameterError(msg)
