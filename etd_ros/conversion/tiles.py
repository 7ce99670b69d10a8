"""The grey levels of a tile, 32 at a time, and which of 64 tiles have events, by vector instructions that the compiler
does not make of a loop.

They are written as LLVM's own vector operations, which it has for every processor.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias, cast

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import types
from numba.core.cgutils import get_or_insert_function
from numba.extending import intrinsic

from etd_ros.conversion.cell_map import GROUP_TILES, LANES, TILE_SIDE, TILE_SLOTS

CHANNEL_SLOTS = TILE_SLOTS // 2

TileLevels: TypeAlias = (
    "Callable[[npt.NDArray[np.int32], np.uint64, np.uint32, float, float, npt.NDArray[np.uint8]], np.uint32]"
)
WriteTile: TypeAlias = "Callable[[npt.NDArray[np.uint8], npt.NDArray[np.uint8], np.uint64, np.uint64], None]"

Words: TypeAlias = npt.NDArray[np.uint32]
GainedIn: TypeAlias = "Callable[[Words, Words, Words, Words, np.uint64], np.uint32]"
TilesWithEvents: TypeAlias = "Callable[[npt.NDArray[np.uint32], np.uint64], np.uint64]"

_BIT, _BYTE, _WORD, _LONG, _DOUBLE = *(ir.IntType(bits) for bits in (1, 8, 32, 64)), ir.DoubleType()
_START = ir.Constant(_LONG, 0)
_BYTES, _WORDS, _DOUBLES = (ir.VectorType(kind, TILE_SLOTS) for kind in (_BYTE, _WORD, _DOUBLE))


def _pointer(context: Any, builder: Any, kind: Any, array: Any, index: Any, to: ir.Type) -> Any:
    """To what lies in an array from an index on."""
    start = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(start, [index]), to.as_pointer())


def _mask(slots: list[int]) -> ir.Constant:
    return ir.Constant(ir.VectorType(_WORD, len(slots)), slots)


def _in_each_slot(builder: Any, value: Any) -> Any:
    undefined = ir.Constant(ir.VectorType(value.type, TILE_SLOTS), ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(_WORD, 0))
    return builder.shuffle_vector(first, undefined, _mask([0] * TILE_SLOTS))


def _levels(builder: Any, times: Any, word: Any, slope: Any, offset: Any) -> Any:
    """Times without an event are old ones, whose levels may be beyond 32 bits: the last selection drops those."""
    fuse = ("contract",)
    exact = builder.fmul(builder.sitofp(times, _DOUBLES), _in_each_slot(builder, slope), flags=fuse)
    whole = builder.fptosi(builder.fadd(exact, _in_each_slot(builder, offset), flags=fuse), _WORDS)
    levels = builder.trunc(whole, _BYTES)
    one, none = (ir.Constant(_BYTES, [value] * TILE_SLOTS) for value in (1, 0))
    at_least_one = builder.select(builder.icmp_unsigned("<", levels, one), one, levels)
    has_event = builder.bitcast(word, ir.VectorType(_BIT, TILE_SLOTS))
    return builder.select(has_event, at_least_one, none)


def _twins(builder: Any, levels: Any) -> Any:
    """Each slot is compared with the next one of its channel, the next but one, ..., the first half also with those
    opposite. Two distances at once."""
    both = builder.shuffle_vector(levels, levels, _mask(list(range(2 * TILE_SLOTS))))
    nothing = ir.Constant(ir.VectorType(_BYTE, 2 * TILE_SLOTS), [0] * 2 * TILE_SLOTS)
    has_event = builder.icmp_unsigned("!=", both, nothing)
    twins = ir.Constant(_LONG, 0)
    for distance in range(1, CHANNEL_SLOTS // 2 + 1, 2):
        others = [
            channel + (place + distance + further) % CHANNEL_SLOTS
            for further in (0, 1)
            for channel in (0, CHANNEL_SLOTS)
            for place in range(CHANNEL_SLOTS)
        ]
        same = builder.icmp_unsigned("==", both, builder.shuffle_vector(levels, levels, _mask(others)))
        found = builder.bitcast(builder.and_(same, has_event), _LONG)
        if 2 * (distance + 1) == CHANNEL_SLOTS:
            found = builder.and_(found, ir.Constant(_LONG, 0x00FF00FFFFFFFFFF))
        twins = builder.add(twins, builder.ctpop(found))
    return builder.trunc(twins, _WORD)


def _count_bits(builder: Any, words: Any) -> Any:
    """In each of the lanes; the builder's own method takes single words alone."""
    kind = ir.FunctionType(words.type, [words.type])
    name = f"llvm.ctpop.v{words.type.count}i{words.type.element.width}"
    return builder.call(get_or_insert_function(builder.module, kind, name), [words])  # type: ignore[no-untyped-call]


