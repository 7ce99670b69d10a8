"""The grey levels of a tile, 32 at a time, and which of 64 tiles have events, by vector instructions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias, cast

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import types
from numba.core.cgutils import alloca_once_value
from numba.extending import intrinsic

from etd_ros.conversion.cell_map import CHANNEL_SLOTS, GROUP_TILES, TILE_SIDE, TILE_SLOTS
from etd_ros.conversion.tile_tables import (
    FIXED_ERROR,
    FIXED_ONE,
    NEAR_NEXT,
    ONES,
    UNWOVEN_LOW_BYTES,
    WHOLE_PART,
    WOVEN,
    pick_bytes,
    vector_of,
)
from etd_ros.conversion.twins import count_twins
from etd_ros.conversion.vectors import (
    BIT,
    BYTE,
    DOUBLE,
    FLOAT,
    LONG,
    WORD,
    all_lanes,
    as_it_is,
    fetch,
    has_features,
    items,
    spread_bits,
    vector_at,
)

TilesWithEvents: TypeAlias = "Callable[[npt.NDArray[np.uint32], np.uint64], np.uint64]"
TileLevels: TypeAlias = (
    "Callable[[npt.NDArray[np.int32], np.uint64, np.uint32, float, float, npt.NDArray[np.uint8], bool, np.uint64],"
    " np.uint32]"
)
FetchTile: TypeAlias = "Callable[[npt.NDArray[np.int32], np.uint64], None]"
SlotsOfLevel: TypeAlias = "Callable[[npt.NDArray[np.uint8], np.uint8], np.uint32]"
ClearRow: TypeAlias = "Callable[[npt.NDArray[np.uint8], np.uint64], None]"
WriteTile: TypeAlias = "Callable[[npt.NDArray[np.uint8], npt.NDArray[np.uint8], np.uint64, np.uint64, np.uint64], None]"

_ZERO = ir.Constant(LONG, 0)
_BITS, _BYTES, _WORDS, _FLOATS, _DOUBLES = (
    ir.VectorType(kind, TILE_SLOTS) for kind in (BIT, BYTE, WORD, FLOAT, DOUBLE)
)
_GROUP = ir.VectorType(WORD, GROUP_TILES)
_CHANNEL, _HALVES = ir.VectorType(WORD, CHANNEL_SLOTS), ir.VectorType(ir.IntType(16), TILE_SLOTS)

_ON_SLOTS, _OFF_SLOTS = list(range(CHANNEL_SLOTS)), list(range(CHANNEL_SLOTS, TILE_SLOTS))
_HALF = all_lanes(_CHANNEL, 16)


def _mask(slots: Sequence[int]) -> ir.Constant:
    return ir.Constant(ir.VectorType(WORD, len(slots)), list(slots))


def _in_each_slot(builder: Any, value: Any) -> Any:
    undefined = ir.Constant(ir.VectorType(value.type, TILE_SLOTS), ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(WORD, 0))
    return builder.shuffle_vector(first, undefined, _mask([0] * TILE_SLOTS))


def _levels(context: Any, builder: Any, times: Any, word: Any, slope: Any, offset: Any, tables: Any) -> Any:
    """In 32 bits, 16 of them behind the point, if no slot is so near to where a level begins that the error of that
    matters: hardly any is. Else in 64. Times without an event are old ones, whose levels may be anything: the last
    selection drops those."""
    have_events = builder.bitcast(word, _BITS)
    raised = builder.fadd(_in_fixed_point(builder, offset), ir.Constant(FLOAT, FIXED_ERROR))
    fixed = _rounded(builder, times, _FLOATS, _in_fixed_point(builder, slope), raised)
    on, off = (builder.shuffle_vector(fixed, fixed, _mask(slots)) for slots in (_ON_SLOTS, _OFF_SLOTS))
    # By turns a half of On, below, and one of Off.
    whole_on, fraction_off = builder.lshr(on, _HALF), builder.shl(off, _HALF)
    whole_on, fraction_off = (as_it_is(context, builder, halves) for halves in (whole_on, fraction_off))
    whole = vector_of(builder, tables, WHOLE_PART, CHANNEL_SLOTS)
    whole_parts = builder.or_(whole_on, builder.and_(off, whole))
    fractions = builder.or_(builder.and_(on, builder.not_(whole)), fraction_off)
    whole_parts, fractions = (as_it_is(context, builder, halves) for halves in (whole_parts, fractions))
    fractions = builder.bitcast(fractions, _HALVES)
    bytes_ = builder.bitcast(whole_parts, ir.VectorType(BYTE, 2 * TILE_SLOTS))
    low_bytes = pick_bytes(context, builder, bytes_, tables, UNWOVEN_LOW_BYTES)
    levels = alloca_once_value(builder, low_bytes)  # type: ignore[no-untyped-call]
    near_next = builder.icmp_unsigned("<", fractions, vector_of(builder, tables, NEAR_NEXT, TILE_SLOTS))
    unsure = builder.and_(builder.bitcast(near_next, WORD), _woven_bits(context, builder, word))
    with builder.if_then(builder.icmp_unsigned("!=", unsure, ir.Constant(WORD, 0)), likely=False):
        builder.store(builder.trunc(_rounded(builder, times, _DOUBLES, slope, offset), _BYTES), levels)
    found, one = builder.load(levels), vector_of(builder, tables, ONES, TILE_SLOTS)
    at_least_one = builder.select(builder.icmp_unsigned("<", found, one), one, found)
    return builder.select(have_events, at_least_one, all_lanes(_BYTES, 0))


def _rounded(builder: Any, times: Any, kind: ir.VectorType, slope: Any, offset: Any) -> Any:
    """The whole part of times * slope + offset, worked out in floating-point numbers of a kind."""
    may_fuse = ("contract",)
    exact = builder.fmul(builder.sitofp(times, kind), _in_each_slot(builder, slope), flags=may_fuse)
    return builder.fptosi(builder.fadd(exact, _in_each_slot(builder, offset), flags=may_fuse), _WORDS)


def _in_fixed_point(builder: Any, value: Any) -> Any:
    return builder.fptrunc(builder.fmul(value, ir.Constant(DOUBLE, FIXED_ONE)), FLOAT)


def _woven_bits(context: Any, builder: Any, word: Any) -> Any:
    """A word's bits of On and Off by turns."""
    if has_features(context, "avx512vbmi", "bmi2"):
        off = builder.lshr(word, ir.Constant(WORD, CHANNEL_SLOTS))
        return builder.or_(spread_bits(builder, word, 0x55555555), spread_bits(builder, off, 0xAAAAAAAA))
    bits = builder.bitcast(word, _BITS)
    return builder.bitcast(builder.shuffle_vector(bits, bits, _mask(WOVEN.numbers)), WORD)


