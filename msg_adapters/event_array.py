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

import numpy as np
from numba import njit

from msg_adapters.codecs import Triggers
from msg_adapters.codecs.words import EventPool, events_on_sensor
from msg_adapters.event_message import EventMessage, checked_size
from msg_adapters.header import NS_PER_S, read_header
from msg_adapters.layout import Layout, MessageBytes, Reader

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


class EventArrayDecoder:
    """Decodes EventArrays; it has no state.

    Args:
        layout: how the messages' fields are laid out.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._events = EventPool()

    def decode(self, message: MessageBytes) -> EventMessage:
        """See `EventMessageDecoder.decode`. The header's sequence number of ROS 1 counts nothing reliably: seq is None.

        Raises:
            MessageError: cut short, or of an impossible size.
        """
        reader = Reader(message, self._layout)
        header = read_header(reader)
        height, width = reader.u32(), reader.u32()
        checked_size(width, height)
        count = reader.count(RECORD_SIZE)
        start = memoryview(message).nbytes - reader.remaining
        record = _RECORD[self._layout]
        body = reader.blob(record.itemsize * (count - 1) + RECORD_SIZE if count else 0)
        columns = self._events.reserve(count)
        off_sensor = 0
        if count:
            data = memoryview(message).cast("B").toreadonly()
            records = np.frombuffer(data, record, count, start + _RECORDS_START[self._layout])
            off_sensor = _decode(records, *_FIRST_PLACE.unpack_from(body), width, height, *columns)
        events = events_on_sensor(columns, count, off_sensor, width, height)
        return EventMessage(
            stamp_ns=header.stamp_ns,
            frame_id=header.frame_id,
            seq=None,
            encoding="array",
            events=events,
            is_sensor_time=False,
            triggers=Triggers.empty(),
            skipped_words=0,
            off_sensor=off_sensor,
        )

    def reset(self) -> None:
        """Nothing to forget."""


# Signed throughout: an unsigned integer times a signed one is a float in compiled code, which loses nanoseconds.
@njit(cache=True, nogil=True)
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
