"""What `fuzz.py` gives damaged bytes to: decoders, what they promise, and good messages to start from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from etd_ros.benchmarking import encoders
from etd_ros.boxes import Box
from etd_ros.engine import FrameSource, ImageSource, PerSensor
from etd_ros.events import Events
from etd_ros.recordings import open_recording
from etd_ros.settings import Settings, settings_from_mapping
from etd_ros.stream import StreamGuard
from msg_adapters import (
    Detection,
    DiagnosticStatus,
    EventMessage,
    Evt2Decoder,
    Evt3Decoder,
    Evt21Decoder,
    Header,
    Layout,
    Level,
    PointMessage,
    SensorClock,
    Triggers,
    WordDecoder,
    decode_detections,
    decode_diagnostics,
    decode_image,
    decode_point,
    decoder_for,
    encode_detections,
    encode_diagnostics,
    encode_image,
    encode_point,
    packet_to_ros2,
)
from msg_adapters.codecs import encode_mono
from msg_adapters.header import write_header
from msg_adapters.layout import Writer

PACKET_TYPE = "event_camera_msgs/msg/EventPacket"
ARRAY_TYPES = ("dvs_msgs/msg/EventArray", "prophesee_event_msgs/msg/EventArray", "dv_ros2_msgs/msg/EventArray")
WIDTH, HEIGHT, EVENTS, SPAN_NS = 64, 48, 40, 3_000_000
START_NS = 1_700_000_000_000_000_000
RECORDED_BYTES_MAX, RECORDED_MAX = 8192, 16
EVT3_LOOP_NS = (1 << 24) * 1000
EVENTS_PER_BYTE_MAX = 6  # a mask of evt3: 12 events in 2 bytes


@dataclass(frozen=True)
class Seed:
    """A good message, and where its payload begins (bytes)."""

    message: bytes
    body: int


class BrokenPromiseError(AssertionError):
    """A decoder that accepted bytes gives what it must not."""


class Subject:
    """One decoder under test.

    Args:
        seeds: good messages.
    """

    def __init__(self, seeds: Iterable[Seed]) -> None:
        self.seeds = list(seeds)

    def take(self, message: memoryview) -> None:
        """Decode and check the result.

        Raises:
            EtdError: the message is refused.
            BrokenPromiseError: it is not, and the result is wrong.
        """
        raise NotImplementedError

    def check_recovery(self) -> None:
        """After whatever came before, a good message is decoded as by a fresh decoder.

        Raises:
            BrokenPromiseError: it is not.
        """
        raise NotImplementedError


class EventSubject(Subject):
    """Messages of events of one type; the first seed is the good message."""

    def __init__(self, type_name: str, layout: Layout, seeds: Iterable[Seed], loop_ns: int = 1) -> None:
        super().__init__(seeds)
        self._make = partial(decoder_for, type_name, layout)
        self._decoder = self._make()
        self._loop_ns = loop_ns
        self._converts = layout is Layout.ROS1 and type_name == PACKET_TYPE
        self._expected = self._make().decode(self.seeds[0].message)

    def take(self, message: memoryview) -> None:
        decoded = self._decoder.decode(message)
        check_events(decoded.events, decoded.triggers, len(message))
        if self._converts:
            packet_to_ros2(message)

    def check_recovery(self) -> None:
        good = self.seeds[0].message
        check_same(self._decoder.decode(good), self._expected, self._loop_ns)
        self._decoder.reset()
        check_same(self._decoder.decode(good), self._expected)


class CodecSubject(Subject):
    """Payloads of a codec that no message carries, on sensors of any size."""

    def __init__(self, make: Callable[[], WordDecoder], payload: bytes) -> None:
        super().__init__([Seed(payload, 0)])
        self._decoder, self._payload = make(), payload
        self._expected = make().decode(payload, WIDTH, HEIGHT).events

    def take(self, message: memoryview) -> None:
        decoded = self._decoder.decode(message, 1 + 251 * (len(message) % 255), 1 + 257 * (len(message) % 253))
        check_events(decoded.events, decoded.triggers, len(message))

    def check_recovery(self) -> None:
        self._decoder.reset()
        check_same_events(self._decoder.decode(self._payload, WIDTH, HEIGHT).events, self._expected)


class FunctionSubject(Subject):
    """A decoder without state."""

    def __init__(self, decode: Callable[[Any], Any], message: bytes, check: Callable[[Any, int], None]) -> None:
        super().__init__([Seed(message, len(message) // 2)])
        self._decode, self._check = decode, check
        self._expected = repr(decode(message))

    def take(self, message: memoryview) -> None:
        self._check(self._decode(message), len(message))

    def check_recovery(self) -> None:
        if repr(self._decode(self.seeds[0].message)) != self._expected:
            msg = "a good message is decoded otherwise than at the start"
            raise BrokenPromiseError(msg)


class StreamSubject(Subject):
    """Packets of every encoding through all that a node does with events: decoder, clock, guard, frames and images."""

    def __init__(self, seeds: Iterable[Seed]) -> None:
        super().__init__(seeds)
        settings = settings_from_mapping({"noise_filter.window_s": 0.01})
        self._decoder = decoder_for(PACKET_TYPE, Layout.ROS2)
        self._clock, self._guard = SensorClock(), StreamGuard()
        self._frames = PerSensor(lambda *size: FrameSource("atsltd_fine", *size, settings))
        self._images = PerSensor(lambda *size: ImageSource(*size, Settings()))

    def take(self, message: memoryview) -> None:
        decoded = self._decoder.decode(message)
        events = self._clock.to_ros(decoded)
        for batch in self._guard.feed(events, seq=decoded.seq, encoding=decoded.encoding):
            images = self._images.at(batch)
            for part in self._frames.at(batch).parts(batch):
                made = images.take(part)
                if made.frame is not None:
                    _check_frame(made.frame.data, made.image, decoded.events)
                    encode_image(made.frame.data, stamp_ns=made.frame.stamp_ns, frame_id=decoded.frame_id)

    def check_recovery(self) -> None:
        """Good packets of each encoding go through."""
        for seed in self.seeds:
            self.take(memoryview(seed.message))


def check_events(events: Events, triggers: Triggers, message_bytes: int) -> None:
    """Verify what decoders promise of what they accept.

    Raises:
        BrokenPromiseError: an event off the sensor, a polarity of neither, or more events than the bytes can hold.
    """
    count = len(events)
    if not len(events.x) == len(events.y) == len(events.p) == count or len(triggers.id) != len(triggers.edge):
        msg = "columns of different lengths"
        raise BrokenPromiseError(msg)
    if count + len(triggers) > EVENTS_PER_BYTE_MAX * message_bytes:
        msg = f"{count} events and {len(triggers)} triggers from {message_bytes} bytes"
        raise BrokenPromiseError(msg)
    if count and not (events.x.max() < events.width and events.y.max() < events.height and events.p.max() <= 1):
        msg = f"events up to ({events.x.max()}, {events.y.max()}, {events.p.max()}) of {events.width}x{events.height}"
        raise BrokenPromiseError(msg)


def check_same(found: EventMessage, expected: EventMessage, loop_ns: int = 1) -> None:
    """Compare decoded messages; sensor times may differ by whole loops of their counter.

    Raises:
        BrokenPromiseError: they differ.
    """
    shift = int(found.events.t[0] - expected.events.t[0]) if len(found.events) and len(expected.events) else 0
    if shift % loop_ns or (loop_ns == 1 and shift):
        msg = f"a good message's times are off by {shift} ns"
        raise BrokenPromiseError(msg)
    if found._replace(events=expected.events, triggers=expected.triggers) != expected:
        msg = "a good message's fields are not those that a fresh decoder gives"
        raise BrokenPromiseError(msg)
    check_same_events(found.events, expected.events, shift)


def check_same_events(found: Events, expected: Events, shift_ns: int = 0) -> None:
    """Compare events, times up to a shift.

    Raises:
        BrokenPromiseError: they differ.
    """
    same_times = np.array_equal(found.t - shift_ns, expected.t)
    if not same_times or any(not np.array_equal(getattr(found, k), getattr(expected, k)) for k in "xyp"):
        msg = "a good message's events are not those that a fresh decoder gives"
        raise BrokenPromiseError(msg)


def _check_frame(data: npt.NDArray[np.uint8], image: npt.NDArray[np.uint8] | None, events: Events) -> None:
    if data.shape != (events.height, events.width, 2) or image is None or image.shape != data.shape[:2]:
        msg = f"a frame of {data.shape} from a sensor of {events.width}x{events.height}"
        raise BrokenPromiseError(msg)


def _check_image(decoded: Any, message_bytes: int) -> None:
    # All of it is read, so that a view beyond the message meets the guard behind it.
    if decoded.data.nbytes > message_bytes or int(decoded.data.max()) < 0:
        msg = f"an image of {decoded.data.nbytes} bytes from a message of {message_bytes}"
        raise BrokenPromiseError(msg)


def _check_count(name: str, decoded: Any, message_bytes: int) -> None:
    count = len(getattr(decoded, name))
    if count > message_bytes // 8:
        msg = f"{count} {name} from {message_bytes} bytes"
        raise BrokenPromiseError(msg)


def _check_point(decoded: PointMessage, message_bytes: int) -> None:
    if len(decoded.frame_id) > message_bytes:
        msg = f"a frame id of {len(decoded.frame_id)} letters from {message_bytes} bytes"
        raise BrokenPromiseError(msg)


@cache
def _events() -> Events:
    rng = np.random.default_rng(5)
    t = START_NS + np.sort(rng.integers(0, SPAN_NS // 1000, EVENTS)) * 1000
    x, y = rng.integers(0, WIDTH, EVENTS, np.uint16), rng.integers(0, HEIGHT, EVENTS, np.uint16)
    return Events(t, x, y, rng.integers(0, 2, EVENTS, np.uint8), WIDTH, HEIGHT)


def _payload(encoding: str) -> bytes:
    events = _events()
    if encoding == "evt3":
        return encoders.evt3_payload(events, START_NS)
    if encoding == "libcaer_cmp":
        return encoders.libcaer_cmp_payload(events, START_NS)
    if encoding == "libcaer":
        return encoders.libcaer_payload(events, START_NS)
    return encode_mono(events, START_NS).tobytes()  # the words of `trigger` are made alike


def _raw_words(word_bytes: int) -> bytes:
    """Events as evt2 (4 bytes) or evt21 (8 bytes, a mask of two pixels): each behind a word of its time's high bits."""
    events = _events()
    us = (events.t - START_NS).astype(np.uint64) // np.uint64(1000)
    high = np.uint64(0x8 << 28) | us >> np.uint64(6)
    x, y, p = (column.astype(np.uint64) for column in (events.x, events.y, events.p))
    head = p << np.uint64(28) | (us & np.uint64(63)) << np.uint64(22) | x << np.uint64(11) | y
    words = np.stack([high, head], axis=1).ravel()
    return (words.astype("<u4") if word_bytes == 4 else (words << np.uint64(32) | np.uint64(3)).astype("<u8")).tobytes()


