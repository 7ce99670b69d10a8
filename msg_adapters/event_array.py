"""EventArray of dvs_msgs, prophesee_event_msgs and dv_ros2_msgs: one record of fields an event.

    std_msgs/Header header; uint32 height; uint32 width; Event[] events
    Event: uint16 x; uint16 y; time ts (sec, nsec); bool polarity

Offsets (bytes) of event k's fields from the first byte after the count:

             x            y          sec       nsec      polarity   the body's end
    ROS 1    13k          13k + 2    13k + 4   13k + 8   13k + 12   13n
    ROS 2    16k - 2 *    16k *      16k + 4   16k + 8   16k + 12   16(n - 1) + 13

    * but x at 0 and y at 2 for k = 0: CDR aligns the members one by one, and nothing aligns x after the last polarity
      but its own two bytes.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from etd_ros.borrowing_kernel import borrowing_kernel
from etd_ros.events import Events
from msg_adapters.codecs import Triggers
from msg_adapters.codecs.words import EventPool, events_on_sensor
from msg_adapters.common_fields import SENSOR_SIZE, SEQUENCE_LENGTH, CommonFields, header_fields
from msg_adapters.event_message import EventMessage, checked_size
from msg_adapters.header import NS_PER_S, read_header
from msg_adapters.layout import Layout, MessageBytes, Reader, byte_view, cut_short

RECORD_SIZE = 13
"""Bytes of one event without padding."""


def _record(seconds: str, offsets: list[int]) -> np.dtype[np.void]:
    formats = ["<u2", "<u2", seconds, "<u4", "u1"]
    return np.dtype({"names": ["x", "y", "sec", "nsec", "polarity"], "formats": formats, "offsets": offsets})


_RECORD = {Layout.ROS1: _record("<u4", [0, 2, 4, 8, 12]), Layout.ROS2: _record("<i4", [1, 3, 7, 11, 15])}
"""Events as packed records, which kernels read in place."""

_RECORDS_START = {Layout.ROS1: 0, Layout.ROS2: -3}
"""Where the records start (bytes after the count): those of ROS 2 such that the last one ends where the message does.
Only the first event's x and y are not where its record has them."""

_FIRST_PLACE = struct.Struct("<HH")


class _Known(NamedTuple):
    """What the messages of a topic have in common."""

    common: CommonFields
    frame_id: str
    width: int
    height: int


class EventArrayDecoder:
    """Decodes EventArrays; it has no state that a message's events depend on.

    Args:
        layout: how the messages' fields are laid out.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._record = _RECORD[layout]
        self._records_start = _RECORDS_START[layout]
        self._known: _Known | None = None
        self._events = EventPool()

    def decode(self, message: MessageBytes) -> EventMessage:
        """See `EventMessageDecoder.decode`. The header's sequence number of ROS 1 counts nothing reliably: seq is None.

        Raises:
            MessageError: cut short, or of an impossible size.
        """
        view = byte_view(message)
        known = self._known
        fields = known.common.read(view) if known else None
        if known is None or fields is None:
            known = self._read_first(view)
            fields = known.common.first
        _, seconds, nanoseconds, _, _, count = fields
        events, off_sensor = self._read_events(view, known, count)
        return EventMessage(
            seconds * NS_PER_S + nanoseconds,
            known.frame_id,
            None,  # seq
            "array",
            events,
            False,  # is_sensor_time
            Triggers.empty(),
            0,  # skipped_words
            off_sensor,
        )

    def reset(self) -> None:
        """Nothing to forget."""

    def _read_events(self, view: memoryview, known: _Known, count: int) -> tuple[Events, int]:
        """The events on the sensor, and the number of the others."""
        width, height = known.width, known.height
        if not count:
            return Events.empty(width, height), 0
        start = known.common.size
        if start + self._record.itemsize * (count - 1) + RECORD_SIZE > len(view):
            raise cut_short(count, "items", start, len(view) - start)
        records = np.frombuffer(view, self._record, count, start + self._records_start)
        first_x, first_y = _FIRST_PLACE.unpack_from(view, start)
        columns = self._events.reserve(count)
        off_sensor = _decode(records, first_x, first_y, width, height, *columns)
        return events_on_sensor(columns, count, off_sensor, width, height), off_sensor

    def _read_first(self, view: memoryview) -> _Known:
        """Read and check field by field a message that differs from the last one in what they have in common."""
        reader = Reader(view, self._layout)
        header = read_header(reader)
        height, width = reader.u32(), reader.u32()
        checked_size(width, height)
        reader.count(RECORD_SIZE)
        common = CommonFields(view, self._layout, [*header_fields(view, self._layout), SENSOR_SIZE, SEQUENCE_LENGTH])
        self._known = _Known(common, header.frame_id, width, height)
        return self._known


# Signed throughout: an unsigned integer times a signed one is a float in compiled code, which loses nanoseconds.
@borrowing_kernel
def _decode(records, first_x, first_y, width, height, t, x, y, p):  # type: ignore[no-untyped-def]
    """The number of events off the sensor."""
    column_end, row_end = np.uint16(width), np.uint16(height)
    for i in range(len(records)):
        record = records[i]
        t[i] = np.int64(record.sec) * NS_PER_S + np.int64(record.nsec)
        x[i] = record.x
        y[i] = record.y
        p[i] = record.polarity != 0
    x[0], y[0] = first_x, first_y
    off_sensor = 0
    for i in range(len(records)):
        off_sensor += (x[i] >= column_end) | (y[i] >= row_end)
    return off_sensor
