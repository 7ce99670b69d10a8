"""Readable encoders and decoders: what the compiled kernels of the adapters must agree with."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence

import numpy as np
from hypothesis import strategies as st

from etd_ros.events import Events
from msg_adapters import Layout

Row = tuple[int, int, int, int]
"""One event: t (ns), x, y, p."""

NS = 1_000_000_000


def events_of(rows: Sequence[Row], width: int, height: int) -> Events:
    t, x, y, p = zip(*rows, strict=True) if rows else ((), (), (), ())
    return Events(
        np.array(t, np.int64), np.array(x, np.uint16), np.array(y, np.uint16), np.array(p, np.uint8), width, height
    )


def rows_of(events: Events) -> list[Row]:
    return list(zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist(), strict=True))


def rows(width: int, height: int, time_max: int, unit_ns: int = 1, max_size: int = 60) -> st.SearchStrategy[list[Row]]:
    """Events in time order, with times of 0..time_max units."""
    event = st.tuples(
        st.integers(0, time_max), st.integers(0, width - 1), st.integers(0, height - 1), st.integers(0, 1)
    )
    return st.lists(event, max_size=max_size).map(
        lambda found: sorted(((t * unit_ns, x, y, p) for t, x, y, p in found), key=lambda row: row[0])
    )


def words(kind: str, values: Iterable[int]) -> bytes:
    return b"".join(struct.pack("<" + kind, value) for value in values)


def mono_payload(events: Sequence[Row], base_ns: int) -> bytes:
    return words("Q", (p << 63 | y << 48 | x << 32 | (t - base_ns) for t, x, y, p in events))


def libcaer_payload(events: Sequence[Row], base_ns: int) -> bytes:
    packed = b""
    for t, x, y, p in events:
        packed += struct.pack("<II", x << 17 | y << 2 | p << 1 | 1, (t - base_ns) // 1000 % (1 << 31))
    return packed


def libcaer_cmp_payload(events: Sequence[Row], base_ns: int, *, as_masks: bool) -> bytes:
    """One event by one, with every time and column said anew; as masks, each event's row is split into base and bit."""
    said = []
    for t, x, y, p in events:
        us = (t - base_ns) // 1000
        said += [0x0000 | us >> 12, 0x1000 | us & 0xFFF, 0x2000 | x]
        if as_masks:
            bit = min(y, 11)
            base = y - bit
            said += [0x4000 | p << 11 | base, *([0x5000] if bit >= 8 else []), 0x5000 | 1 << bit % 8]
        else:
            said += [0x3000 | p << 11 | y]
    return words("H", said)


def evt3_payload(events: Sequence[Row], mask_bits: int) -> bytes:
    """Single events (mask_bits 0), or each as the bit of an empty mask word and a second one (8 or 12 bits)."""
    said = [0x8000, 0x6000]
    high = 0
    for t, x, y, p in events:
        us = t // 1000
        while high < us >> 12:  # the sensor says every time high, so that wraps are seen
            high += 1
            said.append(0x8000 | high & 0xFFF)
        said += [0x6000 | us & 0xFFF, y]
        if mask_bits:
            bit = min(x, 2 * mask_bits - 1)
            code = 0x4000 if mask_bits == 12 else 0x5000
            said += [0x3000 | p << 11 | x - bit, *([code] if bit >= mask_bits else []), code | 1 << bit % mask_bits]
        else:
            said.append(0x2000 | p << 11 | x)
    return words("H", said)


def evt2_payload(events: Sequence[Row]) -> bytes:
    said = []
    for t, x, y, p in events:
        us = t // 1000
        said += [0x8 << 28 | us >> 6 & 0xFFF_FFFF, p << 28 | (us & 0x3F) << 22 | x << 11 | y]
    return words("I", said)


def evt21_payload(events: Sequence[Row], *, halves_swapped: bool = False) -> bytes:
    said = []
    for t, x, y, p in events:
        us = t // 1000
        bit = min(x, 31)
        said += [
            0x8 << 60 | (us >> 6 & 0xFFF_FFFF) << 32,
            p << 60 | (us & 0x3F) << 54 | x - bit << 43 | y << 32 | 1 << bit,
        ]
    if halves_swapped:
        said = [(word >> 32 | word << 32) & (1 << 64) - 1 for word in said]
    return words("Q", said)


