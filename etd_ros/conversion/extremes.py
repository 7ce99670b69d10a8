"""What is largest in a part of a batch, and whether its times ever go back, 32 events at a time.

The compiler would take a loop for each array, in steps of up to 128 events, and what is left one by one: most of the
events of a small message.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias, cast

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import types
from numba.core.cgutils import alloca_once_value, for_range_slice
from numba.extending import intrinsic

from etd_ros.conversion.vectors import BIT, BYTE, HALF, LONG, all_lanes, items, largest_lane, vector_at

Extremes: TypeAlias = (
    "Callable[[npt.NDArray[np.int64], npt.NDArray[np.uint16], npt.NDArray[np.uint16], npt.NDArray[np.uint8], int, int],"
    " tuple[int, int, int, bool]]"
)

AreReadable: TypeAlias = "Callable[[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]], bool]"

EVENTS_AT_ONCE = 32
EVENTS_MIN = EVENTS_AT_ONCE + 1
"""As many as there are pairs of a time and the next one, and one more."""

_HALVES, _BYTES = (ir.VectorType(kind, EVENTS_AT_ONCE) for kind in (HALF, BYTE))
_LONGS_AT_ONCE = 8
_LONGS, _BITS = (ir.VectorType(kind, _LONGS_AT_ONCE) for kind in (LONG, BIT))
_STEP = ir.Constant(LONG, EVENTS_AT_ONCE)


def _are_readable(_typing: Any, t: Any, x: Any, y: Any, p: Any) -> Any:
    def generate(context: Any, _builder: Any, signature: Any, _arguments: Any) -> Any:
        return context.get_constant(types.boolean, _have_right_types(signature.args))

    return types.boolean(t, x, y, p), generate


def _have_right_types(arrays: Any) -> bool:
    dtypes = types.int64, types.uint16, types.uint16, types.uint8
    return all(array.dtype == dtype and array.layout == "C" for array, dtype in zip(arrays, dtypes, strict=True))


def _extremes(_typing: Any, t: Any, x: Any, y: Any, p: Any, first: Any, stop: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        *arrays, first_, stop_ = zip(signature.args, arguments, strict=True)
        if not _have_right_types([kind for kind, _ in arrays]):
            return context.get_constant_null(signature.return_type)
        times, *numbers = (items(context, builder, kind, array) for kind, array in arrays)
        begin, end = (bound for _, bound in (first_, stop_))
        kinds = (_HALVES, _HALVES, _BYTES)
        largest = [alloca_once_value(builder, all_lanes(kind, 0)) for kind in kinds]  # type: ignore[no-untyped-call]
        goes_back = alloca_once_value(builder, all_lanes(_BITS, 0))  # type: ignore[no-untyped-call]
        with for_range_slice(builder, begin, end, _STEP, LONG) as (index, _):
            # The last events are looked at together with some that have been before.
            place = _at_most(builder, index, builder.sub(end, _STEP))
            for kind, first, so_far in zip(kinds, numbers, largest, strict=True):
                found, before = builder.load(vector_at(builder, first, place, kind), align=1), builder.load(so_far)
                builder.store(builder.select(builder.icmp_unsigned(">", found, before), found, before), so_far)
            pair = _at_most(builder, index, builder.sub(end, ir.Constant(LONG, EVENTS_MIN)))
            for group in range(0, EVENTS_AT_ONCE, _LONGS_AT_ONCE):
                earlier, later = (
                    builder.load(
                        vector_at(builder, times, builder.add(pair, ir.Constant(LONG, group + further)), _LONGS),
                        align=8,
                    )
                    for further in (0, 1)
                )
                steps_back = builder.icmp_signed("<", later, earlier)
                builder.store(builder.or_(builder.load(goes_back), steps_back), goes_back)
        maxima = (builder.zext(largest_lane(builder, builder.load(so_far)), LONG) for so_far in largest)
        any_back = builder.icmp_unsigned("!=", builder.bitcast(builder.load(goes_back), BYTE), ir.Constant(BYTE, 0))
        return context.make_tuple(builder, signature.return_type, [*maxima, any_back])

    result = types.Tuple((types.int64, types.int64, types.int64, types.boolean))  # type: ignore[no-untyped-call]
    del first, stop
    return result(t, x, y, p, types.int64, types.int64), generate


def _at_most(builder: Any, number: Any, most: Any) -> Any:
    return builder.select(builder.icmp_signed("<", number, most), number, most)


are_readable = cast("AreReadable", intrinsic(_are_readable))
"""are_readable(t, x, y, p): whether `extremes` can read these arrays: they are contiguous, of int64, uint16, uint16 and
uint8. The compiler knows it."""

extremes = cast("Extremes", intrinsic(_extremes))
"""extremes(t, x, y, p, first, stop): the largest column, row and polarity of events first .. stop - 1, and whether a
time is before that of the event before it among these.

The arrays must be readable, and there must be at least EVENTS_MIN of these events.
"""
