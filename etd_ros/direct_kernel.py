"""Kernels that Python calls without Numba's look at the types of their arguments, for calls that do little.

For nine arguments that look takes .3 us, twice as long as the call itself, and as long as to add the events of a small
message. A direct kernel is called by its entry point instead. What Python hands it may be anything then: it takes
arrays that come from outside as `python_object`s, asks of each whether it is a plain array, and reads it only then, by
the structure that NumPy has published for compiled code.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, ParamSpec, TypeAlias, TypeVar, cast

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import types
from numba.core.cgutils import alloca_once_value
from numba.extending import NativeValue, intrinsic, models, register_model, unbox
from numba.np.arrayobj import populate_array

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
Item = TypeVar("Item", bound=np.generic)

Addresses: TypeAlias = npt.NDArray[np.int64]
IsPlain: TypeAlias = "Callable[[npt.NDArray[Any], Addresses, int], bool]"
Take: TypeAlias = "Callable[[npt.NDArray[Item]], npt.NDArray[Item]]"

_BIT, _BYTE, _INT, _LONG = (ir.IntType(bits) for bits in (1, 8, 32, 64))
_POINTER, _SIZES = _BYTE.as_pointer(), _LONG.as_pointer()
_REFERENCES = ir.ArrayType(_BYTE, object.__basicsize__ - _LONG.width // 8)

_ARRAY = ir.LiteralStructType([_REFERENCES, _LONG, _POINTER, _INT, _SIZES, _SIZES, _POINTER, _LONG, _INT])
"""PyArrayObject_fields: references, ob_type, data, nd, dimensions, strides, base, descr, flags; types as addresses."""
_TYPE, _DATA, _DIMENSIONS, _SHAPE, _DTYPE, _FLAGS = 1, 2, 3, 4, 7, 8

_CONTIGUOUS_AND_ALIGNED = 0x1 | 0x100


class _PythonObject(types.Type):
    """A Python object as it is."""

    def __init__(self) -> None:
        super().__init__(name="python_object")


register_model(_PythonObject)(models.OpaqueModel)

python_object = _PythonObject()
"""The type of a direct kernel's argument that may be anything."""


@unbox(_PythonObject)  # type: ignore[no-untyped-call]
def _as_it_is(_kind: Any, value: Any, _context: Any) -> Any:
    return NativeValue(value)  # type: ignore[no-untyped-call]


def addresses_of(*dtypes: type[np.generic]) -> Addresses:
    """What `is_plain` compares with: where the type of arrays lies, then those of their items."""
    return np.array([id(np.ndarray), *(id(np.dtype(dtype)) for dtype in dtypes)], np.int64)


def _field(builder: Any, array: Any, number: int) -> Any:
    fields = builder.bitcast(array, _ARRAY.as_pointer())
    return builder.load(builder.gep(fields, [ir.Constant(_INT, 0), ir.Constant(_INT, number)]))


def _is_plain(_typing: Any, array: Any, addresses: Any, number: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array_, addresses_, number_ = arguments
        known = context.make_array(signature.args[1])(context, builder, addresses_).data
        type_, dtype = (builder.load(builder.gep(known, [index])) for index in (ir.Constant(_LONG, 0), number_))
        found = alloca_once_value(builder, ir.Constant(_BIT, 0))  # type: ignore[no-untyped-call]
        # Only an array has the other fields.
        with builder.if_then(builder.icmp_unsigned("==", _field(builder, array_, _TYPE), type_)):
            has_one = builder.icmp_unsigned("==", _field(builder, array_, _DIMENSIONS), ir.Constant(_INT, 1))
            is_of_dtype = builder.icmp_unsigned("==", _field(builder, array_, _DTYPE), dtype)
            wanted = ir.Constant(_INT, _CONTIGUOUS_AND_ALIGNED)
            is_whole = builder.icmp_unsigned("==", builder.and_(_field(builder, array_, _FLAGS), wanted), wanted)
            builder.store(builder.and_(builder.and_(has_one, is_of_dtype), is_whole), found)
        return builder.load(found)

    del number
    return types.boolean(array, addresses, types.int64), generate


def _take(dtype: types.Type) -> Any:
    kind = types.Array(dtype, 1, "C", readonly=True)

    def take(_typing: Any, array: Any) -> Any:
        def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            taken = context.make_array(kind)(context, builder)
            first = builder.bitcast(_field(builder, arguments[0], _DATA), taken.data.type)
            length = builder.load(_field(builder, arguments[0], _SHAPE))
            size = ir.Constant(_LONG, context.get_abi_sizeof(context.get_data_type(dtype)))
            populate_array(taken, first, [length], [size], size, None)  # type: ignore[no-untyped-call]
            return taken._getvalue()

        return kind(array), generate

    return intrinsic(take)


is_plain = cast("IsPlain", intrinsic(_is_plain))
"""is_plain(array, addresses, number): whether a `python_object` is an array, of the very type and not a derived one, of
one dimension, contiguous, aligned, of the number-th of the data types that `addresses_of` was given, from 1 on."""

take_int64 = cast("Take[np.int64]", _take(types.int64))
take_uint16 = cast("Take[np.uint16]", _take(types.uint16))
take_uint8 = cast("Take[np.uint8]", _take(types.uint8))
"""take_...(array): the array that a `python_object` is; it must be plain, of that data type."""


class DirectKernel(Generic[Arguments, Result]):
    """Calls a kernel by its entry point.

    Attributes:
        call: calls it; the first time it is compiled before, or taken from the cache.
    """

    __slots__ = ("_kernel", "_kinds", "call")

    def __init__(self, kernel: Callable[Arguments, Result], kinds: tuple[types.Type, ...]) -> None:
        """Prepare.

        Args:
            kernel: a compiled function.
            kinds: Numba's types of its arguments. Nobody verifies later that they are those.
        """
        self._kernel = kernel
        self._kinds = kinds
        self.call: Callable[Arguments, Result] = self._call_first

    def _call_first(self, *arguments: Arguments.args, **named: Arguments.kwargs) -> Result:
        self.call = cast("Any", self._kernel).compile(self._kinds)
        return self.call(*arguments, **named)
