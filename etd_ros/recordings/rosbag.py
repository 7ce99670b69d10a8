"""ROS 1 bags and ROS 2 bags (sqlite3, mcap; compressed too), read as raw bytes through rosbags."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import yaml
from rosbags import rosbag1, rosbag2

from etd_ros.events import EventsError, check_pixel_map
from etd_ros.recordings.interface import RecordedImage, RecordedMessage, Recording, RecordingError, TopicInfo
from msg_adapters import (
    EVENT_TYPES,
    IMAGE_TYPE,
    EventMessage,
    Layout,
    MessageError,
    decode_image,
    decoder_for,
    ros2_type_name,
)

STORAGE_SUFFIXES = (".mcap", ".db3")
FILE_SUFFIXES = (".bag", ".aedat4", ".raw")
"""Recordings that are given as files, and may lie in a folder that is given instead."""
NAMED_MAX = 3
SQLITE_MAGIC = b"SQLite format 3\0"
SQLITE_HEADER_BYTES = 100
SQLITE_PAGE_MAX = 65_536


class RosBagRecording(Recording):
    """A ROS bag. The event topic is found by its type.

    Args:
        path: .bag, .mcap or .db3 file, or a ROS 2 bag's folder.
        topic: the event topic, needed where the bag has several.

    Raises:
        RecordingError: the bag cannot be read, or has no event topic, or several and `topic` names none of them.
    """

    def __init__(self, path: Path, topic: str | None = None) -> None:
        self.path = path
        self._layout = Layout.ROS1 if path.suffix == ".bag" else Layout.ROS2
        self._parts = _storage_parts(path)
        for file in path.glob("*.db3") if path.is_dir() else [path]:
            _check_sqlite_length(file)
        self.kind, self.duration_ns, topics = self._read_index()
        self.topic, self.event_type = _choose_events(path, topics, topic)
        self._image_topic = _choose_images(topics, self.topic)
        first = next(self.packets(), None)
        if first is None:
            msg = f"{path}: {self.topic} holds no messages: record while the camera publishes"
            raise RecordingError(msg)
        self.width, self.height = first.events.width, first.events.height
        self.topics = tuple(
            TopicInfo(name, type_name, count, first.encoding if name == self.topic else None)
            for (name, type_name), count in sorted(topics.items())
        )

    def packets(self) -> Iterator[EventMessage]:
        decoder = decoder_for(self.event_type, self._layout)
        for number, message in enumerate(self._raw({self.topic})):
            try:
                packet = decoder.decode(message.data)
                check_pixel_map(packet.events.width, packet.events.height)
            except (MessageError, EventsError) as err:
                msg = f"{self.path}: message {number} of {self.topic}: {err}"
                raise RecordingError(msg) from err
            yield packet

    def images(self) -> Iterator[RecordedImage]:
        if self._image_topic is None:
            return
        for number, message in enumerate(self._raw({self._image_topic})):
            try:
                image = decode_image(message.data, self._layout)
            except MessageError as err:
                msg = f"{self.path}: message {number} of {self._image_topic}: {err}"
                raise RecordingError(msg) from err
            pixels = image.data[:, :, ::-1] if image.encoding == "rgb8" else image.data
            yield RecordedImage(image.stamp_ns, image.frame_id, pixels)

    def messages(self) -> Iterator[RecordedMessage]:
        return self._raw({self.topic} | ({self._image_topic} if self._image_topic else set()))

    def _read_index(self) -> tuple[str, int, dict[tuple[str, str], int]]:
        """(container, duration in ns, number of messages by topic and type)."""
        counts: dict[tuple[str, str], int] = {}
        start_ns, end_ns = [], []
        for part in self._parts:
            with _translated(self.path, partial(_open_reader, part)) as reader:
                for key, count in _translated(self.path, partial(_topics_of, reader)):
                    counts[key] = counts.get(key, 0) + count
                start_ns.append(reader.start_time)
                end_ns.append(reader.end_time)
        duration_ns = max(0, max(end_ns) - min(start_ns) - 1)
        kind = "ROS 1 bag" if self._layout is Layout.ROS1 else "ROS 2 bag"
        return kind, duration_ns, counts

    def _raw(self, topics: set[str]) -> Iterator[RecordedMessage]:
        """Messages of these topics. A reader of its own per iteration, since readers keep one file position."""
        for part in self._parts:
            with _translated(self.path, partial(_open_reader, part)) as reader:
                wanted = [connection for connection in reader.connections if connection.topic in topics]
                if not wanted:
                    continue
                stored = reader.messages(wanted)
                while (message := _translated(self.path, partial(_next_of, stored, self._layout))) is not None:
                    yield message


def _open_reader(part: Path) -> Any:
    reader = rosbag1.Reader(part) if part.suffix == ".bag" else rosbag2.Reader(part)
    reader.open()
    return _Opened(reader)


def _topics_of(reader: Any) -> list[tuple[tuple[str, str], int]]:
    """Each connection's topic and type, and its number of messages.

    Raises:
        TypeError: a name is no text, as a damaged database's may be.
    """
    found = []
    for connection in reader.connections:
        if not isinstance(connection.topic, str) or not isinstance(connection.msgtype, str):
            msg = f"topic {connection.topic!r} of type {connection.msgtype!r} is no text"
            raise TypeError(msg)
        found.append(((connection.topic, ros2_type_name(connection.msgtype)), connection.msgcount))
    return found


def _next_of(stored: Iterator[Any], layout: Layout) -> RecordedMessage | None:
    """The next message; None at the end.

    Raises:
        TypeError: its data are no bytes, as a damaged database's may be.
    """
    item = next(stored, None)
    if item is None:
        return None
    connection, receive_ns, data = item
    type_name = ros2_type_name(connection.msgtype)
    return RecordedMessage(int(receive_ns), connection.topic, type_name, layout, bytes(memoryview(data)))


class _Opened:
    """An open reader as a context manager (rosbags opens its own on entering, outside our translation)."""

    def __init__(self, reader: Any) -> None:
        self._reader = reader

    def __enter__(self) -> Any:
        return self._reader

    def __exit__(self, *_: object) -> None:
        self._reader.close()


def _translated(path: Path, read: Callable[[], Any]) -> Any:
    """The result of a call into rosbags; its failures become one line with the file's name.

    Raises:
        RecordingError: the bag is damaged.
    """
    try:
        return read()
    # Damage shows in rosbags as its own errors, but also as failed assertions, struct, index and decompression errors.
    except Exception as err:
        reason = " ".join(str(err).split()).rstrip(".") or type(err).__name__
        msg = f"{path}: truncated or damaged ({reason}): {_mend(path)}"
        raise RecordingError(msg) from err


def _mend(path: Path) -> str:
    tool = {
        ".bag": "repair it with `rosbag reindex`",
        ".mcap": "repair it with `mcap recover`",
        ".db3": "repair it with `sqlite3 FILE .recover`",
    }.get(path.suffix, "repair it with `ros2 bag reindex`")
    return f"{tool}, or copy it again"


def _storage_parts(path: Path) -> list[Path]:
    """What rosbags opens: the bag itself, or the storage files of a folder whose metadata does not name their kind."""
    if not path.is_dir() or _has_usable_metadata(path):
        return [path]
    parts = sorted((file for file in path.iterdir() if file.suffix in STORAGE_SUFFIXES), key=_natural_order)
    if not parts:
        files = sorted((file for file in path.iterdir() if file.suffix in FILE_SUFFIXES), key=_natural_order)
        advice = f"one that is in it, as {', '.join(map(str, files[:NAMED_MAX]))}" if files else "a recording"
        msg = f"{path}: a folder without .mcap, .db3 or events.txt files: give {advice}"
        raise RecordingError(msg)
    return parts


def _has_usable_metadata(path: Path) -> bool:
    try:
        metadata = yaml.safe_load((path / "metadata.yaml").read_text())
        return bool(metadata["rosbag2_bagfile_information"]["storage_identifier"])
    # A recorder that was killed leaves no metadata, or half of it; the storage files speak for themselves.
    except (FileNotFoundError, LookupError, TypeError, ValueError, RecursionError, yaml.YAMLError):
        return False


def _check_sqlite_length(file: Path) -> None:
    """Refuse a database that is shorter than its header says: SQLite reads the missing end as zeros.

    Raises:
        RecordingError: the file is truncated.
    """
    with file.open("rb") as stored:
        header = stored.read(SQLITE_HEADER_BYTES)
    if len(header) < SQLITE_HEADER_BYTES or not header.startswith(SQLITE_MAGIC):
        return
    page_bytes = int.from_bytes(header[16:18], "big")
    pages, pages_changed, changed = header[28:32], header[92:96], header[24:28]
    # Old writers do not keep the number of pages; it counts only where it was written with the last change.
    if pages_changed != changed:
        return
    announced = int.from_bytes(pages, "big") * (SQLITE_PAGE_MAX if page_bytes == 1 else page_bytes)
    if file.stat().st_size < announced:
        msg = f"{file}: truncated or damaged ({file.stat().st_size} of {announced} bytes): {_mend(file)}"
        raise RecordingError(msg)


def _natural_order(file: Path) -> list[tuple[int, str]]:
    return [(int(piece or 0), "") if piece.isdecimal() else (0, piece) for piece in re.split(r"(\d+)", file.name)]


def _choose_events(path: Path, topics: dict[tuple[str, str], int], topic: str | None) -> tuple[str, str]:
    found = sorted(key for key in topics if key[1] in EVENT_TYPES)
    listed = ", ".join(f"{name} ({type_name})" for name, type_name in found)
    if not found:
        held = ", ".join(f"{name} ({type_name})" for name, type_name in sorted(topics)) or "nothing"
        msg = f"{path}: no event topic; it holds {held}; event types are {', '.join(sorted(EVENT_TYPES))}"
        raise RecordingError(msg)
    if topic is not None:
        found = [key for key in found if key[0] == topic]
        if not found:
            msg = f"{path}: {topic} is no event topic: choose one of {listed}"
            raise RecordingError(msg)
    if len(found) > 1:
        msg = f"{path}: several event topics: choose one of {listed} with --topic"
        raise RecordingError(msg)
    return found[0]


def _choose_images(topics: dict[tuple[str, str], int], event_topic: str) -> str | None:
    """The image topic of the same camera, that is in the events' namespace; else the first one."""
    found = sorted(name for name, type_name in topics if type_name == IMAGE_TYPE)
    namespace = event_topic.rpartition("/")[0]
    return next((name for name in found if name.rpartition("/")[0] == namespace), next(iter(found), None))
