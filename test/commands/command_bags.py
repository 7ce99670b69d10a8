"""Small bags for the commands' tests, sound and damaged."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from etd_ros.events import Events
from etd_ros.recordings.bag_writer import EVENT_PACKET_DEFINITION, EVENT_PACKET_TYPE, BagWriter
from msg_adapters import encode_event_packet

TOPIC = "/event_camera/events"
WIDTH, HEIGHT = 64, 48
START_NS = 1_000_000_000
SIZE_OFFSET = 20
"""Of the height in a packet with the frame_id "cam"; the width follows."""


def some_events(count: int = 2000) -> Events:
    rng = np.random.default_rng(1)
    t = START_NS + np.sort(rng.integers(0, 50_000_000, count))
    x, y = (rng.integers(0, size, count, dtype=np.uint16) for size in (WIDTH, HEIGHT))
    return Events(t, x, y, rng.integers(0, 2, count, dtype=np.uint8), WIDTH, HEIGHT)


def sound_packets() -> list[bytes]:
    events = some_events()
    parts = [events[start : start + 500] for start in range(0, len(events), 500)]
    return [encode_event_packet(part, stamp_ns=START_NS, frame_id="cam", seq=seq) for seq, part in enumerate(parts)]


def write_bag(path: Path, packets: Sequence[bytes], topics: Sequence[str] = (TOPIC,)) -> Path:
    with BagWriter(path, {EVENT_PACKET_TYPE: EVENT_PACKET_DEFINITION}) as bag:
        for topic in topics:
            bag.add_topic(topic, EVENT_PACKET_TYPE, reliable=False)
        for seq, packet in enumerate(packets):
            for topic in topics:
                bag.write(topic, START_NS + seq, packet)
    return path


def sound(path: Path) -> Path:
    return write_bag(path, sound_packets())


def two_topics(path: Path) -> Path:
    return write_bag(path, sound_packets(), ("/left/events", "/right/events"))


def no_event_topic(path: Path) -> Path:
    with BagWriter(path, {}) as bag:
        bag.add_topic("/clock", "rosgraph_msgs/msg/Clock", reliable=False)
        bag.write("/clock", START_NS, b"\0\1\0\0" + bytes(8))
    return path


def unknown_encoding(path: Path) -> Path:
    return write_bag(path, [packet.replace(b"mono", b"nono") for packet in sound_packets()])


def message_cut_short(path: Path) -> Path:
    first, second, *rest = sound_packets()
    return write_bag(path, [first, second[:-7], *rest])


def sized(path: Path, width: int, height: int) -> Path:
    size = struct.pack("<II", height, width)
    packets = sound_packets()
    assert packets[0][SIZE_OFFSET : SIZE_OFFSET + 8] == struct.pack("<II", HEIGHT, WIDTH)
    return write_bag(path, [packet[:SIZE_OFFSET] + size + packet[SIZE_OFFSET + 8 :] for packet in packets])


def no_width(path: Path) -> Path:
    return sized(path, 0, HEIGHT)


def too_high(path: Path) -> Path:
    return sized(path, WIDTH, 65536)


def truncated_storage(path: Path) -> Path:
    """A bag's storage file that breaks off in the middle."""
    file = next(sound(path).glob("*.mcap"))
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])
    return path


def without_messages(path: Path) -> Path:
    return write_bag(path, [])
