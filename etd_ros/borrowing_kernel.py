"""Compiled functions that only borrow their arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

from numba import njit

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def borrowing_kernel(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Compile a function that neither makes arrays nor hands any to Python; without the interpreter's lock, cached.

    Otherwise the compiler counts the references to every array that goes from one compiled function to another, up and
    down, by locked instructions: for a dozen arrays that takes longer than to add 50 events. What Python passes lives
    as long as the call anyway. The compiler has this switch for itself; a function that makes an array does not compile
    with it.
    """
    return cast("Callable[Arguments, Result]", cast("Any", njit)(cache=True, nogil=True, _nrt=False)(function))