def _packet(encoding: str, layout: Layout) -> Seed:
    writer = Writer(layout)
    write_header(writer, Header(START_NS, "event_camera"))
    writer.u32(HEIGHT)
    writer.u32(WIDTH)
    writer.u64(7)
    writer.u64(START_NS)
    writer.string(encoding)
    writer.u8(0)
    payload = _payload(encoding)
    writer.byte_sequence(payload)
    message = writer.finish()
    return Seed(message, len(message) - len(payload))


def _array(layout: Layout) -> Seed:
    message = encoders.event_array(_events(), layout)
    return Seed(message, len(message) - encoders.event_array_body_size(EVENTS, layout))


def _recorded(recordings: Path | None, encoding: str, layout: Layout) -> Iterator[Seed]:
    """Short messages of this encoding and layout out of real recordings."""
    for path in sorted(recordings.iterdir()) if recordings else ():
        if path.suffix == ".json":
            continue
        with open_recording(path) as recording:
            short = (item for item in recording.messages() if len(item.data) <= RECORDED_BYTES_MAX)
            for item in islice(short, RECORDED_MAX):
                decoded = decoder_for(item.type_name, item.layout).decode(item.data)
                if (decoded.encoding, item.layout) == (encoding, layout):
                    yield Seed(item.data, 80)


