"""From message bytes to events: evt3, libcaer_cmp, libcaer, mono, event_array_ros2, event_array_ros1."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from etd_ros.benchmarking import peers, subjects
from etd_ros.benchmarking.comparing import rows
from etd_ros.benchmarking.encoders import (
    ARRAY_LAYOUTS,
    FRAME_ID,
    event_array,
    event_packet,
    evt3_payload,
    libcaer_cmp_payload,
    libcaer_payload,
    packet_content,
)
from etd_ros.benchmarking.references import numpy_decoder
from etd_ros.benchmarking.report import Row
from etd_ros.benchmarking.streams import RECORDINGS, Stream
from etd_ros.events import Events
from etd_ros.recordings import open_recording
from msg_adapters import Layout, decoder_for, encode_event_packet

PACKET_TYPE = "event_camera_msgs/msg/EventPacket"
ARRAY_TYPE = "dvs_msgs/msg/EventArray"
NS_PER_US = 1000
SENSOR_TIME_US = 1_000_000
"""The sensor's time when a synthetic stream of evt3 starts."""


@dataclass(frozen=True)
class Wire:
    """Messages as bytes.

    Attributes:
        what: their encoding, named as in the rows.
        name: of the stream.
        messages: the serialised messages.
        type_name, layout: what they are.
    """

    what: str
    name: str
    messages: Sequence[bytes]
    type_name: str
    layout: Layout

    def decoded(self) -> list[Events]:
        """The events of each message."""
        decoder = decoder_for(self.type_name, self.layout)
        return [decoder.decode(message).events for message in self.messages]


def synthetic_wire(what: str, stream: Stream) -> Wire:
    """A stream as its driver would send it."""
    batches = stream.messages()
    layout = ARRAY_LAYOUTS.get(what)
    if layout is not None:
        return Wire(what, stream.name, [event_array(events, layout) for events in batches], ARRAY_TYPE, layout)
    origin_us = int(stream.events.t[0]) // NS_PER_US - SENSOR_TIME_US
    messages = [_packet(what, events, origin_us * NS_PER_US) for events in batches]
    return Wire(what, stream.name, messages, PACKET_TYPE, Layout.ROS2)


def recorded_wire(what: str, name: str, folder: Path, events_min: int) -> Wire | None:
    """The messages of a recording of `RECORDINGS`, repeated; None where the folder lacks it.

    Raises:
        RecordingError: the recording is damaged.
    """
    path = folder / RECORDINGS[name]
    if not path.exists():
        return None
    with open_recording(path) as recording:
        stored = [message for message in recording.messages() if message.topic == recording.topic]
    once = Wire(what, name, [message.data for message in stored], stored[0].type_name, stored[0].layout)
    times = -(-events_min // max(1, sum(map(len, once.decoded()))))
    return replace(once, messages=[*once.messages] * times)


def decoding(wire: Wire, rounds: int) -> Iterator[Row]:
    """Decoding to arrays, message by message; evt3 also its words alone, as its peers do, and in one block."""
    batches = wire.decoded()
    counts = [len(events) for events in batches]
    stream, units = Stream(wire.name, batches[0]), sum(counts)
    size = (stream.events.width, stream.events.height)
    ours = subjects.decoding(wire.messages, wire.type_name, wire.layout, units)
    if wire.what == "evt3":
        payloads = [packet_content(message)[1] for message in wire.messages]
        others = peers.evt3_message_decoders(payloads, size, units)
        yield from rows("evt3", stream, ours, others, rounds)
        words = replace(stream, name=f"{wire.name}, words")
        yield from rows("evt3", words, subjects.evt3_words(payloads, size, units), others, rounds)
        block = b"".join(payloads)
        message = event_packet(stream.events, "evt3", block, 0)
        ours = subjects.decoding([message], wire.type_name, wire.layout, units)
        stream = replace(stream, name=f"{wire.name}, one block")
        with peers.evt3_block_decoders(block, size, units) as block_decoders:
            yield from rows("evt3", stream, ours, block_decoders, rounds)
    elif wire.what == "libcaer_cmp":
        yield from rows(wire.what, stream, ours, [], rounds)
    else:
        yield from rows(wire.what, stream, ours, [numpy_decoder(wire.what, wire.messages, counts)], rounds)


def _packet(encoding: str, events: Events, origin_ns: int) -> bytes:
    if encoding == "mono":
        return encode_event_packet(events, stamp_ns=int(events.t[-1]), frame_id=FRAME_ID, seq=0)
    if encoding == "evt3":
        return event_packet(events, encoding, evt3_payload(events, origin_ns), origin_ns)
    time_base_ns = int(events.t[0]) // NS_PER_US * NS_PER_US
    encode = libcaer_cmp_payload if encoding == "libcaer_cmp" else libcaer_payload
    return event_packet(events, encoding, encode(events, time_base_ns), time_base_ns)
