"""Events' bits are set in a cell map 16 at a time; what they add to the entropy is looked up for all 16 at once.

What the events' tiles held before never leaves the processor's registers: to write it down and read it again as a
vector takes 100 ns, as the reading has to wait for the writing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias, cast

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import types
from numba.core.cgutils import alloca_once_value, for_range_slice
from numba.extending import intrinsic

from etd_ros.conversion.cell_map import CHANNEL_SLOTS, LANES, LOW_BITS, TILE_SLOTS
from etd_ros.conversion.vectors import (
    LONG,
    WORD,
    all_lanes,
    count_bits_of_lanes,
    fetch,
    item_at,
    items,
    sum_of_lanes,
    vector_at,
)

Words: TypeAlias = npt.NDArray[np.uint32]
MarkEvents: TypeAlias = (
    "Callable[[Words, Words, npt.NDArray[np.int32], np.uint64, np.uint64, Words, Words], tuple[int, int]]"
)

_LANES = ir.VectorType(WORD, LANES)
_ZERO = ir.Constant(LONG, 0)


@dataclass(frozen=True)
class _Array:
    """An array in a function that is being compiled: its type and its value."""

    context: Any
    kind: Any
    value: Any

    def item(self, builder: Any, index: Any) -> Any:
        """Pointer to an item."""
        return item_at(self.context, builder, self.kind, self.value, index)

    def vector(self, builder: Any, index: Any) -> Any:
        """The 16 items from an index on."""
        first = items(self.context, builder, self.kind, self.value)
        return builder.load(vector_at(builder, first, index, _LANES), align=4)


def _mark(builder: Any, slot: Any, words: _Array, last: _Array) -> Any:
    """Set an event's bit, and return the word that was there before; have the place of its time fetched.

    The word is read twice, as one that others may have changed meanwhile, which none do: a vector takes a lane from
    memory in one instruction, and from another register in two, of a unit that all lanes wait for.
    """
    fetch(builder, last.item(builder, builder.zext(slot, LONG)), to_write=True)
    tile = builder.lshr(slot, ir.Constant(WORD, (TILE_SLOTS - 1).bit_length()))
    word = words.item(builder, builder.zext(tile, LONG))
    before = builder.load(word)
    bit = builder.shl(ir.Constant(WORD, 1), builder.and_(slot, ir.Constant(WORD, TILE_SLOTS - 1)))
    again = builder.load_atomic(word, "monotonic", 4)
    builder.store(builder.or_(again, bit), word)
    return before


def _look_up(builder: Any, table: Any, numbers: Any, is_wanted: Any) -> Any:
    """The table's entries of these numbers, 0 where not wanted: one instruction on AVX-512."""
    found = nothing = all_lanes(_LANES, 0)
    for lane in range(LANES):
        here = ir.Constant(WORD, lane)
        entry = builder.extract_element(table, builder.extract_element(numbers, here))
        found = builder.insert_element(found, entry, here)
    return builder.select(is_wanted, found, nothing)


def _gains(builder: Any, slots: Any, befores: Any, tables: list[Any]) -> list[Any]:
    """What the events add to the entropy of their channels, by each of the tables."""
    pixels = builder.shl(all_lanes(_LANES, 1), builder.and_(slots, all_lanes(_LANES, TILE_SLOTS - 1)))
    channels = builder.shl(all_lanes(_LANES, 0xFFFF), builder.and_(slots, all_lanes(_LANES, CHANNEL_SLOTS)))
    held = count_bits_of_lanes(builder, builder.and_(befores, channels))
    # A full channel, where nothing is new, may have any entry.
    numbers = builder.and_(held, all_lanes(_LANES, CHANNEL_SLOTS - 1))
    are_new = builder.icmp_unsigned("==", builder.and_(befores, pixels), all_lanes(_LANES, 0))
    return [_look_up(builder, table, numbers, are_new) for table in tables]


def _variable(builder: Any, value: Any) -> Any:
    return alloca_once_value(builder, value)  # type: ignore[no-untyped-call]


def _add_to(builder: Any, sum_: Any, value: Any) -> None:
    builder.store(builder.add(builder.load(sum_), value), sum_)


def _mark_events(_typing: Any, slots: Any, words: Any, last: Any, first: Any, stop: Any, high: Any, low: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        arrays = [_Array(context, kind, value) for kind, value in zip(signature.args, arguments, strict=True)]
        slots_, words_, last_, _, _, high_, low_ = arrays
        first_, stop_ = arguments[3:5]
        tables = [table.vector(builder, _ZERO) for table in (high_, low_)]
        sums = [_variable(builder, all_lanes(_LANES, 0)) for _ in tables]
        emptied = _variable(builder, ir.Constant(LONG, 0))
        with for_range_slice(builder, first_, stop_, ir.Constant(LONG, LANES), LONG) as (index, _):
            befores = ir.Constant(_LANES, ir.Undefined)
            for lane in range(LANES):
                place = builder.add(index, ir.Constant(LONG, lane))
                slot = builder.load(slots_.item(builder, place))
                before = _mark(builder, slot, words_, last_)
                befores = builder.insert_element(befores, before, ir.Constant(WORD, lane))
            these = slots_.vector(builder, index)
            for sum_, gains in zip(sums, _gains(builder, these, befores, tables), strict=True):
                _add_to(builder, sum_, gains)
            were_empty = builder.icmp_unsigned("==", befores, all_lanes(_LANES, 0))
            count = builder.ctpop(builder.bitcast(were_empty, ir.IntType(LANES)))
            _add_to(builder, emptied, builder.zext(count, LONG))
        upper, lower = (builder.zext(sum_of_lanes(builder, builder.load(sum_)), LONG) for sum_ in sums)
        gained = builder.add(builder.shl(upper, ir.Constant(LONG, LOW_BITS)), lower)
        return context.make_tuple(builder, signature.return_type, [gained, builder.load(emptied)])

    del first, stop
    arguments = (slots, words, last, types.uint64, types.uint64, high, low)
    result = types.UniTuple(types.int64, 2)  # type: ignore[no-untyped-call]
    return result(*arguments), generate


mark_events = cast("MarkEvents", intrinsic(_mark_events))
"""mark_events(slots, words, last, first, stop, gains_high, gains_low): set the bits of events whose slots are given.

Those of the slots first .. stop - 1, a multiple of 16 and at most BLOCK_EVENTS. Returns what they add to the entropy,
in units of 1 / entropy_one, and how many of their tiles were empty; and has the places of their times fetched, so that
who writes them soon afterwards need not wait.
"""