def _packets(encoding: str, recordings: Path | None) -> list[Subject]:
    loop_ns = EVT3_LOOP_NS if encoding == "evt3" else 1
    return [
        EventSubject(
            PACKET_TYPE, layout, [_packet(encoding, layout), *_recorded(recordings, encoding, layout)], loop_ns
        )
        for layout in Layout
    ]


def _arrays(_: Path | None) -> list[Subject]:
    return [EventSubject(name, layout, [_array(layout)]) for layout in Layout for name in ARRAY_TYPES]


def _codec(make: Callable[[], WordDecoder], word_bytes: int) -> Callable[[Path | None], list[Subject]]:
    return lambda _: [CodecSubject(make, _raw_words(word_bytes))]


def _ros1_image(message: bytes) -> bytes:
    """A ROS 2 image in ROS 1 layout."""
    image = decode_image(message)
    writer = Writer(Layout.ROS1)
    write_header(writer, Header(image.stamp_ns, image.frame_id))
    writer.u32(image.data.shape[0])
    writer.u32(image.data.shape[1])
    writer.string(image.encoding)
    writer.u8(0)
    writer.u32(image.data[0].nbytes)
    writer.byte_sequence(np.ascontiguousarray(image.data))
    return writer.finish()


def _images(_: Path | None) -> list[Subject]:
    rng = np.random.default_rng(6)
    pictures = (rng.integers(0, 256, (7, 11, 2), np.uint8), rng.integers(0, 60000, (5, 9), np.uint16))
    subjects: list[Subject] = []
    for picture in pictures:
        message = encode_image(picture, stamp_ns=START_NS, frame_id="event_camera")
        subjects.append(FunctionSubject(decode_image, message, _check_image))
        as_ros1 = partial(decode_image, layout=Layout.ROS1)
        subjects.append(FunctionSubject(as_ros1, _ros1_image(message), _check_image))
    return subjects


