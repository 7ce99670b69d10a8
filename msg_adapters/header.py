"""std_msgs/Header in both layouts; ROS 1 puts a sequence number first, which is no part of ROS 2's."""

from __future__ import annotations

from typing import NamedTuple

from msg_adapters.layout import Layout, Reader, Writer

NS_PER_S = 1_000_000_000


class Header(NamedTuple):
    """When and where the data of a message belong.

    Attributes:
        stamp_ns: time on the ROS clock (ns).
        frame_id: name of the coordinate frame.
    """

    stamp_ns: int
    frame_id: str


def read_header(reader: Reader) -> Header:
    """The header at the cursor.

    Raises:
        MessageError: the message is cut short.
    """
    if reader.layout is Layout.ROS1:
        reader.u32()
        seconds = reader.u32()
    else:
        seconds = reader.i32()
    nanoseconds = reader.u32()
    return Header(seconds * NS_PER_S + nanoseconds, reader.string())


def write_header(writer: Writer, header: Header) -> None:
    """Append a header; ROS 1's sequence number is 0, since publishers fill it in.

    Raises:
        MessageError: a stamp outside the layout's range of seconds.
    """
    seconds, nanoseconds = divmod(header.stamp_ns, NS_PER_S)
    if writer.layout is Layout.ROS1:
        writer.u32(0)
        writer.u32(seconds)
    else:
        writer.i32(seconds)
    writer.u32(nanoseconds)
    writer.string(header.frame_id)
