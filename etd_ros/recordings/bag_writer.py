"""Writes ROS 2 bags (mcap) from serialised messages, without rosbag2, which pip cannot give."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Literal

from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer, WriterError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from etd_ros.recordings.interface import RecordingError

BAG_VERSION: Literal[9] = 9
EVENT_PACKET_TYPE = "event_camera_msgs/msg/EventPacket"
EVENT_PACKET_DEFINITION = """\
std_msgs/Header header
uint32 height
uint32 width
uint64 seq
uint64 time_base
string encoding
bool is_bigendian
uint8[] events
"""
_NO_LIMIT = QosTime(0, 0)


class BagWriter:
    """A ROS 2 bag being written.

    Args:
        path: the bag's folder, which must not exist yet.
        definitions: message definitions by type name, of types that are not among ROS 2's common interfaces.
        compressed: whether the storage file's chunks are compressed (zstd).

    Raises:
        RecordingError: on entry, the folder exists or cannot be written; on leaving, its end cannot be.
    """

    def __init__(self, path: Path, definitions: Mapping[str, str], *, compressed: bool = False) -> None:
        self._path = path
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Connection] = {}
        types = {}
        for name, text in definitions.items():
            types.update(get_types_from_msg(text, name))
        known = self._typestore.fielddefs
        self._typestore.register({name: fields for name, fields in types.items() if name not in known})
        self._compressed = compressed

    def __enter__(self) -> BagWriter:
        try:
            self._writer = Writer(self._path, version=BAG_VERSION, storage_plugin=StoragePlugin.MCAP)
            if self._compressed:
                self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            self._writer.open()
        except (OSError, WriterError) as err:
            msg = f"{self._path}: the bag cannot be written ({err}): name a new folder in one you may write"
            raise RecordingError(msg) from err
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            with self._failing_in_one_line():
                self._writer.close()
        else:
            # What is under way already says more than that the end of the file is missing too.
            with suppress(OSError):
                self._writer.close()

    def add_topic(self, topic: str, type_name: str, *, reliable: bool) -> None:
        """Announce a topic, with the QoS that replaying it should offer."""
        qos = Qos(
            QosHistory.KEEP_LAST,
            100 if reliable else 1000,
            QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT,
            QosDurability.VOLATILE,
            _NO_LIMIT,
            _NO_LIMIT,
            QosLiveliness.AUTOMATIC,
            _NO_LIMIT,
            avoid_ros_namespace_conventions=False,
        )
        self._connections[topic] = self._writer.add_connection(
            topic, type_name, typestore=self._typestore, offered_qos_profiles=(qos,)
        )

    def write(self, topic: str, receive_ns: int, message: bytes) -> None:
        """Append a serialised message of an announced topic, received at `receive_ns`.

        Raises:
            RecordingError: it cannot be written; what was written before is kept.
        """
        with self._failing_in_one_line():
            self._writer.write(self._connections[topic], receive_ns, message)

    @contextmanager
    def _failing_in_one_line(self) -> Iterator[None]:
        try:
            yield
        except OSError as err:
            msg = (
                f"{self._path}: cannot be written any more ({err.strerror or err}): free space on that disk, or record "
                "on another one; what came before is kept, and `mcap recover` makes it a whole file"
            )
            raise RecordingError(msg) from err
