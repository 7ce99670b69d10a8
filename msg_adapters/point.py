"""geometry_msgs/PointStamped in ROS 2 layout: what viewers send for a click.

std_msgs/Header header; float64 point.x, point.y, point.z
"""

from __future__ import annotations

from dataclasses import dataclass

from msg_adapters.header import Header, read_header, write_header
from msg_adapters.layout import Layout, MessageBytes, Reader, Writer


@dataclass(frozen=True, slots=True)
class PointMessage:
    """A point on an image.

    Attributes:
        stamp_ns: the header's stamp (ns).
        frame_id: the header's coordinate frame.
        x: column from the left (pixels).
        y: row from the top (pixels).
    """

    stamp_ns: int
    frame_id: str
    x: float
    y: float


def encode_point(point: PointMessage) -> bytes:
    """A geometry_msgs/msg/PointStamped in ROS 2 layout, with z = 0.

    Raises:
        MessageError: the stamp does not fit the message.
    """
    writer = Writer()
    write_header(writer, Header(point.stamp_ns, point.frame_id))
    writer.f64(point.x, point.y, 0.0)
    return writer.finish()


def decode_point(message: MessageBytes) -> PointMessage:
    """The point of a geometry_msgs/msg/PointStamped in ROS 2 layout; its z is left out.

    Raises:
        MessageError: cut short.
    """
    reader = Reader(message, Layout.ROS2)
    header = read_header(reader)
    x, y, _ = (reader.f64() for _ in range(3))
    return PointMessage(header.stamp_ns, header.frame_id, x, y)
