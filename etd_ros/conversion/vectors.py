"""What kernels' vector instructions are written with: those that the compiler does not make of a loop.

They are LLVM's own vector operations, which it has for every processor.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core.cgutils import get_item_pointer, get_or_insert_function

BIT, BYTE, HALF, WORD, LONG = (ir.IntType(bits) for bits in (1, 8, 16, 32, 64))
FLOAT, DOUBLE = ir.FloatType(), ir.DoubleType()


def all_lanes(kind: ir.VectorType, value: int) -> ir.Constant:
    """A number in each lane of a vector."""
    return ir.Constant(kind, [value] * kind.count)


def items(context: Any, builder: Any, kind: Any, array: Any) -> Any:
    """Pointer to the first item of an array of Numba's type `kind`."""
    return context.make_array(kind)(context, builder, array).data


def item_at(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """Pointer to an item of an array of Numba's type `kind`, which need not be contiguous; the index is checked where
    the compiler is told to check indices."""
    struct = context.make_array(kind)(context, builder, array)
    checks = context.enable_boundscheck
    return get_item_pointer(context, builder, kind, struct, [index], wraparound=False, boundscheck=checks)  # type: ignore[no-untyped-call]


def vector_at(builder: Any, first: Any, index: Any, kind: ir.Type) -> Any:
    """Pointer to the vector that begins at an item's index."""
    return builder.bitcast(builder.gep(first, [index]), kind.as_pointer())


def as_it_is(context: Any, builder: Any, vector: Any) -> Any:
    """The vector, of which the compiler does not know how it was made, on AVX-512 with VBMI, where that pays: else it
    puts several of what a processor does on any of its units into one that only one unit does, which waits for it."""
    if not has_features(context, "avx512vbmi"):
        return vector
    kind = ir.FunctionType(vector.type, [vector.type])
    return builder.call(ir.InlineAsm(kind, "", "=v,0"), [vector])


def has_features(context: Any, *features: str) -> bool:
    """Whether the processor that is compiled for has these."""
    _, _, found = context.codegen().magic_tuple()
    return {f"+{feature}" for feature in features} <= set(found.split(","))


def spread_bits(builder: Any, word: Any, places: int) -> Any:
    """The lowest bits of a word at the places of a number's set bits, on processors with BMI2."""
    kind = ir.FunctionType(WORD, [WORD, WORD])
    function = get_or_insert_function(builder.module, kind, "llvm.x86.bmi.pdep.32")  # type: ignore[no-untyped-call]
    return builder.call(function, [word, ir.Constant(WORD, places)])


def count_bits_of_lanes(builder: Any, words: Any) -> Any:
    """Number of set bits of each lane."""
    return _call(builder, "ctpop", words, words.type)


def sum_of_lanes(builder: Any, words: Any) -> Any:
    """Sum over the lanes."""
    return _call(builder, "vector.reduce.add", words, words.type.element)


def largest_lane(builder: Any, numbers: Any) -> Any:
    """Largest of the lanes, which are not negative."""
    return _call(builder, "vector.reduce.umax", numbers, numbers.type.element)


def fetch(builder: Any, item: Any, *, to_write: bool) -> None:
    """Have the memory round an item brought near, as it will be read or written soon."""
    pointer = BYTE.as_pointer()
    kind = ir.FunctionType(ir.VoidType(), [pointer, WORD, WORD, WORD])
    function = get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")  # type: ignore[no-untyped-call]
    nearest, data = 3, 1
    flags = (ir.Constant(WORD, number) for number in (int(to_write), nearest, data))
    builder.call(function, [builder.bitcast(item, pointer), *flags])


def _call(builder: Any, operation: str, words: Any, result: ir.Type) -> Any:
    """The builder's own methods take single words alone."""
    name = f"llvm.{operation}.v{words.type.count}i{words.type.element.width}"
    kind = ir.FunctionType(result, [words.type])
    function = get_or_insert_function(builder.module, kind, name)  # type: ignore[no-untyped-call]
    return builder.call(function, [words])
