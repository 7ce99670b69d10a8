"""Bits of 32-bit words in kernels: processors count and find them in one instruction that Python has no name for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias, cast

import numpy as np
from numba import types
from numba.extending import intrinsic

WordFunction: TypeAlias = "Callable[[np.uint32], np.uint32]"


def _count_bits(_typing: Any, _word: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return types.uint32(types.uint32), generate


def _lowest_bit(_typing: Any, _word: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], context.get_constant(types.boolean, True))

    return types.uint32(types.uint32), generate


count_bits = cast("WordFunction", intrinsic(_count_bits))
"""Number of set bits."""

lowest_bit = cast("WordFunction", intrinsic(_lowest_bit))
"""Index of the lowest set bit of a word that is not 0."""
