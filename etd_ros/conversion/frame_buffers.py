"""Where frames' grey levels lie: a few arrays that are used again once nobody holds the frame any more.

A frame of zeros costs more to make than a tenth of what its events cost to add. A buffer instead keeps, behind the
levels, a bit per tile that the last frame has written, so that the next one clears only what it does not write itself:

    | levels, flat: row, column, channel | up to whole words, and one more | a bit per tile, 64 to a word |

They are lent as decoders lend theirs (`etd_ros.buffers`). The frames are read-only, as what a reader wrote there would
be seen in a later one.
"""

from __future__ import annotations

import math
from sys import getrefcount
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from etd_ros.borrowing_kernel import kernel_part

BUFFERS_MAX = 4
"""Frames of one sensor that are waited for: where readers hold more at once, others are made and left to them."""

WORD_BYTES = 8
SPARE_WORDS = 2
"""For the levels' last bytes that make no word, and what a tile at the sensor's border clears beyond them."""

FrameData: TypeAlias = npt.NDArray[np.uint8]


@kernel_part
def written_from(level_bytes: int) -> int:
    """Where the bits of the written tiles begin in a buffer of so many levels (bytes)."""
    return (level_bytes // WORD_BYTES + SPARE_WORDS) * WORD_BYTES


class _Buffer:
    """An array, and the frame's data that lie in it."""

    __slots__ = ("data", "data_references", "memory", "memory_references")

    def __init__(self, shape: tuple[int, int, int], groups: int, content: FrameData | None = None) -> None:
        level_bytes = math.prod(shape)
        self.memory = np.zeros((level_bytes // WORD_BYTES + SPARE_WORDS + groups) * WORD_BYTES, np.uint8)
        if content is not None:
            self.memory[:] = content
        self.data = self.memory[:level_bytes].reshape(shape)
        self.data.flags.writeable = False
        # Measured, because interpreters differ in what they count.
        self.data_references, self.memory_references = getrefcount(self.data), getrefcount(self.memory)

    def __reduce__(self) -> tuple[type[_Buffer], tuple[tuple[int, ...], int, FrameData]]:
        """For copies of a converter: as copied each for itself, the data would no longer lie in the memory."""
        groups = len(self.memory) // WORD_BYTES - SPARE_WORDS - self.data.size // WORD_BYTES
        return _Buffer, (self.data.shape, groups, self.memory)


class FrameBuffers:
    """The buffers of one sensor's frames, by turns."""

    def __init__(self, width: int, height: int, groups: int) -> None:
        """Prepare for frames of width x height pixels whose tiles make so many groups of 64."""
        self._shape = height, width, 2
        self._groups = groups
        self.unfinished: _Buffer | None = _Buffer(self._shape, self._groups)
        """What the unfinished frame is written to; None after a frame has been handed out, until `next_one`."""
        self._buffers = [self.unfinished]
        self._turn = 0

    @property
    def memory(self) -> FrameData:
        """The array that the unfinished frame is written to, uint8, flat."""
        return (self.unfinished or self.next_one()).memory

    def next_one(self) -> _Buffer:
        """The buffer of the next frame, after one has been handed out.

        It is looked for only when it is needed, as a reader that takes one frame after the other still holds the last
        one when it is handed the next: so two are enough for it, and stay in the processor's near memory.
        """
        buffers = self._buffers
        turn = self._turn = (self._turn + 1) % len(buffers)
        buffer = buffers[turn]
        # Somebody holds the data, or a part of them, which refers to the memory.
        if getrefcount(buffer.data) != buffer.data_references or getrefcount(buffer.memory) != buffer.memory_references:
            have_all = len(buffers) == BUFFERS_MAX
            buffer = _Buffer(self._shape, self._groups)
            buffers[turn : turn + have_all] = [buffer]
        self.unfinished = buffer
        return buffer

    def hand_out(self) -> FrameData:
        """The data of the frame that has been written, read-only, shape (height, width, 2)."""
        self.unfinished = None
        return self._buffers[self._turn].data

    def clear(self) -> None:
        """Forget what the unfinished frame holds."""
        self.memory.fill(0)
