"""Small recordings for the tests, written by independent means: rosbags' writers, text, and words packed by hand."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from etd_ros.events import Events
from msg_adapters import Layout, encode_event_packet

DATA = Path(os.environ.get("ETD_DATA", Path(__file__).parents[3] / "shared" / "data"))
PACKET_TYPE = "event_camera_msgs/msg/EventPacket"
PACKET_DEFINITION = (
    "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\n"
    "bool is_bigendian\nuint8[] events\n"
)
PACKET_HASH = "RIHS01_d6fa176260b1f37e5a40845305315e150a0f18191241eb64f407442aa29844aa"
EVENT_TOPIC = "/event_camera/events"
IMAGE_TOPIC = "/event_camera/image_raw"


def random_events(count: int, *, start_ns: int = 0, step_ns: int = 1000, width: int = 64, height: int = 48) -> Events:
    rng = np.random.default_rng(count + start_ns)
    return Events(
        start_ns + step_ns * np.arange(count, dtype=np.int64),
        rng.integers(0, width, count, np.uint16),
        rng.integers(0, height, count, np.uint16),
        rng.integers(0, 2, count, np.uint8),
        width,
        height,
    )


def packets(events: Events, per_packet: int, layout: Layout = Layout.ROS2) -> list[tuple[int, bytes]]:
    """(receive time, serialised EventPacket) of each `per_packet` events."""
    parts = [events[start : start + per_packet] for start in range(0, len(events), per_packet)]
    return [
        (
            int(part.t[-1]),
            encode_event_packet(part, stamp_ns=int(part.t[0]), frame_id="cam", seq=seq, layout=layout),
        )
        for seq, part in enumerate(parts)
    ]


def write_ros2_bag(
    path: Path,
    messages: Iterable[tuple[int, bytes]],
    *,
    topics: Sequence[str] = (EVENT_TOPIC,),
    images: Iterable[tuple[int, bytes]] = (),
    storage: rosbag2.StoragePlugin = rosbag2.StoragePlugin.MCAP,
    compression: rosbag2.CompressionMode = rosbag2.CompressionMode.NONE,
) -> Path:
    """A bag with the same messages on each topic, and images on another; the path of its folder."""
    writer = rosbag2.Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(compression, rosbag2.CompressionFormat.ZSTD)
    with writer:
        connections = [
            writer.add_connection(topic, PACKET_TYPE, msgdef=PACKET_DEFINITION, rihs01=PACKET_HASH[7:])
            for topic in topics
        ]
        for receive_ns, data in messages:
            for connection in connections:
                writer.write(connection, receive_ns, data)
        for number, (receive_ns, data) in enumerate(images):
            if number == 0:
                store = get_typestore(Stores.ROS2_JAZZY)
                video = writer.add_connection(IMAGE_TOPIC, "sensor_msgs/msg/Image", typestore=store)
            writer.write(video, receive_ns, data)
    return path


def write_ros1_bag(path: Path, messages: Iterable[tuple[int, bytes]]) -> Path:
    with rosbag1.Writer(path) as writer:
        connection = writer.add_connection(
            EVENT_TOPIC, PACKET_TYPE, msgdef=PACKET_DEFINITION, md5sum="8a6101b351a64529ac77bd8b71074e52"
        )
        for receive_ns, data in messages:
            writer.write(connection, receive_ns, data)
    return path


def write_ecd(folder: Path, events: Events) -> Path:
    folder.mkdir(exist_ok=True)
    rows = zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist(), strict=True)
    lines = [f"{t // 10**9}.{t % 10**9:09d} {x} {y} {p}\n" for t, x, y, p in rows]
    (folder / "events.txt").write_text("".join(lines))
    return folder


def write_raw(path: Path, header: str, words: np.ndarray) -> Path:
    path.write_bytes(header.encode() + words.tobytes())
    return path


def evt2_words(events: Events) -> np.ndarray:
    """A time-high word before each event: type 8 with 28 bits, then type (0 Off, 1 On), 6 bits of us, x, y."""
    t_us = events.t.astype(np.uint64) // 1000
    words = np.empty((len(events), 2), "<u4")
    words[:, 0] = 0x8 << 28 | t_us >> 6
    words[:, 1] = events.p.astype(np.uint64) << 28 | (t_us & 63) << 22 | events.x.astype(np.uint64) << 11 | events.y
    return words.ravel()


def evt21_words(events: Events) -> np.ndarray:
    """As evt2 in the upper half of 64 bits, with a mask of one valid event in the lower."""
    t_us = events.t.astype(np.uint64) // 1000
    words = np.empty((len(events), 2), "<u8")
    words[:, 0] = np.uint64(0x8 << 60) | t_us >> 6 << 32
    head = events.p.astype(np.uint64) << 28 | (t_us & 63) << 22 | events.x.astype(np.uint64) << 11 | events.y
    words[:, 1] = head << 32 | np.uint64(1)
    return words.ravel()


def evt3_words(events: Events) -> np.ndarray:
    """Time high, time low, y and x of each event."""
    t_us = events.t.astype(np.uint64) // 1000
    words = np.empty((len(events), 4), "<u2")
    words[:, 0] = 0x8000 | t_us >> 12 & 0xFFF
    words[:, 1] = 0x6000 | t_us & 0xFFF
    words[:, 2] = events.y
    words[:, 3] = 0x2000 | events.p.astype(np.uint64) << 11 | events.x
    return words.ravel()
