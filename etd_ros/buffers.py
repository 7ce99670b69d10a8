"""Arrays that are used again: message after message is decoded without allocating anything.

Nobody has to give an array back. The pool keeps a reference to all that it lends; an array that nobody else refers to
any more is free, and a view of it (a slice, another dtype) counts as a reference for as long as it lives. So whoever
keeps what he was given is always safe, and whoever lets go of it makes room for the next.
"""

from __future__ import annotations

from sys import getrefcount
from typing import Any

import numpy as np
import numpy.typing as npt

Arrays = tuple[npt.NDArray[Any], ...]
"""Parallel arrays of one length."""

LENGTH_MIN = 1024
"""Shortest arrays that are allocated (items)."""

LENGTH_SHORT = 65536
"""Arrays up to this length (items) are lent to anybody, however few items are asked for."""

LENGTH_STEPS = 4
"""Lengths are rounded up to the next of this many steps between powers of two: messages differ a little in size."""

EXCESS_MAX = 16
"""Longer arrays are not lent where less than this part of them is asked for."""

GAP = 64
"""Bytes between the arrays of a group: arrays that are whole pages apart share the same few lines of the cache."""

PATIENCE = 64
"""Takes after which the pool lets go of arrays that it did not lend again."""


class ArrayPool:
    """Lends groups of parallel, uninitialised arrays.

    It holds on to at most `PATIENCE` groups, those lent last. So a message of unusual size does not hold its memory for
    ever, and a consumer that keeps everything costs no more than without a pool.

    One thread takes; what was taken may be used and let go of by any thread. References are counted, so addresses
    handed to foreign code (ctypes) need an array kept alive beside them.

    Args:
        dtypes: of the arrays of a group.
    """

    def __init__(self, *dtypes: npt.DTypeLike) -> None:
        self._dtypes = tuple(np.dtype(dtype) for dtype in dtypes)
        # In the order lent: those lent last are still in the processor's cache, those lent first are let go.
        self._groups: list[_Group] = []
        self._takes = 0

    @property
    def nbytes(self) -> int:
        """Memory of all arrays that the pool holds, lent or free (bytes)."""
        return sum(group.memory.nbytes for group in self._groups)

    def take(self, length: int) -> Arrays:
        """A group of arrays of `length` items, whose content is undefined."""
        return tuple([array[:length] for array in self.reserve(length)])

    def reserve(self, length: int) -> Arrays:
        """A group of at least `length` items of which only views may be kept: the next call may give it again.

        For whoever does not know yet how many items he will fill, and cuts the arrays afterwards.
        """
        self._takes += 1
        groups = self._groups
        # The one lent last is the best, if it is free.
        for group in reversed(groups):
            if group.fits(length):
                break
        else:
            group = _Group(self._dtypes, _rounded(length))
            groups.append(group)
        if groups[-1] is not group:
            groups.remove(group)
            groups.append(group)
        group.taken = self._takes
        if self._takes - groups[0].taken >= PATIENCE:
            del groups[0]
        return group.arrays


class _Group:
    """Arrays in one block of memory. Whatever is a view of them refers to the block, as NumPy's views of views do."""

    __slots__ = ("_references_when_free", "arrays", "length", "memory", "taken")

    def __init__(self, dtypes: tuple[np.dtype[Any], ...], length: int) -> None:
        self.length = length
        starts, end = [], 0
        for dtype in dtypes:
            starts.append(end)
            end += length * dtype.itemsize + GAP
        self.memory = np.empty(end - GAP, np.uint8)
        self.arrays: Arrays = tuple(
            [
                self.memory[start : start + length * dtype.itemsize].view(dtype)
                for start, dtype in zip(starts, dtypes, strict=True)
            ]
        )
        self.taken = 0
        # Measured, because interpreters differ in what they count.
        self._references_when_free = getrefcount(self.memory)

    def fits(self, length: int) -> bool:
        """Whether these arrays are free, and neither too short nor much too long."""
        return (
            length <= self.length
            and (self.length <= LENGTH_SHORT or self.length <= EXCESS_MAX * length)
            and getrefcount(self.memory) == self._references_when_free
        )


def _rounded(length: int) -> int:
    step = max(1 << max(length - 1, 1).bit_length() - 1, LENGTH_MIN) // LENGTH_STEPS
    return max(-(-length // step) * step, LENGTH_MIN)
