"""Compiled functions that only borrow their arrays.

Otherwise the compiler counts the references to every array that goes from one compiled function to another, up and
down, by locked instructions, and copies their descriptions: for a dozen arrays that takes longer than to add 50 events.
What Python passes lives as long as the call anyway.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np
import numpy.typing as npt
from numba import njit, types
from numba.extending import lower_builtin, type_callable
from numba.np.arrayobj import populate_array

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
Item = TypeVar("Item", bound=np.generic)


def borrowing_kernel(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Compile a function that neither makes arrays nor hands any to Python; without the interpreter's lock, cached.

    The switch for references the compiler has for itself: with it, a function that makes an array does not compile.
    """
    return cast("Callable[Arguments, Result]", cast("Any", njit)(_nrt=False, nogil=True, cache=True)(function))


def kernel_part(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """The same for a function that borrowing kernels alone call: it is put into each of them, and not cached by itself,
    as the cache would know only changes of its own file. It may return arrays, in a tuple.
    """
    return cast("Callable[Arguments, Result]", cast("Any", njit)(_nrt=False, nogil=True, forceinline=True)(function))


def borrowing_part(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """The same for a function that is long, and stays one of its own unless the compiler sees a gain."""
    return cast("Callable[Arguments, Result]", cast("Any", njit)(_nrt=False, nogil=True)(function))


def part_of(array: npt.NDArray[Any], first: int, number: int, dtype: type[Item]) -> npt.NDArray[Item]:
    """The items of dtype, `number` of them, that lie in a contiguous array from its item `first` on.

    In kernels nobody verifies that they do: to cut a dozen parts out of an array takes as long otherwise as to add 20
    events.
    """
    items = -(-number * np.dtype(dtype).itemsize // array.itemsize)
    return array[first : first + items].view(dtype)[:number]


@type_callable(part_of)
def _type_of_part(_context: Any) -> Any:
    def typer(array: Any, first: Any, number: Any, dtype: Any) -> Any:
        del first, number
        return types.Array(dtype.dtype, 1, "C", readonly=not array.mutable)

    return typer


@lower_builtin(part_of, types.Array, types.Integer, types.Integer, types.Any)  # type: ignore[no-untyped-call]
def _lower_part(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    kind, (array, first, number, _) = signature.return_type, signature.args
    whole = context.make_array(array)(context, builder, arguments[0])
    part = context.make_array(kind)(context, builder)
    index, count = (context.cast(builder, arguments[k], kind_, types.int64) for k, kind_ in ((1, first), (2, number)))
    data = builder.bitcast(builder.gep(whole.data, [index]), part.data.type)
    size = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    populate_array(part, data, [count], [size], size, None)  # type: ignore[no-untyped-call]
    return part._getvalue()
