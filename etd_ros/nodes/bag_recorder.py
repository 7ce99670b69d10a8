"""Records serialised messages into a ROS 2 bag (mcap) without rosbag2, which pip cannot give."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Literal

from ament_index_python.packages import get_package_share_directory
from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

BAG_VERSION: Literal[9] = 9
_NO_LIMIT = QosTime(0, 0)


class BagRecorder:
    """A bag being written. The folder must not exist yet."""

    def __init__(self, path: Path) -> None:
        self._writer = Writer(path, version=BAG_VERSION, storage_plugin=StoragePlugin.MCAP)
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Connection] = {}

    def __enter__(self) -> BagRecorder:
        self._writer.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.close()

    def add_topic(self, topic: str, type_name: str, *, reliable: bool) -> None:
        """Announce a topic, with the QoS that replaying it should offer."""
        if type_name not in self._typestore.fielddefs:
            _register_package(self._typestore, type_name.split("/")[0])
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
        """Append a serialised message of an announced topic."""
        self._writer.write(self._connections[topic], receive_ns, message)


def _register_package(typestore: Typestore, package: str) -> None:
    folder = Path(get_package_share_directory(package)) / "msg"
    types = {}
    for file in sorted(folder.glob("*.msg")):
        types.update(get_types_from_msg(file.read_text(encoding="utf-8"), f"{package}/msg/{file.stem}"))
    typestore.register({name: fields for name, fields in types.items() if name not in typestore.fielddefs})
