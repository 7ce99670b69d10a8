"""Events as the bytes that drivers send: what the decoders are measured on. Vectorised, for millions of events."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from etd_ros.events import Events
from msg_adapters import Header, Layout
from msg_adapters.header import read_header, write_header
from msg_adapters.layout import Reader, Writer

NS_PER_US = 1000
NS_PER_S = 1_000_000_000
FRAME_ID = "event_camera"
ARRAY_LAYOUTS = {"event_array_ros2": Layout.ROS2, "event_array_ros1": Layout.ROS1}
EVT3_MASK_BITS, LIBCAER_CMP_MASK_BITS = 12, 8
HIGH_US, EVT3_HIGH_US = 4096, 16
"""How often a high time is said: when it changes; by Prophesee's sensors every 16 us in the mean (recording of a
driver)."""

ROS1_EVENT = np.dtype([("x", "<u2"), ("y", "<u2"), ("sec", "<u4"), ("nsec", "<u4"), ("polarity", "u1")])
"""An event of a ROS 1 EventArray: 13 bytes, packed."""

ROS2_RECORD = np.dtype(
    {
        "names": ["y", "first_y", "sec", "nsec", "polarity", "next_x"],
        "formats": ["<u2", "<u2", "<u4", "<u4", "u1", "<u2"],
        "offsets": [0, 2, 4, 8, 12, 14],
        "itemsize": 16,
    }
)
"""16 bytes of a ROS 2 EventArray: an event's row, time and polarity, and the next one's column. The first event's
column and row stand where other records have their row and padding."""

ROS2_TAIL_BYTES = 3
"""The last record ends after its polarity."""

IntArray = npt.NDArray[np.int64]


def event_packet(events: Events, encoding: str, payload: bytes, time_base_ns: int, seq: int = 0) -> bytes:
    """A ROS 2 EventPacket of one or more events with this payload."""
    writer = Writer(Layout.ROS2)
    write_header(writer, Header(int(events.t[-1]), FRAME_ID))
    writer.u32(events.height)
    writer.u32(events.width)
    writer.u64(seq)
    writer.u64(time_base_ns)
    writer.string(encoding)
    writer.u8(0)
    writer.byte_sequence(payload)
    return writer.finish()


def packet_content(message: bytes) -> tuple[int, bytes]:
    """(time base in ns, encoded words) of a ROS 2 EventPacket.

    Raises:
        MessageError: cut short, or no EventPacket.
    """
    reader = Reader(message, Layout.ROS2)
    read_header(reader)
    for read in (reader.u32, reader.u32, reader.u64):
        read()
    time_base_ns = reader.u64()
    reader.string()
    reader.u8()
    return time_base_ns, bytes(reader.byte_sequence())


def evt3_payload(events: Events, origin_ns: int) -> bytes:
    """Words of encoding `evt3`: single events, and masks for events side by side in a row.

    Args:
        events: in time order; those of one microsecond are sent row by row.
        origin_ns: when the sensor's time was 0 (ns).
    """
    us = (events.t - origin_ns) // NS_PER_US
    groups = _Groups(us, events.y, events.p, events.x, EVT3_MASK_BITS)
    high, low = 0x8000 | groups.us >> 12 & 0xFFF, 0x6000 | groups.us & 0xFFF
    single, base = 0x2000 | groups.polarity << 11 | groups.first, 0x3000 | groups.polarity << 11 | groups.base
    return groups.payload(high, low, groups.line, single, base, 0x4000 | groups.mask, EVT3_HIGH_US)


def libcaer_cmp_payload(events: Events, time_base_ns: int) -> bytes:
    """Words of encoding `libcaer_cmp`: single events, and masks for events side by side in a column."""
    us = (events.t - time_base_ns) // NS_PER_US
    groups = _Groups(us, events.x, events.p, events.y, LIBCAER_CMP_MASK_BITS)
    high, low = groups.us >> 12 & 0xFFF, 0x1000 | groups.us & 0xFFF
    single, base = 0x3000 | groups.polarity << 11 | groups.first, 0x4000 | groups.polarity << 11 | groups.base
    return groups.payload(high, low, 0x2000 | groups.line, single, base, 0x5000 | groups.mask, HIGH_US)


def libcaer_payload(events: Events, time_base_ns: int) -> bytes:
    """Words of encoding `libcaer`: data and time (us) of each event."""
    words = np.empty((len(events), 2), "<u4")
    x, y, p = (array.astype(np.uint32) for array in (events.x, events.y, events.p))
    words[:, 0] = x << 17 | y << 2 | p << 1 | 1
    words[:, 1] = (events.t - time_base_ns) // NS_PER_US
    return words.tobytes()


def event_array(events: Events, layout: Layout) -> bytes:
    """A dvs_msgs/EventArray of one or more events."""
    writer = Writer(layout)
    write_header(writer, Header(int(events.t[-1]), FRAME_ID))
    writer.u32(events.height)
    writer.u32(events.width)
    writer.u32(len(events))
    return writer.finish() + (_ros1_body(events) if layout is Layout.ROS1 else _ros2_body(events))


def event_array_body_size(count: int, layout: Layout) -> int:
    """Bytes of `count` events at the end of an EventArray."""
    return ROS1_EVENT.itemsize * count if layout is Layout.ROS1 else ROS2_RECORD.itemsize * count - ROS2_TAIL_BYTES


def _ros1_body(events: Events) -> bytes:
    body = np.empty(len(events), ROS1_EVENT)
    body["x"], body["y"], body["polarity"] = events.x, events.y, events.p
    body["sec"], body["nsec"] = np.divmod(events.t, NS_PER_S)
    return body.tobytes()


def _ros2_body(events: Events) -> bytes:
    body = np.zeros(len(events), ROS2_RECORD)
    body["y"], body["polarity"] = events.y, events.p
    body["sec"], body["nsec"] = np.divmod(events.t, NS_PER_S)
    body["next_x"][:-1] = events.x[1:]
    body["y"][0], body["first_y"][0] = events.x[0], events.y[0]
    return body.tobytes()[:-ROS2_TAIL_BYTES]


class _Groups:
    """Events of one time, line (row or column), polarity, and stretch of `bits` pixels along the line.

    Attributes:
        us, line, polarity: of each group, int64, shape (n,).
        base: the first pixel of the group's stretch.
        first: the group's own first pixel.
        mask: a bit for each of its pixels, from the base on.
    """

    def __init__(
        self,
        us: IntArray,
        line: npt.NDArray[np.uint16],
        p: npt.NDArray[np.uint8],
        along: npt.NDArray[np.uint16],
        bits: int,
    ) -> None:
        columns = tuple(array.astype(np.int64) for array in (along, p, line, us))
        order = np.lexsort(columns)
        pixel, polarity, line_sorted, us_sorted = (column[order] for column in columns)
        starts = np.flatnonzero(_changes([us_sorted, line_sorted, polarity, pixel // bits]))
        self.us, self.line, self.polarity = us_sorted[starts], line_sorted[starts], polarity[starts]
        self.first = pixel[starts]
        self.base = self.first // bits * bits
        self.mask = np.bitwise_or.reduceat(1 << pixel % bits, starts)

    def payload(
        self,
        high: IntArray,
        low: IntArray,
        line: IntArray,
        single: IntArray,
        base: IntArray,
        mask: IntArray,
        high_us: int,
    ) -> bytes:
        """The words of all groups: a high time for the first in each `high_us`, low time and line where they change,
        base and mask where there are several pixels."""
        is_new_high = _changes([self.us // high_us])
        is_new_time, is_new_line = _changes([self.us]), _changes([self.us, self.line])
        is_single = self.mask & (self.mask - 1) == 0
        words = np.stack([high, low, line, np.where(is_single, single, base), mask], axis=1)
        said = np.stack([is_new_high, is_new_time, is_new_line, np.ones_like(is_single), ~is_single], axis=1)
        return bytes(words[said].astype("<u2"))


def _changes(keys: Sequence[IntArray]) -> npt.NDArray[np.bool_]:
    """Where one of the keys differs from the element before it; True at the start."""
    changes = np.ones(len(keys[0]), np.bool_)
    changes[1:] = np.any([key[1:] != key[:-1] for key in keys], axis=0)
    return changes
