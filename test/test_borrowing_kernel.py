"""Kernels that only borrow their arrays."""

from sys import getrefcount

import numpy as np
import pytest
from numba.core.errors import NumbaError

from etd_ros.borrowing_kernel import borrowing_kernel, kernel_part, part_of


@kernel_part
def double(values):
    for k in range(len(values)):
        values[k] *= 2
    return len(values)


@borrowing_kernel
def double_first_half(values):
    return double(values[: len(values) // 2])


@borrowing_kernel
def sum_and_clear_part(values, first, number):
    part = part_of(values, first, number, np.uint8)
    total = 0
    for k in range(len(part)):
        total += part[k]
        part[k] = 0
    return total


@borrowing_kernel
def make_array(size):
    return len(np.empty(size))


def test_kernels_call_each_other_with_views_and_leave_the_references_as_they_were():
    values = np.arange(4.0)
    references = getrefcount(values)
    for _ in range(100):
        assert double_first_half(values[1:]) == 1
    assert values.tolist() == [0, 2.0**100, 2, 3]
    assert getrefcount(values) == references


def test_a_kernel_that_makes_an_array_does_not_compile():
    with pytest.raises(NumbaError, match="empty"):
        make_array(3)


@pytest.mark.parametrize(("first", "number"), [(0, 8), (1, 3), (2, 16), (3, 0), (0, 32)])
def test_a_part_of_an_array_is_the_same_to_kernels_as_to_python(first, number):
    values = np.arange(32, dtype=np.uint8).view(np.int64)
    part = part_of(values, first, number, np.uint8)
    assert part.tolist() == list(range(8 * first, 8 * first + number))
    assert sum_and_clear_part(values, first, number) == sum(range(8 * first, 8 * first + number))
    assert not part.any()
    assert values.view(np.uint8).sum() == sum(range(32)) - sum(range(8 * first, 8 * first + number))