def _tiles_with_events(_typing: Any, words: Any, first: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        words_ = items(context, builder, signature.args[0], arguments[0])
        found = builder.load(vector_at(builder, words_, arguments[1], _GROUP), align=4)
        return builder.bitcast(builder.icmp_unsigned("!=", found, all_lanes(_GROUP, 0)), LONG)

    del first
    return types.uint64(words, types.uint64), generate


def _tile_levels(
    _typing: Any, last: Any, slot: Any, word: Any, slope: Any, offset: Any, levels: Any, with_twins: Any, tables: Any
) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        _, slot_, word_, slope_, offset_, _, with_twins_, tables_ = arguments
        last_, levels_ = (items(context, builder, signature.args[k], arguments[k]) for k in (0, 5))
        times = builder.load(vector_at(builder, last_, slot_, _WORDS), align=4)
        found = _levels(context, builder, times, word_, slope_, offset_, tables_)
        builder.store(found, vector_at(builder, levels_, _ZERO, _BYTES), align=1)
        twins = alloca_once_value(builder, ir.Constant(WORD, 0))  # type: ignore[no-untyped-call]
        with builder.if_then(with_twins_, likely=True):
            builder.store(count_twins(context, builder, found, word_, tables_), twins)
        return builder.load(twins)

    del slot, word, slope, offset, with_twins, tables
    numbers = (types.uint64, types.uint32, types.float64, types.float64)
    return types.uint32(last, *numbers, levels, types.boolean, types.uint64), generate


def _fetch_tile(_typing: Any, last: Any, slot: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        first = items(context, builder, signature.args[0], arguments[0])
        for line in range(0, TILE_SLOTS, CHANNEL_SLOTS):
            time = builder.gep(first, [builder.add(arguments[1], ir.Constant(LONG, line))])
            fetch(builder, time, to_write=False)
        return context.get_dummy_value()

    del slot
    return types.void(last, types.uint64), generate


def _slots_of_level(_typing: Any, levels: Any, level: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        levels_ = items(context, builder, signature.args[0], arguments[0])
        found = builder.load(vector_at(builder, levels_, _ZERO, _BYTES), align=1)
        same = builder.icmp_unsigned("==", found, _in_each_slot(builder, arguments[1]))
        return builder.bitcast(same, WORD)

    del level
    return types.uint32(levels, types.uint8), generate


def _write_tile(_typing: Any, levels: Any, data: Any, byte: Any, row_bytes: Any, tables: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        _, _, byte_, row_bytes_, tables_ = arguments
        levels_, data_ = (items(context, builder, signature.args[k], arguments[k]) for k in (0, 1))
        found = builder.load(vector_at(builder, levels_, _ZERO, _BYTES), align=1)
        woven = pick_bytes(context, builder, found, tables_, WOVEN)
        rows = builder.bitcast(woven, ir.VectorType(DOUBLE, TILE_SIDE))
        rows = as_it_is(context, builder, rows)
        for row in range(TILE_SIDE):
            # Numbers with a point only in name: the processor stores the upper half of a vector of those as it lies.
            to = vector_at(builder, data_, byte_, DOUBLE)
            builder.store(builder.extract_element(rows, ir.Constant(WORD, row)), to, align=1)
            byte_ = builder.add(byte_, row_bytes_)
        return context.get_dummy_value()

    del byte, row_bytes, tables
    return types.void(levels, data, types.uint64, types.uint64, types.uint64), generate


def _clear_row(_typing: Any, data: Any, byte: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data_ = items(context, builder, signature.args[0], arguments[0])
        builder.store(_ZERO, vector_at(builder, data_, arguments[1], LONG), align=1)
        return context.get_dummy_value()

    del byte
    return types.void(data, types.uint64), generate


tiles_with_events = cast("TilesWithEvents", intrinsic(_tiles_with_events))
"""tiles_with_events(words, first): a bit for each of the 64 words from the first on that is not 0, lowest first."""

tile_levels = cast("TileLevels", intrinsic(_tile_levels))
"""tile_levels(last, slot, word, slope, offset, levels, with_twins, tables): how many pairs of pixels of a channel have
the same level, 0 where that is not asked for; tables are what `tile_tables` returns.

The levels max(1, int(last * slope + offset)) of the 32 slots from `slot` on, 0 where the word has no bit, are put into
`levels`.
"""

fetch_tile = cast("FetchTile", intrinsic(_fetch_tile))
"""fetch_tile(last, slot): have the times of the 32 slots from `slot` on, which may be beyond the last, brought near."""

slots_of_level = cast("SlotsOfLevel", intrinsic(_slots_of_level))
"""slots_of_level(levels, level): a bit for each of a tile's 32 slots that has this level, lowest first."""

write_tile = cast("WriteTile", intrinsic(_write_tile))
"""write_tile(levels, data, byte, row_bytes, tables): put a tile's levels into a frame's data, flat: four rows of 8
bytes, which have On and Off of a pixel beside each other."""

clear_row = cast("ClearRow", intrinsic(_clear_row))
"""clear_row(data, byte): clear 8 bytes of a frame's data, flat: a row of a tile."""