def _detections(_: Path | None) -> list[Subject]:
    boxes = [Detection(id=f"box_{i}", box=Box(i, 2.0, 30.0, 4.0), score=0.5, class_id="ball") for i in range(2)]
    message = encode_detections(boxes, stamp_ns=START_NS, frame_id="event_camera")
    return [FunctionSubject(decode_detections, message, partial(_check_count, "detections"))]


def _diagnostics(_: Path | None) -> list[Subject]:
    status = DiagnosticStatus(Level.WARN, "tracker: ball", "recovering", "camera", (("target", "ball"),))
    message = encode_diagnostics([status, status], stamp_ns=START_NS)
    return [FunctionSubject(decode_diagnostics, message, partial(_check_count, "statuses"))]


def _points(_: Path | None) -> list[Subject]:
    point = PointMessage(START_NS, "event_camera", 10.0, 20.0)
    return [FunctionSubject(decode_point, encode_point(point), _check_point)]


def _streams(_: Path | None) -> list[Subject]:
    return [StreamSubject(_packet(encoding, Layout.ROS2) for encoding in ("evt3", "libcaer", "libcaer_cmp", "mono"))]


ADAPTERS: dict[str, Callable[[Path | None], list[Subject]]] = {
    "evt2": _codec(Evt2Decoder, 4),
    "evt21": _codec(Evt21Decoder, 8),
    "evt21_swapped": _codec(partial(Evt21Decoder, halves_swapped=True), 8),
    "evt3_raw": lambda _: [CodecSubject(Evt3Decoder, _payload("evt3"))],
    **{name: partial(_packets, name) for name in ("evt3", "libcaer", "libcaer_cmp", "mono", "trigger")},
    "event_array": _arrays,
    "image": _images,
    "detections": _detections,
    "diagnostics": _diagnostics,
    "point": _points,
    "stream": _streams,
}
"""Subjects by the name of their adapter, one per layout or type; given a folder of recordings or None."""
