"""An iterator that runs ahead in a thread: same items, same errors, and no thread left behind."""

from __future__ import annotations

import itertools
import threading

import pytest

from etd_ros.read_ahead import read_ahead


def threads() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == "read_ahead"]


@pytest.mark.parametrize("depth", [1, 3, 1000])
def test_the_items_come_in_order_and_the_thread_ends_with_them(depth):
    assert list(read_ahead(iter(range(500)), depth)) == list(range(500))
    assert not threads()


def test_no_items_are_no_items():
    assert list(read_ahead([])) == []


def test_items_are_made_in_another_thread_and_only_when_asked_for():
    made_in = []

    def items():
        made_in.append(threading.current_thread())
        yield 1

    ahead = read_ahead(items())
    assert not made_in
    assert list(ahead) == [1]
    assert made_in != [threading.current_thread()]


def test_no_more_than_the_depth_waits_for_the_caller():
    made = []

    def items():
        for number in range(2000):
            made.append(number)
            yield number

    # Those taken, three that wait, and the next in the thread's hand.
    assert all(len(made) <= taken + 3 + 1 for taken, _ in enumerate(read_ahead(items(), 3), start=1))


def test_an_error_comes_after_the_items_before_it():
    def items():
        yield 1
        msg = "broken"
        raise ValueError(msg)

    ahead = read_ahead(items())
    assert next(ahead) == 1
    with pytest.raises(ValueError, match="broken"):
        next(ahead)
    assert not threads()


def test_a_caller_that_stops_early_closes_the_source_in_its_thread():
    closed_in = []

    def items():
        try:
            yield from itertools.count()
        finally:
            closed_in.append(threading.current_thread().name)

    ahead = read_ahead(items())
    assert next(ahead) == 0
    ahead.close()
    assert closed_in == ["read_ahead"]
    assert not threads()


def test_letting_go_of_a_chain_ends_all_its_threads():
    def doubled(numbers):
        for number in numbers:
            yield 2 * number

    chain = read_ahead(doubled(read_ahead(itertools.count())))
    assert [next(chain) for _ in range(3)] == [0, 2, 4]
    assert len(threads()) == 2
    del chain
    assert not threads()
