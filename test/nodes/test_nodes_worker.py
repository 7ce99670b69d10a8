"""The worker thread of a node."""

import threading

import pytest

from etd_ros.nodes.worker import Worker


@pytest.fixture
def errors():
    return []


@pytest.fixture
def worker(errors):
    made = Worker("test", 100, errors.append)
    yield made
    made.stop()


def hold(worker):
    """Keep the worker busy until the returned event is set."""
    begun, go_on = threading.Event(), threading.Event()

    def wait(_):
        begun.set()
        go_on.wait()

    worker.submit(wait, b"")
    begun.wait()
    return go_on


def run_all(worker):
    done = threading.Event()
    worker.submit(lambda _: done.set(), b"")
    done.wait()


def test_messages_are_handled_in_order(worker):
    seen = []
    for number in range(50):
        worker.submit(seen.append, bytes([number]))
        run_all(worker)
    assert seen == [bytes([number]) for number in range(50)]


def test_beyond_its_bound_the_oldest_messages_are_dropped_and_counted(worker):
    seen = []
    go_on = hold(worker)
    for number in range(5):
        worker.submit(seen.append, bytes([number]) * 40)
    assert worker.queued_bytes == 80
    go_on.set()
    run_all(worker)
    assert [message[0] for message in seen] == [3, 4]
    assert (worker.counters.dropped_messages, worker.counters.dropped_bytes) == (3, 120)


def test_one_message_above_the_bound_is_still_handled(worker):
    done = threading.Event()
    go_on = hold(worker)
    worker.submit(lambda _: done.set(), bytes(1000))
    go_on.set()
    assert done.wait(60)


def test_an_error_is_reported_and_the_next_message_handled(worker, errors):
    seen = []

    def fail(_):
        msg = "bad message"
        raise ValueError(msg)

    worker.submit(fail, b"")
    worker.submit(seen.append, b"good")
    run_all(worker)
    assert seen == [b"good"]
    assert [str(error) for error in errors] == ["bad message"]
