"""Which slots of a cell map events have, 16 at a time, where a cell is one tile of 4 x 4 pixels.

The compiler would work them out in 64 bits, a third as fast.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias, cast

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import types
from numba.core.cgutils import for_range_slice
from numba.extending import intrinsic

from etd_ros.conversion.cell_map import CHANNEL_SLOTS, LANES, TILE_SIDE, TILE_SLOTS
from etd_ros.conversion.vectors import LONG, WORD, all_lanes, fetch, item_at, items, vector_at

FindSlots: TypeAlias = (
    "Callable[[npt.NDArray[np.uint16], npt.NDArray[np.uint16], npt.NDArray[np.uint8], np.uint64, np.uint64, np.uint32,"
    " npt.NDArray[np.uint32]], None]"
)
FetchEvents: TypeAlias = (
    "Callable[[npt.NDArray[np.int64], npt.NDArray[np.uint16], npt.NDArray[np.uint16], npt.NDArray[np.uint8],"
    " np.uint64], None]"
)

LINE_BYTES = 64
"""Of the processor's near memory: 64 events have as many lines of a column as an item of it has bytes."""

_LANES = ir.VectorType(WORD, LANES)
_SIDE_BITS = TILE_SIDE.bit_length() - 1
_ZERO = ir.Constant(LONG, 0)


def _numbers(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """The 16 items of an array of Numba's type `kind` from an index on, as words; the array need not be contiguous.

    Arrays of other than integers of the right size are refused before: for those this only has to compile.
    """
    item_bytes = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    item = ir.IntType(8 * item_bytes)
    if kind.layout == "C":
        first = items(context, builder, kind, array)
        found = builder.load(vector_at(builder, first, index, ir.VectorType(item, LANES)), align=item_bytes)
    else:
        found = ir.Constant(ir.VectorType(item, LANES), ir.Undefined)
        for lane in range(LANES):
            place = item_at(context, builder, kind, array, builder.add(index, ir.Constant(LONG, lane)))
            number = builder.load(builder.bitcast(place, item.as_pointer()))
            found = builder.insert_element(found, number, ir.Constant(WORD, lane))
    if item.width == WORD.width:
        return found
    return builder.zext(found, _LANES) if item.width < WORD.width else builder.trunc(found, _LANES)


def _slots(builder: Any, column: Any, row: Any, polarity: Any, cell_columns: Any) -> Any:
    def of(number: int) -> Any:
        return all_lanes(_LANES, number)

    cell_row, cell_column = (builder.lshr(place, of(_SIDE_BITS)) for place in (row, column))
    cell = builder.add(builder.mul(cell_row, cell_columns), cell_column)
    row_in_cell, column_in_cell = (builder.and_(place, of(TILE_SIDE - 1)) for place in (row, column))
    place = builder.or_(builder.shl(row_in_cell, of(_SIDE_BITS)), column_in_cell)
    off = builder.shl(builder.xor(polarity, of(1)), of(CHANNEL_SLOTS.bit_length() - 1))
    return builder.or_(builder.or_(builder.shl(cell, of(TILE_SLOTS.bit_length() - 1)), place), off)


def _find_slots(_typing: Any, x: Any, y: Any, p: Any, first: Any, number: Any, cell_columns: Any, slots: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        *events, first_, number_, columns_, slots_ = arguments
        slots_ = items(context, builder, signature.args[6], slots_)
        columns = builder.insert_element(ir.Constant(_LANES, ir.Undefined), columns_, ir.Constant(WORD, 0))
        columns = builder.shuffle_vector(columns, columns, ir.Constant(_LANES, [0] * LANES))
        with for_range_slice(builder, _ZERO, number_, ir.Constant(LONG, LANES), LONG) as (index, _):
            place = builder.add(first_, index)
            kinds = zip(signature.args[:3], events, strict=True)
            column, row, polarity = (_numbers(context, builder, kind, array, place) for kind, array in kinds)
            found = _slots(builder, column, row, polarity, columns)
            builder.store(found, vector_at(builder, slots_, index, _LANES), align=4)
        return context.get_dummy_value()

    del first, number, cell_columns
    return types.void(x, y, p, types.uint64, types.uint64, types.uint32, slots), generate


def _fetch_events(_typing: Any, t: Any, x: Any, y: Any, p: Any, first: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        *events, first_ = arguments
        for kind, array in zip(signature.args, events, strict=False):
            item_bytes = context.get_abi_sizeof(context.get_data_type(kind.dtype))
            for line in range(item_bytes if kind.layout == "C" else 0):
                place = builder.add(first_, ir.Constant(LONG, line * LINE_BYTES // item_bytes))
                fetch(builder, builder.gep(items(context, builder, kind, array), [place]), to_write=False)
        return context.get_dummy_value()

    del first
    return types.void(t, x, y, p, types.uint64), generate


find_slots = cast("FindSlots", intrinsic(_find_slots))
"""find_slots(x, y, p, first, number, cell_columns, slots): the slots of events first .. first + number - 1, a multiple
of 16, of a map with so many cells in a row; put into `slots` from its beginning on."""

fetch_events = cast("FetchEvents", intrinsic(_fetch_events))
"""fetch_events(t, x, y, p, first): have 64 events, of which some may be beyond the last, brought near where their
arrays are contiguous."""
