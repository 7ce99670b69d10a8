"""Compiled functions that only borrow their arrays.

Otherwise the compiler counts the references to every array that goes from one compiled function to another, up and
down, by locked instructions, and copies their descriptions: for a dozen arrays that takes longer than to add 50 events.
What Python passes lives as long as the call anyway.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

from numba import njit

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


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
