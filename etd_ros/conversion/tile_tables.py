"""The constant vectors that a tile's levels are found with, side by side in one table.

A compiled kernel may lie anywhere in memory, so that the compiler has each constant found by an instruction of its own
for its address: about a tenth of all that it takes to read a tile. Here it has to find them all by the address of the
table, of which it does not know that it is constant as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.cgutils import get_or_insert_function, global_constant
from numba.extending import intrinsic

from etd_ros.conversion.cell_map import CHANNEL_SLOTS, TILE_SLOTS
from etd_ros.conversion.vectors import BYTE, HALF, LONG, WORD, has_features

FIXED_ONE = 2**16
"""1 in the fixed-point numbers that levels are worked out in first."""
FIXED_ERROR = 8
"""More than such a number is off by (4 at most), a power of two: the largest has 24 bits, as many as 32-bit floating
point has of the time, the slope and their product."""

FEW_EVENTS = 11
"""Events that have no more pairs than a word has bits."""

_LINE_BYTES = 64
"""Each entry begins with a line of the processor's near memory, and those of vectors have one."""

_PAIRS = [(earlier, later) for later in range(FEW_EVENTS) for earlier in range(later)]
_WOVEN = [channel + place for place in range(CHANNEL_SLOTS) for channel in (0, CHANNEL_SLOTS)]


def _in_channels(on_events: int, events: int) -> int:
    """A bit for each of the pairs that one channel holds, where the first `on_events` of the events are On."""
    held = (later < on_events or on_events <= earlier <= later < events for earlier, later in _PAIRS)
    return sum(int(is_held) << number for number, is_held in enumerate(held))


@dataclass(frozen=True)
class Entry:
    """Numbers in the table.

    Attributes:
        line: where they begin.
        kind: of each.
        numbers: what they are.
    """

    line: int
    kind: ir.IntType
    numbers: Sequence[int]

    @property
    def bytes(self) -> bytes:
        """What lies there."""
        found = np.array(self.numbers, f"u{self.kind.width // 8}").tobytes()
        return found + bytes(-len(found) % _LINE_BYTES)


ONES = Entry(0, BYTE, [1] * TILE_SLOTS)
NEAR_NEXT = Entry(1, HALF, [2 * FIXED_ERROR] * TILE_SLOTS)
"""Fractions below are so near to where a level begins that their error matters."""
WHOLE_PART = Entry(2, WORD, [2**32 - FIXED_ONE] * CHANNEL_SLOTS)
UNWOVEN_LOW_BYTES = Entry(3, BYTE, [4 * place + 2 * channel for channel in (0, 1) for place in range(CHANNEL_SLOTS)])
"""Of halves that are On and Off by turns: On before Off."""
EARLIER = Entry(4, BYTE, [earlier for earlier, _ in _PAIRS] + [0] * (LONG.width - len(_PAIRS)))
LATER = Entry(5, BYTE, [later for _, later in _PAIRS] + [0] * (LONG.width - len(_PAIRS)))
"""The events of all pairs."""
WOVEN = Entry(6, BYTE, _WOVEN)
"""Slots of On and Off by turns."""
PAIRS_IN_CHANNELS = Entry(
    7, LONG, [_in_channels(on, events) for on in range(FEW_EVENTS + 1) for events in range(FEW_EVENTS + 1)]
)
"""Which pairs are of one channel, by how many of how many events are On."""

_ENTRIES = (ONES, NEAR_NEXT, WHOLE_PART, UNWOVEN_LOW_BYTES, EARLIER, LATER, WOVEN, PAIRS_IN_CHANNELS)


def _tile_tables(_typing: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        numbers = np.frombuffer(b"".join(entry.bytes for entry in _ENTRIES), np.uint64).tolist()
        constant = ir.Constant(ir.ArrayType(LONG, len(numbers)), numbers)
        table = global_constant(builder, "tile_tables", constant)  # type: ignore[no-untyped-call]
        table.align = _LINE_BYTES
        unknown = ir.InlineAsm(ir.FunctionType(LONG, [LONG]), "", "=r,0")
        return builder.call(unknown, [builder.ptrtoint(table, LONG)])

    return types.uint64(), generate


tile_tables = cast("Callable[[], np.uint64]", intrinsic(_tile_tables))
"""tile_tables(): where the table lies."""


def number_of(builder: Any, tables: Any, entry: Entry, index: Any) -> Any:
    """One of an entry's numbers.

    Args:
        builder: of the function that is being compiled.
        tables: what `tile_tables` has returned.
        entry: the entry.
        index: number of the number.
    """
    first = builder.inttoptr(builder.add(tables, ir.Constant(LONG, _LINE_BYTES * entry.line)), entry.kind.as_pointer())
    return builder.load(builder.gep(first, [index]))


def vector_of(builder: Any, tables: Any, entry: Entry, count: int) -> Any:
    """The first `count` of what lies in an entry's line, 0 where the entry has less numbers."""
    kind = ir.VectorType(entry.kind, count)
    first = builder.inttoptr(builder.add(tables, ir.Constant(LONG, _LINE_BYTES * entry.line)), kind.as_pointer())
    return builder.load(first, align=_LINE_BYTES)


def pick_bytes(context: Any, builder: Any, vector: Any, tables: Any, entry: Entry) -> Any:
    """The bytes of a vector at the places that an entry names: one instruction on AVX-512 with VBMI."""
    count, wanted = vector.type.count, len(entry.numbers)
    if not has_features(context, "avx512vbmi"):
        return builder.shuffle_vector(vector, vector, _places(entry.numbers))
    kind = ir.FunctionType(vector.type, [vector.type, vector.type])
    name = f"llvm.x86.avx512.permvar.qi.{count * BYTE.width}"
    pick = get_or_insert_function(builder.module, kind, name)  # type: ignore[no-untyped-call]
    picked = builder.call(pick, [vector, vector_of(builder, tables, entry, count)])
    return picked if wanted == count else builder.shuffle_vector(picked, picked, _places(range(wanted)))


def _places(numbers: Sequence[int]) -> ir.Constant:
    return ir.Constant(ir.VectorType(WORD, len(numbers)), list(numbers))
