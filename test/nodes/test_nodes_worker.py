"""The threads of a node."""

import threading

import pytest

from etd_ros.nodes.worker import Relay, Worker


@pytest.fixture
def errors():
    return []


@pytest.fixture
def worker(errors):
    made = Worker("test", 100, 3600.0, errors.append)
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
    worker.submit_request(lambda _: done.set())
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


@pytest.mark.parametrize(("max_age_s", "keeps_up"), [(3600.0, True), (0.0, False)])
def test_work_keeps_up_until_data_has_waited_for_a_part_of_what_is_allowed(errors, max_age_s, keeps_up):
    worker = Worker("test", 1000, max_age_s, errors.append)
    go_on = hold(worker)
    worker.submit_request(lambda _: None)
    assert worker.keeps_up, "a request is not dropped as too old"
    worker.submit(lambda _: None, b"data")
    assert worker.keeps_up == keeps_up
    go_on.set()
    run_all(worker)
    assert worker.keeps_up
    worker.stop()


def test_data_that_has_waited_too_long_is_dropped_but_for_the_newest_and_requests_are_not(errors):
    worker = Worker("test", 1000, 0.0, errors.append)
    seen = []
    go_on = hold(worker)
    for number in range(3):
        worker.submit(seen.append, bytes([number]))
    worker.submit_request(seen.append, b"request")
    worker.submit(seen.append, b"newest")
    go_on.set()
    run_all(worker)
    worker.stop()
    assert seen == [b"request", b"newest"]
    assert worker.counters.dropped_messages == 3


def test_data_that_has_waited_for_less_than_half_of_what_is_allowed_is_kept(errors, monkeypatch):
    now_s = [0.0]
    monkeypatch.setattr("etd_ros.nodes.worker.time.monotonic", lambda: now_s[0])
    worker = Worker("test", 1000, 10.0, errors.append)
    seen = []
    go_on = hold(worker)
    for number in range(10):
        now_s[0] = float(number)
        worker.submit(seen.append, bytes([number]))
    now_s[0] = 11.0
    go_on.set()
    run_all(worker)
    worker.stop()
    assert [message[0] for message in seen] == [6, 7, 8, 9]
    assert worker.counters.dropped_messages == 6


def test_what_keeps_dropping_is_allowed_less_until_it_keeps_up_again(errors, monkeypatch):
    now_s = [100.0]
    monkeypatch.setattr("etd_ros.nodes.worker.time.monotonic", lambda: now_s[0])
    worker = Worker("test", 1000, 10.0, errors.append)

    def dropped_after(age_s: float) -> int:
        """How many of two messages are dropped, the first of which has waited for so long."""
        before = worker.counters.dropped_messages
        go_on = hold(worker)
        worker.submit(lambda _: None, b"old")
        now_s[0] += age_s
        worker.submit(lambda _: None, b"new")
        go_on.set()
        run_all(worker)
        return worker.counters.dropped_messages - before

    assert dropped_after(9.0) == 0
    assert dropped_after(11.0) == 1
    now_s[0] -= 8.5
    assert dropped_after(9.0) == 1
    now_s[0] += 2.0
    assert dropped_after(9.0) == 0
    worker.stop()


def test_data_is_dropped_before_requests(worker):
    seen = []
    go_on = hold(worker)
    worker.submit_request(seen.append, bytes(60))
    for number in range(3):
        worker.submit(seen.append, bytes([number]) * 40)
    go_on.set()
    run_all(worker)
    assert [len(message) for message in seen] == [60, 40]


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


@pytest.fixture
def relay(errors):
    made = Relay("test", 2, errors.append)
    yield made
    made.stop()


def test_a_relay_runs_tasks_in_order_and_drops_none(relay):
    seen = []
    for number in range(50):
        relay.submit(lambda number=number: seen.append(number))
    done = threading.Event()
    relay.submit(done.set)
    assert done.wait(60)
    assert seen == list(range(50))


def test_a_stage_that_is_too_fast_waits_for_the_next_one(relay):
    go_on, third_is_in = threading.Event(), threading.Event()
    begun = threading.Event()
    relay.submit(lambda: begun.set() or go_on.wait())
    begun.wait()
    seen = []

    def submit_all():
        for number in range(3):
            relay.submit(lambda number=number: seen.append(number))
        third_is_in.set()

    thread = threading.Thread(target=submit_all)
    thread.start()
    assert not third_is_in.is_set()
    go_on.set()
    assert third_is_in.wait(60)
    thread.join()
    done = threading.Event()
    relay.submit(done.set)
    assert done.wait(60)
    assert seen == [0, 1, 2]


def test_an_error_in_a_relay_is_reported_and_the_next_task_run(relay, errors):
    def fail():
        msg = "bad frame"
        raise ValueError(msg)

    done = threading.Event()
    relay.submit(fail)
    relay.submit(done.set)
    assert done.wait(60)
    assert [str(error) for error in errors] == ["bad frame"]


def test_stopping_a_relay_frees_the_stage_that_waits_for_it():
    relay = Relay("stopped", 1, list)
    go_on, begun = threading.Event(), threading.Event()
    relay.submit(lambda: begun.set() or go_on.wait())
    begun.wait()
    relay.submit(int)
    waiting = threading.Thread(target=relay.submit, args=(int,))
    waiting.start()
    stopping = threading.Thread(target=relay.stop)
    stopping.start()
    waiting.join(60)
    assert not waiting.is_alive()
    go_on.set()
    stopping.join(60)
    assert not stopping.is_alive()
