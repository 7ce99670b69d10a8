"""The fields before a message's events, read all at once.

The messages of a topic have most of these in common: the frame, the sensor's size, the encoding. Hence their fields lie
at the same places, and what depends on the common ones need be checked and decoded only once.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from operator import itemgetter
from typing import Any

from msg_adapters.layout import Layout

_U32 = struct.Struct("<I")
_FRAME_START = 12
"""Place of the frame id (bytes): before it, ROS 1 has a sequence number and ROS 2 the head of CDR, both of 4 bytes."""

SENSOR_SIZE = (4, "8s")
"""Height and width, which are common."""

SEQUENCE_LENGTH = (4, "I")


class CommonFields:
    """Reads the first fields of messages that have those fields in common whose code is that of bytes.

    Args:
        view: the bytes of a first message, which is known to hold these fields.
        layout: how its fields are laid out.
        fields: of each field the alignment (bytes) and the code of `struct`.

    Attributes:
        first: the first message's fields, as `read` gives them.
        size: bytes of all these fields with what lies before and between them.
    """

    __slots__ = ("_common", "_common_of", "_form", "first", "size")

    def __init__(self, view: memoryview, layout: Layout, fields: Sequence[tuple[int, str]]) -> None:
        self._form = _form(layout, fields)
        self.size = self._form.size
        self.first: tuple[Any, ...] = self._form.unpack_from(view)
        self._common_of = itemgetter(*[place for place, value in enumerate(self.first) if isinstance(value, bytes)])
        self._common = self._common_of(self.first)

    def read(self, view: memoryview) -> tuple[Any, ...] | None:
        """A message's fields, the first of which is the kind of CDR, or empty in ROS 1.

        None if one of those in common is different, or the message is cut short: to be read field by field.
        """
        if len(view) < self.size:
            return None
        values = self._form.unpack_from(view)
        return values if self._common_of(values) == self._common else None


def header_fields(view: memoryview, layout: Layout) -> list[tuple[int, str]]:
    """The header's fields: seconds, nanoseconds, and the frame id with its length, as long as in this message."""
    seconds = [(4, "4x"), (4, "I")] if layout is Layout.ROS1 else [(4, "i")]
    return [*seconds, (4, "I"), (4, _string_code(view, _FRAME_START))]


def string_field(
    view: memoryview, layout: Layout, before: Sequence[tuple[int, str]], *, more: int = 0
) -> tuple[int, str]:
    """A string after other fields, with its length, as long as in this message.

    Args:
        view: the message's bytes.
        layout: how its fields are laid out.
        before: the fields before it.
        more: bytes after the string that are common, too.
    """
    return 4, _string_code(view, _form(layout, [*before, (4, "0s")]).size, more)


def _string_code(view: memoryview, start: int, more: int = 0) -> str:
    (size,) = _U32.unpack_from(view, start)
    return f"{_U32.size + size + more}s"


def _form(layout: Layout, fields: Sequence[tuple[int, str]]) -> struct.Struct:
    form, size = ("<0s" if layout is Layout.ROS1 else "<2s2x"), 0
    for alignment, code in fields:
        padding = -size % alignment if layout is Layout.ROS2 else 0
        form += f"{padding}x{code}"
        size += padding + struct.calcsize(f"<{code}")
    return struct.Struct(form)
