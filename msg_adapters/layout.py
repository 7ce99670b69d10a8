"""How ROS 1 and ROS 2 lay fields out in bytes: bounds-checked cursors to read and write them.

Both are little-endian, and strings and sequences start with a uint32 length.

| layout | alignment | string | head |
|-|-|-|-|
| ROS1 | none, fields are packed | its bytes | none |
| ROS2 | each field to its own size, from the end of the head | its bytes and a NUL | 4 bytes, CDR: 00 01, options |
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import Enum
from typing import Any, TypeAlias, cast

import numpy.typing as npt

from etd_ros.errors import EtdError

MessageBytes: TypeAlias = "bytes | bytearray | memoryview"
"""One serialised message, as raw subscriptions and bags give it."""

_CDR_HEAD = b"\x00\x01\x00\x00"
_CDR_LITTLE_ENDIAN = 0x0001
_CDR_BIG_ENDIAN = 0x0000

_U8, _U32, _I32, _U64, _F64 = (struct.Struct(code) for code in ("<B", "<I", "<i", "<Q", "<d"))


class MessageError(EtdError):
    """Bytes that are not a message of the type, layout or encoding announced, or values no message can hold."""


class Layout(str, Enum):
    """How a message's fields are laid out in bytes."""

    ROS1 = "ros1"
    ROS2 = "ros2"


class Reader:
    """A cursor over one message; every read is checked against the bytes present.

    Args:
        message: the whole serialised message; it must not change while it is read.
        layout: how its fields are laid out.

    Raises:
        MessageError: on construction, a ROS 2 message that is not little-endian CDR; on any read, a message cut short.
    """

    def __init__(self, message: MessageBytes, layout: Layout) -> None:
        self.layout = layout
        self._view = byte_view(message)
        self._position = 0
        self._origin = 0
        if layout is Layout.ROS2:
            _check_encapsulation(bytes(self.blob(len(_CDR_HEAD))))
            self._origin = len(_CDR_HEAD)

    @property
    def remaining(self) -> int:
        """Bytes not read yet."""
        return len(self._view) - self._position

    def u8(self) -> int:
        return int(self._unpack(_U8))

    def u32(self) -> int:
        return int(self._unpack(_U32))

    def i32(self) -> int:
        return int(self._unpack(_I32))

    def u64(self) -> int:
        return int(self._unpack(_U64))

    def f64(self) -> float:
        return float(self._unpack(_F64))

    def string(self) -> str:
        """A string, without the NUL that ends it in ROS 2.

        Raises:
            MessageError: cut short, not terminated, or not UTF-8.
        """
        text = bytes(self.blob(self.u32()))
        if self.layout is Layout.ROS2 and text:
            if text[-1]:
                msg = f"the string before byte {self._position} lacks its final NUL: is the message of another type?"
                raise MessageError(msg)
            text = text[:-1]
        try:
            return text.decode()
        except UnicodeDecodeError as err:
            msg = f"the string before byte {self._position} is not UTF-8: is the message of another type or layout?"
            raise MessageError(msg) from err

    def blob(self, size: int) -> memoryview:
        """The next `size` bytes, as a read-only view."""
        self._check_left(size)
        self._position += size
        return self._view[self._position - size : self._position]

    def byte_sequence(self) -> memoryview:
        """A uint8[] field, as a read-only view."""
        return self.blob(self.u32())

    def count(self, item_size_min: int) -> int:
        """The length of a sequence, checked so that nobody allocates for items that cannot be there.

        Args:
            item_size_min: the fewest bytes that one item takes.
        """
        count = self.u32()
        if count * item_size_min > self.remaining:
            raise cut_short(count, "items", self._position, self.remaining)
        return count

    def _unpack(self, form: struct.Struct) -> Any:
        padding = -(self._position - self._origin) % form.size if self.layout is Layout.ROS2 else 0
        self._check_left(padding + form.size)
        start = self._position + padding
        self._position = start + form.size
        return form.unpack_from(self._view, start)[0]

    def _check_left(self, size: int) -> None:
        if size > len(self._view) - self._position:
            raise cut_short(size, "bytes", self._position, self.remaining)


