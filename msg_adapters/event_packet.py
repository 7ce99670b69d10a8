"""event_camera_msgs/EventPacket and its predecessor event_array_msgs/EventArray, which has the same fields.

std_msgs/Header header; uint32 height; uint32 width; uint64 seq; uint64 time_base; string encoding;
bool is_bigendian; uint8[] events
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy.typing as npt

from etd_ros.events import Events
from msg_adapters.codecs import (
    Evt3Decoder,
    LibcaerCmpDecoder,
    LibcaerDecoder,
    MonoDecoder,
    TriggerDecoder,
    WordDecoder,
    encode_mono,
)
from msg_adapters.common_fields import SENSOR_SIZE, SEQUENCE_LENGTH, CommonFields, header_fields, string_field
from msg_adapters.event_message import EventMessage, checked_size
from msg_adapters.header import NS_PER_S, Header, read_header, write_header
from msg_adapters.layout import Layout, MessageBytes, MessageError, Reader, Writer, byte_view, cut_short, known_names

_CODECS: dict[str, Callable[[], WordDecoder]] = {
    "evt3": Evt3Decoder,
    "libcaer": LibcaerDecoder,
    "libcaer_cmp": LibcaerCmpDecoder,
    "mono": MonoDecoder,
    "trigger": TriggerDecoder,
}

ENCODINGS = frozenset(_CODECS)
"""The encodings of EventPackets that can be decoded."""

# Leaves room for any packet's own span of time below 2^63 ns; it is the year 2116.
_TIME_BASE_MAX_NS = 1 << 62


class _Packet(NamedTuple):
    header: Header
    height: int
    width: int
    seq: int
    time_base_ns: int
    encoding: str
    payload: memoryview | npt.NDArray[Any]


class _Known(NamedTuple):
    """What the packets of a topic have in common."""

    common: CommonFields
    frame_id: str
    encoding: str
    width: int
    height: int


class EventPacketDecoder:
    """Decodes EventPackets; the codec's state lasts while encoding and size stay the same.

    Args:
        layout: how the messages' fields are laid out.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._known: _Known | None = None
        self._codec: WordDecoder = MonoDecoder()
        self._codec_of: tuple[str, int, int] | None = None

    def decode(self, message: MessageBytes) -> EventMessage:
        """See `EventMessageDecoder.decode`.

        Raises:
            MessageError: cut short, big-endian, of an unknown encoding, or of an impossible size or time base.
        """
        view = byte_view(message)
        known = self._known
        fields = known.common.read(view) if known else None
        if known is None or fields is None:
            known = self._read_first(view)
            fields = known.common.first
        _, seconds, nanoseconds, _, _, seq, time_base_ns, _, size = fields
        if time_base_ns > _TIME_BASE_MAX_NS:
            raise _late_time_base(time_base_ns)
        common, frame_id, encoding, width, height = known
        start = common.size
        if start + size > len(view):
            raise cut_short(size, "bytes", start, len(view) - start)
        codec = self._codec
        events, triggers, skipped_words, off_sensor = codec.decode(
            view[start : start + size], width, height, time_base_ns
        )
        stamp_ns = seconds * NS_PER_S + nanoseconds
        is_sensor_time = codec.is_sensor_time
        # What the generated method does, without another call of Python: every message makes one.
        return tuple.__new__(
            EventMessage,
            (stamp_ns, frame_id, seq, encoding, events, is_sensor_time, triggers, skipped_words, off_sensor),
        )

    def reset(self) -> None:
        """See `EventMessageDecoder.reset`."""
        # The codec is kept for its arrays: the new stream is likely of the same camera.
        self._known = None
        self._codec.reset()

    def _read_first(self, view: memoryview) -> _Known:
        """Read and check field by field a message that differs from the last one in what they have in common."""
        packet = _read_packet(view, self._layout)
        width, height = checked_size(packet.width, packet.height)
        if packet.time_base_ns > _TIME_BASE_MAX_NS:
            raise _late_time_base(packet.time_base_ns)
        codec_of = packet.encoding, width, height
        if self._codec_of != codec_of:
            self._codec, self._codec_of = _codec(packet.encoding), codec_of
        common = _common_fields(view, self._layout)
        self._known = _Known(common, packet.header.frame_id, packet.encoding, width, height)
        return self._known


def encode_event_packet(
    events: Events, *, stamp_ns: int, frame_id: str, seq: int, layout: Layout = Layout.ROS2
) -> bytes:
    """Events as an EventPacket of encoding mono, which keeps nanoseconds; its time base is the first event's time.

    Args:
        events: events of less than 2^32 ns (4.3 s), in time order.
        stamp_ns: the header's stamp (ns); also the time base where there is no event.
        frame_id: the header's coordinate frame.
        seq: count of the messages sent before.
        layout: how the message's fields are laid out.

    Raises:
        MessageError: the events span too long, or a time, row or text does not fit the message.
    """
    time_base_ns = int(events.t[0]) if len(events) else stamp_ns
    payload = encode_mono(events, time_base_ns)
    header = Header(stamp_ns, frame_id)
    return _write_packet(_Packet(header, events.height, events.width, seq, time_base_ns, "mono", payload), layout)


def packet_to_ros2(message: MessageBytes) -> bytes:
    """A ROS 1 EventPacket (or event_array_msgs/EventArray) as a ROS 2 EventPacket with the same payload.

    Raises:
        MessageError: cut short, big-endian, or of an unknown encoding.
    """
    packet = _read_packet(message, Layout.ROS1)
    _codec(packet.encoding)
    return _write_packet(packet, Layout.ROS2)


def _codec(encoding: str) -> WordDecoder:
    if encoding not in _CODECS:
        msg = f"unknown encoding {encoding!r} of events: known are {known_names(ENCODINGS)}; set the driver to one"
        raise MessageError(msg)
    return _CODECS[encoding]()


def _late_time_base(time_base_ns: int) -> MessageError:
    return MessageError(f"the EventPacket's time base of {time_base_ns} ns lies after the year 2116: it is no time")


def _common_fields(view: memoryview, layout: Layout) -> CommonFields:
    """The fields of a packet that `_read_packet` has read; the byte order is common with the encoding before it."""
    fields = [*header_fields(view, layout), SENSOR_SIZE, (8, "Q"), (8, "Q")]
    encoding = string_field(view, layout, fields, more=1)
    return CommonFields(view, layout, [*fields, encoding, SEQUENCE_LENGTH])


def _read_packet(message: MessageBytes, layout: Layout) -> _Packet:
    reader = Reader(message, layout)
    header = read_header(reader)
    height, width, seq, time_base_ns = reader.u32(), reader.u32(), reader.u64(), reader.u64()
    encoding = reader.string()
    if reader.u8():
        msg = f"the EventPacket's {encoding} words are big-endian, which no known driver sends: convert them"
        raise MessageError(msg)
    return _Packet(header, height, width, seq, time_base_ns, encoding, reader.byte_sequence())


def _write_packet(packet: _Packet, layout: Layout) -> bytes:
    writer = Writer(layout)
    write_header(writer, packet.header)
    writer.u32(packet.height)
    writer.u32(packet.width)
    writer.u64(packet.seq)
    writer.u64(packet.time_base_ns)
    writer.string(packet.encoding)
    writer.u8(0)
    writer.byte_sequence(packet.payload)
    return writer.finish()
