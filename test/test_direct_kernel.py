import copy
from sys import getrefcount
from threading import Thread

import numpy as np
import pytest

from etd_ros.direct_kernel import (
    DirectKernel,
    addresses_of,
    give_away_lock,
    integer_of,
    is_plain,
    take_int64,
    take_lock_back,
    take_uint8,
    take_uint16,
    to_python,
)

ADDRESSES = addresses_of(np.int64, np.uint16, np.uint8)
TURNS_MAX = 2**32


class Derived(np.ndarray):
    pass


def _plainness(known, arguments, _number):
    return to_python(is_plain(arguments[0], take_int64(known), integer_of(arguments[1])))


def _sums(_known, arguments, _number):
    wide, middle, narrow = take_int64(arguments[0]), take_uint16(arguments[1]), take_uint8(arguments[2])
    total = take_int64(arguments[3])
    for k in range(len(total)):
        total[k] = wide[k] + middle[k] + narrow[k]
    return to_python((len(wide), len(middle), len(narrow)))


def _half(_known, arguments, _number):
    whole = integer_of(arguments[0])
    return to_python(None) if whole % 2 else to_python((whole // 2, 0.5 * whole))


def _how_many(_known, _arguments, number):
    return to_python(number)


def _turns_until_told(_known, arguments, _number):
    told, turns = take_int64(arguments[0]), take_int64(arguments[1])
    thread = give_away_lock(True)
    while told[0] == 0 and turns[0] < TURNS_MAX:
        turns[0] += 1
    take_lock_back(thread)
    return to_python(turns[0])


plainness = DirectKernel(_plainness, ADDRESSES)
sums = DirectKernel(_sums, ADDRESSES)
half = DirectKernel(_half, None)
how_many = DirectKernel(_how_many, None)
turns_until_told = DirectKernel(_turns_until_told, None)


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
    assert plainness.call(value, 2) is expected


def test_each_data_type_is_told_from_the_others():
    arrays = [np.zeros(3, dtype) for dtype in (np.int64, np.uint16, np.uint8)]
    found = [[plainness.call(array, number) for number in (1, 2, 3)] for array in arrays]
    np.testing.assert_array_equal(found, np.eye(3, dtype=bool))


def test_arrays_are_read_as_they_lie():
    wide, middle, narrow = np.arange(-2, 3), np.arange(100, 106, dtype=np.uint16)[1:], np.arange(9, dtype=np.uint8)
    total = np.zeros(5, np.int64)
    for _ in range(2):
        assert sums.call(wide, middle, narrow, total) == (5, 5, 9)
        np.testing.assert_array_equal(total, wide + middle + narrow[:5])


def test_whole_numbers_go_in_and_objects_come_out():
    assert half.call(-(2**62)) == (-(2**61), -(2.0**61))
    assert half.call(7) is None
    assert half.call(np.int64(6)) == (3, 3.0)


def test_what_does_not_fit_is_an_error():
    with pytest.raises(SystemError) as raised:
        half.call(2**64)
    assert isinstance(raised.value.__cause__, OverflowError)


def test_it_is_told_how_many_arguments_it_has():
    assert [how_many.call(*range(number)) for number in (0, 1, 9)] == [0, 1, 9]


def test_references_are_left_as_they_were():
    array, number = np.arange(3), 10**15
    before = getrefcount(array), getrefcount(number), getrefcount(None)
    for _ in range(100):
        plainness.call(array, 1)
        half.call(number)
        half.call(7)
    after = getrefcount(array), getrefcount(number), getrefcount(None)
    assert after[:2] == before[:2]
    # Others use it, too.
    assert abs(after[2] - before[2]) < 50


def test_other_threads_run_while_the_lock_is_given_away():
    told, turns = np.zeros(1, np.int64), np.zeros(1, np.int64)

    def tell():
        while turns[0] == 0:
            pass
        told[0] = 1

    teller = Thread(target=tell)
    teller.start()
    assert 0 < turns_until_told.call(told, turns) < TURNS_MAX
    teller.join()
