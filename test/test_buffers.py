"""The pool of arrays: what is kept stays, what is let go of comes again, and memory is bounded."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.buffers import EXCESS_MAX, LENGTH_MIN, LENGTH_SHORT, PATIENCE, ArrayPool


def address(array):
    return array.__array_interface__["data"][0]


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10_000_000))
def test_arrays_have_the_dtypes_and_the_length_asked_for(length):
    t, p = ArrayPool(np.int64, "u1").take(length)
    assert (t.dtype, p.dtype) == (np.int64, np.uint8)
    assert len(t) == len(p) == length


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10_000_000))
def test_reserved_arrays_are_little_longer_than_asked_for(length):
    t, p = ArrayPool(np.int64, "u1").reserve(length)
    assert (t.dtype, p.dtype) == (np.int64, np.uint8)
    assert length <= len(t) == len(p) <= max(1.25 * length + 1, LENGTH_MIN)


def test_the_arrays_of_a_group_do_not_overlap():
    arrays = ArrayPool(np.int64, np.uint16, np.uint16, np.uint8).take(3000)
    for value, array in enumerate(arrays):
        array[:] = value
    assert [set(array.tolist()) for array in arrays] == [{0}, {1}, {2}, {3}]


def test_what_is_cut_from_reserved_arrays_is_kept_and_the_rest_is_given_again():
    pool = ArrayPool(np.int64, np.uint8)
    t, p = pool.reserve(100)
    kept = p[:5]
    place = address(t)
    del t, p
    assert address(pool.reserve(100)[0]) != place
    del kept
    others = pool.take(100)
    assert address(pool.reserve(100)[0]) == place != address(others[0])


def test_an_array_let_go_of_is_lent_again():
    pool = ArrayPool(np.int64)
    (first,) = pool.take(1000)
    place = address(first)
    del first
    (second,) = pool.take(900)
    assert address(second) == place


@pytest.mark.parametrize(
    "keep",
    [
        lambda arrays: arrays,
        lambda arrays: arrays[1],
        lambda arrays: arrays[0][3:5],
        lambda arrays: arrays[0][:10][2:][:3],
        lambda arrays: arrays[0].view(np.uint8),
        lambda arrays: memoryview(arrays[0]),
        lambda arrays: np.frombuffer(arrays[1]),
        lambda arrays: iter(arrays[0]),
    ],
    ids=["group", "one", "slice", "slice of slices", "other dtype", "memoryview", "buffer", "iterator"],
)
def test_an_array_is_not_lent_again_while_anything_of_it_is_kept(keep):
    pool = ArrayPool(np.int64, np.int64)
    kept = keep(pool.take(1000))
    place = pool._groups[0].arrays[0]
    lent = pool.take(1000)
    assert address(lent[0]) != address(place)
    del kept, place, lent
    pool.take(1000)
    assert len(pool._groups) == 2


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 5000), st.booleans()), max_size=60))
def test_what_is_kept_is_never_overwritten(requests):
    pool = ArrayPool(np.int64)
    kept = []
    for number, (length, is_kept) in enumerate(requests):
        array = pool.take(length)[0][:length]
        array[:] = number
        if is_kept:
            kept.append((number, array))
        del array
    assert all((array == number).all() for number, array in kept)


def test_a_stream_of_messages_of_varying_sizes_allocates_nothing_after_its_start():
    rng = np.random.default_rng(1)
    pool = ArrayPool(np.int64, np.uint16, np.uint16, np.uint8)
    sizes = rng.integers(10, 20_000, 3000).tolist()
    for size in sizes[:1000]:
        pool.take(size)
    tracemalloc.start()
    for size in sizes[1000:]:
        pool.take(size)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20_000 * np.dtype(np.uint16).itemsize, "a column was allocated"


def test_the_memory_of_one_huge_message_is_let_go_of():
    pool = ArrayPool(np.uint8)
    pool.take(50_000_000)
    for _ in range(PATIENCE):
        pool.take(1000)
    assert pool.nbytes <= LENGTH_SHORT


def test_long_arrays_are_not_lent_where_few_items_are_asked_for():
    pool = ArrayPool(np.uint8)
    pool.take(EXCESS_MAX * LENGTH_SHORT)
    kept = pool.take(1000)
    assert kept[0].base.nbytes <= LENGTH_SHORT


def test_a_consumer_that_keeps_everything_does_not_make_the_pool_grow():
    pool = ArrayPool(np.uint8)
    kept = [pool.take(1000) for _ in range(10 * PATIENCE)]
    assert pool.nbytes <= PATIENCE * LENGTH_MIN
    assert len({address(array) for (array,) in kept}) == len(kept)


def test_many_that_were_in_use_at_once_are_let_go_of_when_fewer_suffice():
    pool = ArrayPool(np.uint8)
    kept = [pool.take(1000) for _ in range(50)]
    kept.clear()
    for _ in range(PATIENCE):
        pool.take(1000)
    assert len(pool._groups) == 1
