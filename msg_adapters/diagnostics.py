"""diagnostic_msgs/DiagnosticArray in ROS 2 layout.

DiagnosticArray: Header header; DiagnosticStatus[] status
DiagnosticStatus: byte level; string name; string message; string hardware_id; KeyValue[] values
KeyValue: string key; string value
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from msg_adapters.header import Header, read_header, write_header
from msg_adapters.layout import Layout, MessageBytes, MessageError, Reader, Writer

# Fewest bytes in CDR of a status (level, padding, three lengths, a count) and of a pair (two lengths).
_STATUS_SIZE_MIN = 1 + 4 * 4
_VALUE_SIZE_MIN = 4 + 4


class Level(IntEnum):
    """How a component fares."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class DiagnosticStatus:
    """How one component fares.

    Attributes:
        level: at a glance.
        name: the component.
        message: in a few words.
        hardware_id: the hardware it runs on.
        values: (key, value) pairs, as text.
    """

    level: Level
    name: str
    message: str
    hardware_id: str
    values: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class DiagnosticsMessage:
    """Several components at one time.

    Attributes:
        stamp_ns: the header's stamp (ns).
        frame_id: the header's coordinate frame.
        statuses: in the order sent.
    """

    stamp_ns: int
    frame_id: str
    statuses: tuple[DiagnosticStatus, ...]


def encode_diagnostics(statuses: Sequence[DiagnosticStatus], *, stamp_ns: int, frame_id: str = "") -> bytes:
    """A diagnostic_msgs/msg/DiagnosticArray in ROS 2 layout.

    Raises:
        MessageError: a stamp or text does not fit the message.
    """
    writer = Writer()
    write_header(writer, Header(stamp_ns, frame_id))
    writer.u32(len(statuses))
    for status in statuses:
        writer.u8(status.level)
        writer.string(status.name)
        writer.string(status.message)
        writer.string(status.hardware_id)
        writer.u32(len(status.values))
        for key, value in status.values:
            writer.string(key)
            writer.string(value)
    return writer.finish()


def decode_diagnostics(message: MessageBytes) -> DiagnosticsMessage:
    """The statuses of a diagnostic_msgs/msg/DiagnosticArray in ROS 2 layout.

    Raises:
        MessageError: cut short, not of this type, or of an unknown level.
    """
    reader = Reader(message, Layout.ROS2)
    header = read_header(reader)
    statuses = tuple(_read_status(reader) for _ in range(reader.count(_STATUS_SIZE_MIN)))
    return DiagnosticsMessage(header.stamp_ns, header.frame_id, statuses)


def _read_status(reader: Reader) -> DiagnosticStatus:
    level = reader.u8()
    if level not in tuple(Level):
        msg = f"a diagnostic status has level {level}: known are 0 (OK), 1 (WARN), 2 (ERROR) and 3 (STALE)"
        raise MessageError(msg)
    name, text, hardware_id = reader.string(), reader.string(), reader.string()
    values = tuple((reader.string(), reader.string()) for _ in range(reader.count(_VALUE_SIZE_MIN)))
    return DiagnosticStatus(Level(level), name, text, hardware_id, values)
