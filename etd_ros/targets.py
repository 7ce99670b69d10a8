"""What to track: a name, a box and the time from which on it holds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

from etd_ros.boxes import Box
from etd_ros.errors import EtdError
from etd_ros.evaluation import read_boxes
from etd_ros.tracking import Click

EARLIEST_START_NS = 500_000_000
"""How far before the first event a target may start: a quiet scene's first event comes after the recording's start."""


class TargetError(EtdError):
    """A target that cannot be read or started."""


@dataclass(frozen=True, slots=True)
class TargetStart:
    """A target to track from a box at a time on.

    Attributes:
        name: the target's name, unique.
        box: where it is then (pixels).
        stamp_ns: from the first frame at or after this time on (ns); 0 means from the next frame on.
        class_id: what it is, as `ContourConfig.for_class` takes it; "" if that is not known.
    """

    name: str
    box: Box
    stamp_ns: int = 0
    class_id: str = ""

    def check_start(self, first_event_ns: int) -> None:
        """Refuse a start that lies clearly before the first event.

        Raises:
            TargetError: the stamp is on another clock, or too early.
        """
        check_start(self, first_event_ns)


class _Start(Protocol):
    """What starts a target: a box or a click."""

    @property
    def name(self) -> str: ...
    @property
    def stamp_ns(self) -> int: ...


StartT = TypeVar("StartT", bound=_Start)


def check_start(start: _Start, first_event_ns: int) -> None:
    """Refuse a start that lies clearly before the first event.

    Raises:
        TargetError: the stamp is on another clock, or too early.
    """
    if 0 < start.stamp_ns < first_event_ns - EARLIEST_START_NS:
        raise TargetError(_misplaced(start, f"before the first event at {first_event_ns} ns"))


def late_starts(starts: Iterable[_Start], last_frame_ns: int) -> list[str]:
    """What there is to say of starts after a recording's last frame (ns), which no frame has reached: a line each."""
    where = f"after the last frame at {last_frame_ns} ns, and is not tracked"
    return [_misplaced(start, where) for start in starts if start.stamp_ns > last_frame_ns]


def _misplaced(start: _Start, where: str) -> str:
    return f"target {start.name!r} starts at {start.stamp_ns} ns, {where}: give a stamp on the events' clock"


def targets_from_file(path: Path) -> list[TargetStart]:
    """Targets at the first row of each name in a BOXES.csv, of the class that it has there.

    Raises:
        EvaluationError: the file cannot be read or has a wrong row.
    """
    firsts = {name: rows[0] for name, rows in read_boxes(path).items()}
    return [TargetStart(name, first.box, first.stamp_ns, first.class_id) for name, first in firsts.items()]


def parse_target(text: str) -> TargetStart:
    """A target from `NAME:X,Y,W,H` or `NAME:X,Y,W,H@STAMP_NS`, which `=CLASS` may follow.

    Raises:
        TargetError: the text has another form.
    """
    name, colon, rest = text.rpartition(":")
    placed, equals, class_id = rest.partition("=")
    if equals and not class_id.strip():
        msg = f"target {text!r} has an empty class: give NAME:X,Y,W,H=CLASS, or leave = out"
        raise TargetError(msg)
    name, (x, y, w, h), stamp_ns = _parse("target", f"{name}{colon}{placed}", "X,Y,W,H")
    return TargetStart(name, Box(x, y, w, h), stamp_ns, class_id.strip())


def targets_from_text(text: str) -> list[TargetStart]:
    """Targets as `parse_target` reads them, separated by `;`.

    Raises:
        TargetError: one of them has another form, or a name occurs twice.
    """
    return unique_targets(map(parse_target, filter(None, text.split(";"))))


def parse_click(text: str) -> Click:
    """A click from `NAME:X,Y` or `NAME:X,Y@STAMP_NS`.

    Raises:
        TargetError: the text has another form.
    """
    name, (x, y), stamp_ns = _parse("click", text, "X,Y")
    return Click(name, x, y, stamp_ns)


def _parse(what: str, text: str, places: str) -> tuple[str, list[float], int]:
    """Name, numbers and stamp of `NAME:...@STAMP_NS`."""
    name, colon, rest = text.rpartition(":")
    numbers_text, _, stamp_text = rest.partition("@")
    try:
        numbers = [float(number) for number in numbers_text.split(",")]
        stamp_ns = int(stamp_text or 0)
    except ValueError as err:
        msg = f"{what} {text!r} is not NAME:{places} or NAME:{places}@STAMP_NS (pixels, nanoseconds)"
        raise TargetError(msg) from err
    if len(numbers) != len(places.split(",")):
        msg = f"{what} {text!r} is not NAME:{places} or NAME:{places}@STAMP_NS (pixels, nanoseconds)"
        raise TargetError(msg)
    if not colon or not name or stamp_ns < 0:
        msg = f"{what} {text!r} needs a name and a stamp of 0 or more: NAME:{places}@STAMP_NS"
        raise TargetError(msg)
    return name, numbers, stamp_ns


def unique_targets(targets: Iterable[StartT]) -> list[StartT]:
    """The targets (or clicks), in order.

    Raises:
        TargetError: a name occurs twice.
    """
    found: dict[str, StartT] = {}
    for target in targets:
        if target.name in found:
            msg = f"target {target.name!r} is given twice: give each target a name of its own"
            raise TargetError(msg)
        found[target.name] = target
    return list(found.values())
