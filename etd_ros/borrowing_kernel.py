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
    down, by locked instructions, and copies their descriptions: for a dozen arrays that takes longer than to add 50
    events. What Python passes lives as long as the call anyway. The first switch the compiler has for itself: with it a
    function that makes an array does not compile, and one that returns arrays may be called by borrowing kernels alone.
    The second has the function put into the kernels that call it.
    """
    options = {"_nrt": False, "forceinline": True, "cache": True, "nogil": True}
    return cast("Callable[Arguments, Result]", cast("Any", njit)(**options)(function))