def decode_evt3(payload: bytes, width: int, height: int) -> tuple[list[Row], int, int]:
    """(events, skipped words, events off the sensor), a word at a time."""
    found: list[Row] = []
    skipped = off = loop = y = base_x = p = 0
    high = low = None
    for (word,) in struct.iter_unpack("<H", payload):
        code, value = word >> 12, word & 0xFFF
        columns: list[int] = []
        if code == 0:
            y = value & 0x7FF
        elif code == 2:
            columns, p_now = [value & 0x7FF], value >> 11
        elif code == 3:
            base_x, p = value & 0x7FF, value >> 11
        elif code in (4, 5):
            bits = 12 if code == 4 else 8
            columns, p_now = [base_x + i for i in range(bits) if value >> i & 1], p
            base_x += bits
        elif code == 6:
            low = value if high is not None else None
        elif code == 8:
            loop += high is not None and value < high - 10
            high = value
        elif code in (1, 9, 0xB, 0xC, 0xD):
            skipped += 1
        if high is None or low is None:
            continue
        for x in columns:
            if x < width and y < height:
                found.append(((loop * 2**24 + (high << 12 | low)) * 1000, x, y, p_now))
            else:
                off += 1
    return found, skipped, off


def decode_libcaer_cmp(payload: bytes, width: int, height: int, base_ns: int) -> tuple[list[Row], int, int]:
    """(events, skipped words, events off the sensor), a word at a time."""
    found: list[Row] = []
    skipped = off = high = low = x = base_y = p = 0
    for (word,) in struct.iter_unpack("<H", payload):
        code, value = word >> 12, word & 0xFFF
        places: list[tuple[int, int]] = []
        if code == 0:
            high = value << 12
        elif code == 1:
            low = value
        elif code == 2:
            x = value & 0x7FF
        elif code == 3:
            places = [(value & 0x7FF, value >> 11)]
        elif code == 4:
            base_y, p = value & 0x7FF, value >> 11
        elif code == 5:
            places = [(base_y + i, p) for i in range(8) if value >> i & 1]
            base_y += 8
        else:
            skipped += 1
        for y, polarity in places:
            if x < width and y < height:
                found.append((base_ns + 1000 * (high | low), x, y, polarity))
            else:
                off += 1
    return found, skipped, off


class Bytes:
    """Serialises field by field with the alignment rules of a layout; padding is filled with noise, as on the wire."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.body = b""

    def put(self, code: str, *values: float) -> Bytes:
        for value in values:
            if self.layout is Layout.ROS2:
                self.body += b"\xaa" * (-len(self.body) % struct.calcsize(code))
            self.body += struct.pack("<" + code, value)
        return self

    def text(self, text: str) -> Bytes:
        data = text.encode() + (b"\0" if self.layout is Layout.ROS2 else b"")
        self.put("I", len(data))
        self.body += data
        return self

    def blob(self, data: bytes) -> Bytes:
        self.put("I", len(data))
        self.body += data
        return self

    def header(self, stamp_ns: int, frame_id: str) -> Bytes:
        if self.layout is Layout.ROS1:
            self.put("I", 7)
        return self.put("I", stamp_ns // NS, stamp_ns % NS).text(frame_id)

    def done(self) -> bytes:
        return (b"\x00\x01\x00\x00" if self.layout is Layout.ROS2 else b"") + self.body


def packet(
    payload: bytes,
    *,
    layout: Layout = Layout.ROS2,
    encoding: str = "mono",
    width: int = 640,
    height: int = 480,
    seq: int = 0,
    base_ns: int = 0,
    stamp_ns: int = 5 * NS + 7,
    frame_id: str = "camera",
    is_bigendian: bool = False,
) -> bytes:
    """An EventPacket."""
    message = Bytes(layout).header(stamp_ns, frame_id).put("I", height, width).put("Q", seq, base_ns).text(encoding)
    return message.put("B", is_bigendian).blob(payload).done()


def event_array(
    events: Sequence[Row], *, layout: Layout, width: int, height: int, stamp_ns: int = 1, frame_id: str = "c"
) -> bytes:
    """An EventArray, its fields aligned one by one."""
    message = Bytes(layout).header(stamp_ns, frame_id).put("I", height, width, len(events))
    for t, x, y, p in events:
        message.put("H", x, y).put("I", t // NS, t % NS).put("B", p)
    return message.done()
