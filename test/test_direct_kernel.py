import copy

import numpy as np
import pytest
from numba import types

from etd_ros.borrowing_kernel import borrowing_kernel
from etd_ros.direct_kernel import (
    DirectKernel,
    addresses_of,
    is_plain,
    python_object,
    take_int64,
    take_uint8,
    take_uint16,
)

ADDRESSES = addresses_of(np.int64, np.uint16, np.uint8)
NUMBERS = types.Array(types.int64, 1, "C")


class Derived(np.ndarray):
    pass


@borrowing_kernel
def _plainness(array, addresses, number):
    return is_plain(array, addresses, number)


@borrowing_kernel
def _sums(wide, middle, narrow, total):
    wide_, middle_, narrow_ = take_int64(wide), take_uint16(middle), take_uint8(narrow)
    for k in range(len(total)):
        total[k] = wide_[k] + middle_[k] + narrow_[k]
    return len(wide_), len(middle_), len(narrow_)


plainness = DirectKernel(_plainness, (python_object, NUMBERS, types.int64))
sums = DirectKernel(_sums, (python_object, python_object, python_object, NUMBERS))


def read_only(array):
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.zeros(3, np.uint16), True),
        (np.zeros(0, np.uint16), True),
        (np.zeros(7, np.uint16)[2:5], True),
        (read_only(np.zeros(3, np.uint16)), True),
        (copy.deepcopy(np.zeros(3, np.uint16)), True),
        (np.zeros(6, np.uint16)[::2], False),
        (np.zeros(7, np.uint8)[1:].view(np.uint16), False),
        (np.zeros((1, 3), np.uint16), False),
        (np.zeros((), np.uint16), False),
        (np.zeros(3, np.int16), False),
        (np.zeros(3, ">u2"), False),
        (np.zeros(3, np.uint8), False),
        (np.zeros(3, np.uint16).view(Derived), False),
        (np.uint16(3), False),
        ([1, 2, 3], False),
        (None, False),
    ],
)
def test_plain_is_what_a_kernel_may_read_as_it_lies(value, expected):
    assert plainness.call(value, ADDRESSES, 2) is expected


def test_each_data_type_is_told_from_the_others():
    arrays = [np.zeros(3, dtype) for dtype in (np.int64, np.uint16, np.uint8)]
    found = [[plainness.call(array, ADDRESSES, number) for number in (1, 2, 3)] for array in arrays]
    np.testing.assert_array_equal(found, np.eye(3, dtype=bool))


def test_arrays_are_read_as_they_lie():
    wide, middle, narrow = np.arange(-2, 3), np.arange(100, 106, dtype=np.uint16)[1:], np.arange(9, dtype=np.uint8)
    total = np.zeros(5, np.int64)
    for _ in range(2):
        assert sums.call(wide, middle, narrow, total) == (5, 5, 9)
        np.testing.assert_array_equal(total, wide + middle + narrow[:5])
