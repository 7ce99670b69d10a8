"""What is largest in a part of a batch, against NumPy."""

import numpy as np
import pytest

from etd_ros.borrowing_kernel import borrowing_kernel
from etd_ros.conversion.extremes import EVENTS_MIN, are_readable, extremes

COUNTS = (EVENTS_MIN, 34, 63, 64, 65, 97, 130)


@borrowing_kernel
def of_kernel(t, x, y, p, first, stop):
    return extremes(t, x, y, p, first, stop)


@borrowing_kernel
def readable(t, x, y, p):
    return are_readable(t, x, y, p)


def of_numpy(t, x, y, p):
    return int(x.max()), int(y.max()), int(p.max()), bool((t[1:] < t[:-1]).any())


def batch(count, seed=0):
    """Arrays that begin in the middle of others, whose items round them are extreme."""
    rng = np.random.default_rng(seed)
    whole = [np.full(count + 2, np.iinfo(dtype).max, dtype) for dtype in (np.int64, np.uint16, np.uint16, np.uint8)]
    whole[0][:1] = np.iinfo(np.int64).min
    t, x, y, p = (array[1:-1] for array in whole)
    t[:] = np.sort(rng.integers(-(2**62), 2**62, count))
    x[:], y[:], p[:] = rng.integers(0, 60000, count), rng.integers(0, 200, count), rng.integers(0, 2, count)
    return t, x, y, p


@pytest.mark.parametrize("count", COUNTS)
def test_it_finds_what_numpy_finds(count):
    for seed in range(20):
        arrays = batch(count, seed)
        assert of_kernel(*arrays, 0, count) == of_numpy(*arrays)


@pytest.mark.parametrize("count", COUNTS)
def test_no_event_is_left_out(count):
    for k in range(count):
        t, x, y, p = batch(count)
        x[k], y[k], p[k] = 65535, 65534, 255
        assert of_kernel(t, x, y, p, 0, count) == (65535, 65534, 255, False)


@pytest.mark.parametrize("count", COUNTS)
def test_no_step_back_is_left_out_and_events_of_one_time_are_none(count):
    _, x, y, p = batch(count)
    for k in range(1, count):
        t = np.full(count, 5, np.int64)
        assert not of_kernel(t, x, y, p, 0, count)[3]
        t[k:] = 4
        assert of_kernel(t, x, y, p, 0, count)[3]


@pytest.mark.parametrize("count", COUNTS)
def test_what_is_not_of_the_part_is_not_looked_at(count):
    for first in (1, 5, 40):
        t, x, y, p = (np.repeat(array, 3) for array in batch(count, first))
        stop = first + count
        t[first - 1], x[first - 1], y[stop], p[stop], t[stop] = 2**62, 65535, 65535, 255, -(2**62)
        assert of_kernel(t, x, y, p, first, stop) == of_numpy(*(array[first:stop] for array in (t, x, y, p)))


@pytest.mark.parametrize(
    ("number", "array", "expected"),
    [
        (0, np.zeros(40, np.int64), True),
        (0, np.zeros(40, np.uint64), False),
        (1, np.zeros(40, np.int16), False),
        (2, np.zeros(80, np.uint16)[::2], False),
        (3, np.zeros(40, np.bool_), False),
    ],
)
def test_other_types_are_for_others(number, array, expected):
    arrays = list(batch(40))
    arrays[number] = array
    assert readable(*arrays) is expected
