"""Bits of words in kernels: processors count and find them in one instruction that Python has no name for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias, TypeVar, cast

import numpy as np
from numba import types
from numba.extending import intrinsic

Word = TypeVar("Word", np.uint32, np.uint64)

CountBits: TypeAlias = "Callable[[np.uint32], np.uint32]"
LowestBit: TypeAlias = "Callable[[Word], Word]"


def _count_bits(_typing: Any, _word: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return types.uint32(types.uint32), generate


def _lowest_bit(_typing: Any, word: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], context.get_constant(types.boolean, True))

    return word(word), generate


count_bits = cast("CountBits", intrinsic(_count_bits))
"""Number of set bits of 32."""

lowest_bit = cast("LowestBit[Any]", intrinsic(_lowest_bit))
"""Index of the lowest set bit of an unsigned word that is not 0."""
