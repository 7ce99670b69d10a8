"""sensor_msgs/Image as arrays and back, without the copies that message objects cost.

std_msgs/Header header; uint32 height; uint32 width; string encoding; uint8 is_bigendian; uint32 step; uint8[] data
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from msg_adapters.event_message import checked_size
from msg_adapters.header import Header, read_header, write_header
from msg_adapters.layout import Layout, MessageBytes, MessageError, Reader, Writer, known_names

_FORMATS: dict[str, tuple[str, int]] = {
    "mono8": ("uint8", 1),
    "8UC1": ("uint8", 1),
    "8UC2": ("uint8", 2),
    "bgr8": ("uint8", 3),
    "rgb8": ("uint8", 3),
    "mono16": ("uint16", 1),
    "16UC1": ("uint16", 1),
}
"""Element type and number of channels of each encoding."""

_DEFAULT_ENCODING = {("uint8", 1): "mono8", ("uint8", 2): "8UC2", ("uint8", 3): "bgr8", ("uint16", 1): "mono16"}

IMAGE_TYPE = "sensor_msgs/msg/Image"


@dataclass(frozen=True, slots=True)
class ImageMessage:
    """One decoded image.

    Attributes:
        stamp_ns: the header's stamp (ns).
        frame_id: the header's coordinate frame.
        encoding: meaning of the channels, such as mono8 or bgr8.
        data: uint8 or uint16, shape (height, width) or (height, width, channels); a read-only view of the message.
    """

    stamp_ns: int
    frame_id: str
    encoding: str
    data: npt.NDArray[Any]


def decode_image(message: MessageBytes, layout: Layout = Layout.ROS2) -> ImageMessage:
    """The image of a message: a view of its bytes, copied only where 16-bit pixels are not aligned.

    Raises:
        MessageError: cut short, of an unknown encoding, of an impossible size, or with rows shorter than the width.
    """
    reader = Reader(message, layout)
    header = read_header(reader)
    height, width, encoding = reader.u32(), reader.u32(), reader.string()
    is_bigendian, step = bool(reader.u8()), reader.u32()
    data = reader.byte_sequence()
    dtype, channels = _format(encoding)
    checked_size(width, height)
    row_size = width * channels * dtype.itemsize
    if step < row_size or (height - 1) * step + row_size > len(data):
        msg = (
            f"the image's {len(data)} bytes in rows of {step} do not hold {width}x{height} pixels of {encoding}: "
            "the sender is wrong about its size, step or encoding"
        )
        raise MessageError(msg)
    if is_bigendian and dtype.itemsize > 1:
        msg = f"the image's {encoding} pixels are big-endian, which is not supported: publish them little-endian"
        raise MessageError(msg)
    shape, strides = (height, width, channels), (step, channels * dtype.itemsize, dtype.itemsize)
    pixels: npt.NDArray[Any] = np.ndarray(shape, dtype, data, strides=strides)
    pixels = np.require(pixels[:, :, 0] if channels == 1 else pixels, requirements="A")
    return ImageMessage(header.stamp_ns, header.frame_id, encoding, pixels)


def encode_image(data: npt.NDArray[Any], *, stamp_ns: int, frame_id: str, encoding: str | None = None) -> bytes:
    """A sensor_msgs/msg/Image in ROS 2 layout, by one allocation and one copy of a contiguous array.

    Args:
        data: uint8 or uint16, shape (height, width) or (height, width, channels).
        stamp_ns: the header's stamp (ns).
        frame_id: the header's coordinate frame.
        encoding: meaning of the channels; by default mono8, 8UC2, bgr8 or mono16, by shape and type.

    Raises:
        MessageError: no encoding for this array, another one than its shape and type ask for, or no pixels.
    """
    channels = data.shape[2] if data.ndim == 3 else 1
    kind = (data.dtype.name, channels)
    name = _DEFAULT_ENCODING.get(kind) if encoding is None else encoding
    if data.ndim not in (2, 3) or name is None or _FORMATS.get(name) != kind:
        msg = (
            f"an array of {data.dtype} {data.shape} is no image{f' of encoding {encoding}' if encoding else ''}: give "
            "uint8 (height, width[, 1, 2 or 3]) or uint16 (height, width)"
        )
        raise MessageError(msg)
    height, width = data.shape[:2]
    checked_size(width, height)
    writer = Writer()
    write_header(writer, Header(stamp_ns, frame_id))
    writer.u32(height)
    writer.u32(width)
    writer.string(name)
    writer.u8(0)
    writer.u32(width * channels * data.itemsize)
    writer.byte_sequence(np.ascontiguousarray(data))
    return writer.finish()


def _format(encoding: str) -> tuple[np.dtype[Any], int]:
    if encoding not in _FORMATS:
        msg = f"unknown image encoding {encoding!r}: known are {known_names(frozenset(_FORMATS))}"
        raise MessageError(msg)
    name, channels = _FORMATS[encoding]
    return np.dtype(name), channels
