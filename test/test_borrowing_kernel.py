"""Kernels that only borrow their arrays."""

from sys import getrefcount

import numpy as np
import pytest
from numba.core.errors import NumbaError

from etd_ros.borrowing_kernel import borrowing_kernel, kernel_part


@kernel_part
def double(values):
    for k in range(len(values)):
        values[k] *= 2
    return len(values)


@borrowing_kernel
def double_first_half(values):
    return double(values[: len(values) // 2])


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
