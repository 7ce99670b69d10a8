"""The grey levels of a tile, 32 at a time, by vector instructions that the compiler does not make of a loop.

They are written as LLVM's own vector operations, which it has for every processor.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias, cast

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from etd_ros.conversion.cell_map import TILE_SIDE, TILE_SLOTS

CHANNEL_SLOTS = TILE_SLOTS // 2

TileLevels: TypeAlias = (
    "Callable[[npt.NDArray[np.int32], np.uint64, np.uint32, float, float, npt.NDArray[np.uint8]], np.uint32]"
)
WriteTile: TypeAlias = "Callable[[npt.NDArray[np.uint8], npt.NDArray[np.uint8], np.uint64, np.uint64], None]"

_BYTE, _WORD, _ROW, _DOUBLE = ir.IntType(8), ir.IntType(32), ir.IntType(64), ir.DoubleType()
_START = ir.Constant(ir.IntType(64), 0)
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
    exact = builder.fmul(builder.sitofp(times, _DOUBLES), _in_each_slot(builder, slope))
    whole = builder.fptosi(builder.fadd(exact, _in_each_slot(builder, offset)), _WORDS)
    one, none = (ir.Constant(_WORDS, [value] * TILE_SLOTS) for value in (1, 0))
    at_least_one = builder.select(builder.icmp_signed("<", whole, one), one, whole)
    has_event = builder.bitcast(word, ir.VectorType(ir.IntType(1), TILE_SLOTS))
    return builder.trunc(builder.select(has_event, at_least_one, none), _BYTES)


def _twins(builder: Any, levels: Any) -> Any:
    """Each slot is compared with the next one of its channel, the next but one, ..., the first half also with those
    opposite."""
    has_event = builder.bitcast(builder.icmp_unsigned("!=", levels, ir.Constant(_BYTES, [0] * TILE_SLOTS)), _WORD)
    twins = ir.Constant(_WORD, 0)
    for distance in range(1, CHANNEL_SLOTS // 2 + 1):
        others = [
            channel + (place + distance) % CHANNEL_SLOTS
            for channel in (0, CHANNEL_SLOTS)
            for place in range(CHANNEL_SLOTS)
        ]
        same = builder.icmp_unsigned("==", levels, builder.shuffle_vector(levels, levels, _mask(others)))
        found = builder.and_(builder.bitcast(same, _WORD), has_event)
        if 2 * distance == CHANNEL_SLOTS:
            found = builder.and_(found, ir.Constant(_WORD, 0x00FF00FF))
        twins = builder.add(twins, builder.ctpop(found))
    return twins


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
        rows = builder.bitcast(builder.shuffle_vector(found, found, _mask(woven)), ir.VectorType(_ROW, TILE_SIDE))
        for row in range(TILE_SIDE):
            to = _pointer(context, builder, signature.args[1], data_, byte_, _ROW)
            builder.store(builder.extract_element(rows, ir.Constant(_WORD, row)), to, align=1)
            byte_ = builder.add(byte_, row_bytes_)
        return context.get_dummy_value()

    del byte, row_bytes
    return types.void(levels, data, types.uint64, types.uint64), generate


tile_levels = cast("TileLevels", intrinsic(_tile_levels))
"""tile_levels(last, slot, word, slope, offset, levels): how many pairs of pixels of a channel have the same level.

The levels max(1, int(last * slope + offset)) of the 32 slots from `slot` on, 0 where the word has no bit, are put into
`levels`.
"""

write_tile = cast("WriteTile", intrinsic(_write_tile))
"""write_tile(levels, data, byte, row_bytes): put a tile's levels into a frame's data, flat: four rows of 8 bytes, which
have On and Off of a pixel beside each other."""
