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
import numpy.typing as npt
from numba import njit

from msg_adapters.codecs import Triggers
from msg_adapters.codecs.words import EventPool, events_on_sensor
from msg_adapters.event_message import EventMessage, checked_size
from msg_adapters.header import NS_PER_S, read_header
from msg_adapters.layout import Layout, MessageBytes, Reader

RECORD_SIZE = 13
"""Bytes of one event without padding."""

_FIELDS = ["x", "y", "sec", "nsec", "polarity"]
_RECORD_ROS1 = np.dtype({"names": _FIELDS, "formats": ["<u2", "<u2", "<u4", "<u4", "u1"], "offsets": [0, 2, 4, 8, 12]})
_RECORD_ROS2 = np.dtype({"names": _FIELDS, "formats": ["<u2", "<u2", "<i4", "<u4", "u1"], "offsets": [0, 2, 6, 10, 14]})
_STRIDE = {Layout.ROS1: 13, Layout.ROS2: 16}

_RECORDS_START_ROS2 = -2
"""Where the records of ROS 2 start (bytes after the count), so that all but the first have x and y in their place."""

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
        body = reader.blob(_STRIDE[self._layout] * (count - 1) + RECORD_SIZE if count else 0)
        columns = self._events.take(count)
        if count:
            _decode(_records(message, start, count, self._layout), *columns)
            _, x, y, _ = columns
            x[0], y[0] = _FIRST_PLACE.unpack_from(body)
        events = events_on_sensor(columns, count, width, height)
        return EventMessage(
            stamp_ns=header.stamp_ns,
            frame_id=header.frame_id,
            seq=None,
            encoding="array",
            events=events,
            is_sensor_time=False,
            triggers=Triggers.empty(),
            skipped_words=0,
            off_sensor=count - len(events),
        )

    def reset(self) -> None:
        """Nothing to forget."""


def _records(message: MessageBytes, start: int, count: int, layout: Layout) -> npt.NDArray[np.void]:
    """The events of a message whose first event is at byte `start`; x and y of the first are wrong in ROS 2."""
    data = memoryview(message).cast("B").toreadonly()
    if layout is Layout.ROS1:
        return np.frombuffer(data, _RECORD_ROS1, count, start)
    # The last record ends a byte before its stride does, and so does the message.
    return np.ndarray(count, _RECORD_ROS2, data, start + _RECORDS_START_ROS2, _STRIDE[layout])


# Signed throughout: an unsigned integer times a signed one is a float in compiled code, which loses nanoseconds.
@njit(cache=True, nogil=True)
def _decode(records, t, x, y, p):  # type: ignore[no-untyped-def]
    for i in range(len(records)):
        record = records[i]
        t[i] = np.int64(record.sec) * NS_PER_S + np.int64(record.nsec)
        x[i] = record.x
        y[i] = record.y
        p[i] = record.polarity != 0