class Writer:
    """Collects the fields of one message; `finish` joins them by one allocation and one copy."""

    def __init__(self, layout: Layout = Layout.ROS2) -> None:
        self.layout = layout
        self._parts: list[bytes | memoryview] = []
        self._size = 0

    def u8(self, value: int) -> None:
        self._pack(_U8, value)

    def u32(self, value: int) -> None:
        self._pack(_U32, value)

    def i32(self, value: int) -> None:
        self._pack(_I32, value)

    def u64(self, value: int) -> None:
        self._pack(_U64, value)

    def f64(self, *values: float) -> None:
        try:
            data = struct.pack(f"<{len(values)}d", *values)
        except struct.error as err:
            msg = f"{values} are not numbers ({err}): give floats"
            raise MessageError(msg) from err
        self._align(_F64.size)
        self._append(data)

    def string(self, text: str) -> None:
        """A string.

        Raises:
            MessageError: the text holds a NUL, which would end it early, or cannot be UTF-8.
        """
        try:
            data = text.encode()
        except UnicodeEncodeError as err:
            msg = f"{text!r} is not text that UTF-8 can hold: give another string"
            raise MessageError(msg) from err
        if b"\0" in data:
            msg = f"{text!r} holds a NUL character, which no ROS string may: take it out"
            raise MessageError(msg)
        self.byte_sequence(data + b"\0" if self.layout is Layout.ROS2 else data)

    def byte_sequence(self, data: bytes | memoryview | npt.NDArray[Any]) -> None:
        """A uint8[] field from bytes or a contiguous array; it is not copied before `finish`."""
        view = memoryview(cast("bytes", data))
        self.u32(view.nbytes)
        self._append(view)

    def finish(self) -> bytes:
        """The serialised message."""
        return b"".join(self._parts if self.layout is Layout.ROS1 else [_CDR_HEAD, *self._parts])

    def _append(self, part: bytes | memoryview) -> None:
        self._parts.append(part)
        self._size += memoryview(part).nbytes

    def _pack(self, form: struct.Struct, value: float) -> None:
        try:
            data = form.pack(value)
        except struct.error as err:
            msg = f"{value} does not fit the message's field of {form.size} bytes ({err}): give a value in range"
            raise MessageError(msg) from err
        self._align(form.size)
        self._append(data)

    def _align(self, size: int) -> None:
        """Fill up to a multiple of a field's size, as the ROS 2 layout has it."""
        if self.layout is Layout.ROS2:
            self._append(bytes(-self._size % size))


def byte_view(message: MessageBytes) -> memoryview:
    """A message's bytes, read-only whatever the source, so that compiled kernels see one type of array."""
    if isinstance(message, bytes):
        return memoryview(message)
    return memoryview(message).cast("B").toreadonly()


def cut_short(count: int, unit: str, position: int, left: int) -> MessageError:
    """The error of a message that ends too early.

    Args:
        count: of what it says to hold.
        unit: what that is.
        position: where that begins (bytes).
        left: bytes from there on.
    """
    return MessageError(
        f"message cut short: {count} {unit} are announced before byte {position}, {left} bytes are left; "
        "get the whole message, or check its type and layout"
    )


def known_names(names: Sequence[str] | frozenset[str]) -> str:
    """Names for an error message, in a stable order."""
    return ", ".join(sorted(names))


def _check_encapsulation(head: bytes) -> None:
    kind = int.from_bytes(head[:2], "big")
    if kind == _CDR_BIG_ENDIAN:
        msg = "the message is big-endian CDR, which no known sender produces: convert it to little-endian"
        raise MessageError(msg)
    if kind != _CDR_LITTLE_ENDIAN:
        msg = f"the message starts with {head.hex()}, not with 0001 (little-endian CDR): is it a ROS 1 message?"
        raise MessageError(msg)
