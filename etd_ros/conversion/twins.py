"""How many pairs of a tile's pixels have the same level, in vector instructions.

A tile that holds few events, as most do, has their levels moved together first (one instruction on AVX-512 with VBMI2):
all their pairs are compared at once then, instead of all slots' pairs by four comparisons.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias, cast

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import types
from numba.core.cgutils import alloca_once_value, get_or_insert_function
from numba.extending import intrinsic

from etd_ros.conversion.cell_map import CHANNEL_SLOTS, TILE_SLOTS
from etd_ros.conversion.tile_tables import EARLIER, FEW_EVENTS, LATER, PAIRS_IN_CHANNELS, number_of, pick_bytes
from etd_ros.conversion.vectors import BIT, BYTE, LONG, WORD, all_lanes, has_features, items, vector_at

PairsOfFew: TypeAlias = "Callable[[npt.NDArray[np.uint8], np.uint32, np.uint64], np.uint64]"

_ZERO = ir.Constant(LONG, 0)
_BITS, _BYTES = (ir.VectorType(kind, TILE_SLOTS) for kind in (BIT, BYTE))
_TWO_TILES = ir.VectorType(BYTE, 2 * TILE_SLOTS)


def count_twins(context: Any, builder: Any, levels: Any, word: Any, tables: Any) -> Any:
    """Number of pairs of slots of one channel that have the same level, other than 0.

    Args:
        context: the compiler's.
        builder: of the function that is being compiled.
        levels: of the 32 slots.
        word: a bit for each slot that has an event; the others have level 0.
        tables: of `tile_tables`.
    """
    if not _can_move_together(context):
        return _twins_of_all(builder, levels)
    is_few = builder.icmp_unsigned("<=", builder.ctpop(word), ir.Constant(WORD, FEW_EVENTS))
    twins = alloca_once_value(builder, ir.Constant(WORD, 0))  # type: ignore[no-untyped-call]
    with builder.if_else(is_few, likely=True) as (few, many):
        with few:
            pairs = _pairs_of_few(context, builder, levels, word, tables)
            builder.store(builder.trunc(builder.ctpop(pairs), WORD), twins)
        with many:
            builder.store(_twins_of_all(builder, levels), twins)
    return builder.load(twins)


def _can_move_together(context: Any) -> bool:
    """Whether the processor has an instruction for it: else it takes longer than to compare all slots."""
    return has_features(context, "avx512vbmi", "avx512vbmi2")


def _twins_of_all(builder: Any, levels: Any) -> Any:
    """Each slot is compared with the next one of its channel, the next but one, ..., the first half also with those
    opposite. Two distances at once."""
    both = builder.shuffle_vector(levels, levels, _numbers(list(range(TILE_SLOTS)) * 2))
    have_events = builder.icmp_unsigned("!=", both, all_lanes(_TWO_TILES, 0))
    twins = _ZERO
    for distance in range(1, CHANNEL_SLOTS // 2 + 1, 2):
        others = [
            channel + (place + distance + further) % CHANNEL_SLOTS
            for further in (0, 1)
            for channel in (0, CHANNEL_SLOTS)
            for place in range(CHANNEL_SLOTS)
        ]
        same = builder.icmp_unsigned("==", both, builder.shuffle_vector(levels, levels, _numbers(others)))
        found = builder.bitcast(builder.and_(same, have_events), LONG)
        if 2 * (distance + 1) == CHANNEL_SLOTS:
            found = builder.and_(found, ir.Constant(LONG, 0x00FF00FFFFFFFFFF))
        twins = builder.add(twins, builder.ctpop(found))
    return builder.trunc(twins, WORD)


def _pairs_of_few(context: Any, builder: Any, levels: Any, word: Any, tables: Any) -> Any:
    kind = ir.FunctionType(_BYTES, [_BYTES, _BITS, _BYTES])
    compress = get_or_insert_function(builder.module, kind, f"llvm.experimental.vector.compress.v{TILE_SLOTS}i8")  # type: ignore[no-untyped-call]
    together = builder.call(compress, [levels, builder.bitcast(word, _BITS), all_lanes(_BYTES, 0)])
    wide = builder.shuffle_vector(together, ir.Constant(_BYTES, ir.Undefined), _numbers(list(range(2 * TILE_SLOTS))))
    earlier, later = (pick_bytes(context, builder, wide, tables, places) for places in (EARLIER, LATER))
    same = builder.bitcast(builder.icmp_unsigned("==", earlier, later), LONG)
    on_events, events = (builder.ctpop(bits) for bits in (builder.and_(word, ir.Constant(WORD, 0xFFFF)), word))
    number = builder.add(builder.mul(on_events, ir.Constant(WORD, FEW_EVENTS + 1)), events)
    return builder.and_(same, number_of(builder, tables, PAIRS_IN_CHANNELS, builder.zext(number, LONG)))


def _numbers(numbers: list[int]) -> ir.Constant:
    return ir.Constant(ir.VectorType(WORD, len(numbers)), numbers)


def _pairs(_typing: Any, levels: Any, word: Any, tables: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        first = items(context, builder, signature.args[0], arguments[0])
        found = builder.load(vector_at(builder, first, _ZERO, _BYTES), align=1)
        return _pairs_of_few(context, builder, found, *arguments[1:])

    del word, tables
    return types.uint64(levels, types.uint32, types.uint64), generate


pairs_of_few = cast("PairsOfFew", intrinsic(_pairs))
"""pairs_of_few(levels, word, tables): which of a tile's at most FEW_EVENTS events have the level of an earlier slot's
event in their channel. A bit for the second event and the first one, two for the third and the first two, and so on."""
