"""Kernels that Python calls without Numba's look at the types of their arguments, for calls that do little.

For nine arguments that look takes .3 us, twice as long as the call itself, and as long as to add the events of a small
message; and the call itself takes another .2 us, as Numba's own entry wraps each argument, gives away the interpreter's
lock and takes it back. A direct kernel is what the interpreter itself calls as a function of C, by its fastest
convention. What Python hands it may be anything then: it asks of arrays that come from outside whether they are plain,
and reads them only then, by the structure that NumPy has published for compiled code. It holds the interpreter's lock
unless it gives it away.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from typing import Any, Generic, NewType, TypeAlias, TypeVar, cast

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import cfunc, types
from numba.core.cgutils import alloca_once_value, get_or_insert_function
from numba.extending import intrinsic, models, register_model
from numba.np.arrayobj import populate_array

Call = TypeVar("Call", bound="Callable[..., object]")
Item = TypeVar("Item", bound=np.generic)

PythonObject = NewType("PythonObject", object)
"""A Python object in a kernel."""

Addresses: TypeAlias = npt.NDArray[np.int64]
Entry: TypeAlias = "Callable[[PythonObject, Sequence[PythonObject], int], PythonObject]"
IsPlain: TypeAlias = "Callable[[PythonObject, Addresses, int], bool]"
Take: TypeAlias = "Callable[[PythonObject], npt.NDArray[Item]]"

_BIT, _BYTE, _INT, _LONG = (ir.IntType(bits) for bits in (1, 8, 32, 64))
_POINTER, _SIZES = _BYTE.as_pointer(), _LONG.as_pointer()
_REFERENCES = ir.ArrayType(_BYTE, object.__basicsize__ - _LONG.width // 8)

_ARRAY = ir.LiteralStructType([_REFERENCES, _LONG, _POINTER, _INT, _SIZES, _SIZES, _POINTER, _LONG, _INT])
"""PyArrayObject_fields: references, ob_type, data, nd, dimensions, strides, base, descr, flags; types as addresses."""
_TYPE, _DATA, _DIMENSIONS, _SHAPE, _DTYPE, _FLAGS = 1, 2, 3, 4, 7, 8

_CONTIGUOUS_AND_ALIGNED = 0x1 | 0x100


class _PythonObject(types.Type):
    """A Python object as it is. The name tells what a kernel is made of, for the compiler's cache."""

    def __init__(self, made_of: str = "") -> None:
        super().__init__(name=f"python_object_{made_of}")


register_model(_PythonObject)(models.OpaqueModel)

_OBJECT = _PythonObject()


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


def taken_as(dtype: types.Type) -> Take[Any]:
    """take(array): the array that a Python object is, for kernels. Nobody verifies that it is plain and has items of
    this type of Numba's."""
    kind = types.Array(dtype, 1, "C")

    def take(_typing: Any, array: Any) -> Any:
        def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            taken = context.make_array(kind)(context, builder)
            first = builder.bitcast(_field(builder, arguments[0], _DATA), taken.data.type)
            length = builder.load(_field(builder, arguments[0], _SHAPE))
            size = ir.Constant(_LONG, context.get_abi_sizeof(context.get_data_type(dtype)))
            populate_array(taken, first, [length], [size], size, None)  # type: ignore[no-untyped-call]
            return taken._getvalue()

        return kind(array), generate

    return cast("Take[Any]", intrinsic(take))


def _integer_of(_typing: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return context.get_python_api(builder).long_as_longlong(arguments[0])

    return types.int64(value), generate


def _to_python(_typing: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.get_python_api(builder).from_native_value(signature.args[0], arguments[0])

    return _OBJECT(value), generate


def _give_away_lock(_typing: Any, is_wanted: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        thread = alloca_once_value(builder, ir.Constant(_POINTER, None))  # type: ignore[no-untyped-call]
        with builder.if_then(arguments[0]):
            save = ir.FunctionType(_POINTER, [])
            builder.store(builder.call(get_or_insert_function(builder.module, save, "PyEval_SaveThread"), []), thread)  # type: ignore[no-untyped-call]
        return builder.ptrtoint(builder.load(thread), _LONG)

    return types.int64(is_wanted), generate


def _take_lock_back(_typing: Any, thread: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        with builder.if_then(builder.icmp_unsigned("!=", arguments[0], ir.Constant(_LONG, 0))):
            restore = ir.FunctionType(ir.VoidType(), [_POINTER])
            function = get_or_insert_function(builder.module, restore, "PyEval_RestoreThread")  # type: ignore[no-untyped-call]
            builder.call(function, [builder.inttoptr(arguments[0], _POINTER)])
        return context.get_dummy_value()

    return types.void(thread), generate


is_plain = cast("IsPlain", intrinsic(_is_plain))
"""is_plain(array, addresses, number): whether a Python object is an array, of the very type and not a derived one, of
one dimension, contiguous, aligned, of the number-th of the data types that `addresses_of` was given, from 1 on."""

take_int64: Take[np.int64] = taken_as(types.int64)
take_uint16: Take[np.uint16] = taken_as(types.uint16)
take_uint8: Take[np.uint8] = taken_as(types.uint8)
"""take_...(array): the array that a Python object is; it must be plain, of that data type."""

integer_of = cast("Callable[[PythonObject], int]", intrinsic(_integer_of))
"""integer_of(value): a Python integer's value, which must fit 64 bits."""

to_python = cast("Callable[[object], PythonObject]", intrinsic(_to_python))
"""to_python(value): the Python object that a kernel returns; the interpreter's lock must be held."""

give_away_lock = cast("Callable[[bool], int]", intrinsic(_give_away_lock))
"""give_away_lock(is_wanted): let other threads of Python run meanwhile, if that is wanted. What comes of it is to be
given to `take_lock_back`; until then no Python object may be touched, but the arrays' items may."""

take_lock_back = cast("Callable[[int], None]", intrinsic(_take_lock_back))


class _MethodDefinition(ctypes.Structure):
    """PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("text", ctypes.c_char_p),
    )


_METH_FASTCALL = 0x80

_new_function = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)(
    ("PyCFunction_NewEx", ctypes.pythonapi)
)


class DirectKernel(Generic[Call]):
    """Has the interpreter call a kernel as a function of C.

    Attributes:
        call: calls it; the first time it is compiled before, or taken from the cache.
    """

    __slots__ = ("_compiled", "_definition", "_entry", "_known", "_made_of", "call")

    def __init__(self, entry: Entry, known: object, made_of: str = "") -> None:
        """Prepare.

        Args:
            entry: the kernel's source. It gets `known`, the arguments of the call, as many as it asks for, and their
                number, and returns `to_python` of something.
            known: what each call gets.
            made_of: changes with what the kernel is compiled of beside its own file, which alone the compiler's cache
                knows.
        """
        self._entry = entry
        self._known = known
        self._made_of = made_of
        self.call = cast("Call", self._call_first)

    def _call_first(self, *arguments: object) -> object:
        kinds = _PythonObject(self._made_of), types.CPointer(_OBJECT), types.int64  # type: ignore[no-untyped-call]
        signature = _OBJECT(*kinds)
        # Both are kept, as the interpreter goes on using them.
        self._compiled = cast("Any", cfunc)(signature, cache=True, _nrt=False)(self._entry)
        name = self._entry.__name__.encode()
        self._definition = _MethodDefinition(name, self._compiled.address, _METH_FASTCALL, None)
        self.call = _new_function(ctypes.addressof(self._definition), self._known, None)
        return self.call(*arguments)
