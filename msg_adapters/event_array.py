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

import numpy as np
from numba import njit

from msg_adapters.codecs import Triggers
from msg_adapters.codecs.words import event_columns, filled_events
from msg_adapters.event_message import EventMessage, checked_size
from msg_adapters.header import NS_PER_S, read_header
from msg_adapters.layout import Layout, MessageBytes, Reader, as_bytes_array

RECORD_SIZE = 13
"""Bytes of one event without padding."""

_STRIDE = {Layout.ROS1: 13, Layout.ROS2: 16}
_Y, _SECONDS, _NANOSECONDS, _POLARITY = 2, 4, 8, 12
_PLACE_SHIFT_ROS2 = -2


class EventArrayDecoder:
    """Decodes EventArrays; it has no state.

    Args:
        layout: how the messages' fields are laid out.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout = layout

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
        stride = _STRIDE[self._layout]
        body = as_bytes_array(reader.blob(stride * (count - 1) + RECORD_SIZE if count else 0))
        columns = event_columns(count)
        is_ros2 = self._layout is Layout.ROS2
        kept = int(_decode(body, count, stride, _PLACE_SHIFT_ROS2 if is_ros2 else 0, is_ros2, width, height, *columns))
        return EventMessage(
            stamp_ns=header.stamp_ns,
            frame_id=header.frame_id,
            seq=None,
            encoding="array",
            events=filled_events(columns, kept, width, height),
            is_sensor_time=False,
            triggers=Triggers.empty(),
            skipped_words=0,
            off_sensor=count - kept,
        )

    def reset(self) -> None:
        """Nothing to forget."""


# Signed throughout: an unsigned integer times a signed one is a float in compiled code, which loses nanoseconds.
@njit(inline="always")
def _u16(body, at):  # type: ignore[no-untyped-def]
    return np.int64(body[at]) | np.int64(body[at + 1]) << 8


@njit(inline="always")
def _u32(body, at):  # type: ignore[no-untyped-def]
    return _u16(body, at) | _u16(body, at + 2) << 16


@njit(cache=True, nogil=True)
def _decode(body, count, stride, place_shift, has_signed_seconds, width, height, t, x, y, p):  # type: ignore[no-untyped-def]
    kept = 0
    for k in range(count):
        record = stride * k
        place = record + place_shift if k else 0
        column = _u16(body, place)
        row = _u16(body, place + _Y)
        if column < width and row < height:
            seconds = _u32(body, record + _SECONDS)
            if has_signed_seconds and seconds >= 1 << 31:
                seconds -= 1 << 32
            t[kept] = seconds * NS_PER_S + _u32(body, record + _NANOSECONDS)
            x[kept] = column
            y[kept] = row
            p[kept] = body[record + _POLARITY] != 0
            kept += 1
    return kept