def _looked_up(builder: Any, table: Any, numbers: Any, is_wanted: Any) -> Any:
    """The table's entries of these numbers, 0 where not wanted; on AVX-512 all in one instruction."""
    nothing = ir.Constant(table.type, [0] * LANES)
    found = nothing
    for lane in range(LANES):
        here = ir.Constant(_WORD, lane)
        entry = builder.extract_element(table, builder.extract_element(numbers, here))
        found = builder.insert_element(found, entry, here)
    return builder.select(is_wanted, found, nothing)


def _gained_in(_typing: Any, slots: Any, befores: Any, high: Any, low: Any, first: Any) -> Any:
    lanes = ir.VectorType(_WORD, LANES)

    def in_each(value: int) -> Any:
        return ir.Constant(lanes, [value] * LANES)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        *arrays, first_ = arguments
        indices = first_, first_, _START, _START
        slots_, befores_, high_, low_ = (
            _pointer(context, builder, kind, array, index, lanes)
            for kind, array, index in zip(signature.args, arrays, indices, strict=False)
        )
        slot, before = builder.load(slots_, align=4), builder.load(befores_, align=4)
        pixel = builder.shl(in_each(1), builder.and_(slot, in_each(TILE_SLOTS - 1)))
        channel = builder.shl(in_each(0xFFFF), builder.and_(slot, in_each(CHANNEL_SLOTS)))
        # A full channel, where nothing is new, may have any entry.
        numbers = builder.and_(_count_bits(builder, builder.and_(before, channel)), in_each(CHANNEL_SLOTS - 1))
        is_new = builder.icmp_unsigned("==", builder.and_(before, pixel), in_each(0))
        for to, table in ((slots_, high_), (befores_, low_)):
            builder.store(_looked_up(builder, builder.load(table, align=4), numbers, is_new), to, align=4)
        is_first = builder.bitcast(builder.icmp_unsigned("==", before, in_each(0)), ir.IntType(LANES))
        return builder.zext(builder.ctpop(is_first), _WORD)

    del first
    return types.uint32(slots, befores, high, low, types.uint64), generate


def _tiles_with_events(_typing: Any, words: Any, first: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        words_, first_ = arguments
        group = ir.VectorType(_WORD, GROUP_TILES)
        found = builder.load(_pointer(context, builder, signature.args[0], words_, first_, group), align=4)
        return builder.bitcast(builder.icmp_unsigned("!=", found, ir.Constant(group, [0] * GROUP_TILES)), _LONG)

    del first
    return types.uint64(words, types.uint64), generate


def _tile_levels(_typing: Any, last: Any, slot: Any, word: Any, slope: Any, offset: Any, levels: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        last_, slot_, word_, slope_, offset_, levels_ = arguments
        times = builder.load(_pointer(context, builder, signature.args[0], last_, slot_, _WORDS), align=4)
        found = _levels(builder, times, word_, slope_, offset_)
        kept = _pointer(context, builder, signature.args[5], levels_, _START, _BYTES)
        builder.store(found, kept, align=1)
        return _twins(builder, found)

    del slot, word, slope, offset
    return types.uint32(last, types.uint64, types.uint32, types.float64, types.float64, levels), generate


def _write_tile(_typing: Any, levels: Any, data: Any, byte: Any, row_bytes: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        levels_, data_, byte_, row_bytes_ = arguments
        kept = _pointer(context, builder, signature.args[0], levels_, _START, _BYTES)
        found = builder.load(kept, align=1)
        woven = [channel + place for place in range(CHANNEL_SLOTS) for channel in (0, CHANNEL_SLOTS)]
        rows = builder.bitcast(builder.shuffle_vector(found, found, _mask(woven)), ir.VectorType(_LONG, TILE_SIDE))
        for row in range(TILE_SIDE):
            to = _pointer(context, builder, signature.args[1], data_, byte_, _LONG)
            builder.store(builder.extract_element(rows, ir.Constant(_WORD, row)), to, align=1)
            byte_ = builder.add(byte_, row_bytes_)
        return context.get_dummy_value()

    del byte, row_bytes
    return types.void(levels, data, types.uint64, types.uint64), generate


gained_in = cast("GainedIn", intrinsic(_gained_in))
"""gained_in(slots, befores, gains_high, gains_low, first): in how many of 16 events' tiles there was nothing before.

Takes the slots and the words before them from `first` on, and puts what the events add to the entropy in their places,
the high part and the low part by the tables.
"""

tiles_with_events = cast("TilesWithEvents", intrinsic(_tiles_with_events))
"""tiles_with_events(words, first): a bit for each of the 64 words from the first on that is not 0, lowest first."""

tile_levels = cast("TileLevels", intrinsic(_tile_levels))
"""tile_levels(last, slot, word, slope, offset, levels): how many pairs of pixels of a channel have the same level.

The levels max(1, int(last * slope + offset)) of the 32 slots from `slot` on, 0 where the word has no bit, are put into
`levels`.
"""

write_tile = cast("WriteTile", intrinsic(_write_tile))
"""write_tile(levels, data, byte, row_bytes): put a tile's levels into a frame's data, flat: four rows of 8 bytes, which
have On and Off of a pixel beside each other."""
