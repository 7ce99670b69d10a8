"""A reader takes all that waits at a turn, and leaves others theirs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from conftest import Bench
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import String

from etd_ros.nodes.connections import LISTENER_QOS
from etd_ros.nodes.reading import AT_A_TURN_MAX, MessageInfo, read_all

TURN_S, TURNS_MAX = 0.05, 1000


@pytest.fixture
def reader(bench: Bench):
    """A node beside the bench's, in the same context, with an executor that turns only when it is told to."""
    node = Node("reader", context=bench.node.context)
    executor = SingleThreadedExecutor(context=bench.node.context)
    executor.add_node(node)
    yield node, lambda: executor.spin_once(timeout_sec=TURN_S)
    executor.shutdown()
    node.destroy_node()


def publish(bench: Bench, count: int) -> None:
    """Messages that a reader has before this returns."""
    publisher = bench.node.create_publisher(String, "/words", LISTENER_QOS)
    bench.wait_until(lambda: publisher.get_subscription_count() == 1, "the reader is found")
    for number in range(count):
        publisher.publish(String(data=str(number)))
    assert publisher.wait_for_all_acked()


def steps_until(turn: Callable[[], None], taken: list[Any], count: int) -> list[int]:
    """How many were taken at each turn at which some were; rclpy has turns for itself, too."""
    steps: list[int] = []
    for _ in range(TURNS_MAX):
        before = len(taken)
        turn()
        steps += [len(taken) - before] if len(taken) > before else []
        if len(taken) >= count:
            return steps
    pytest.fail(f"{len(taken)} of {count} came within {TURNS_MAX} turns")


def test_what_waits_is_taken_in_order_and_with_its_numbers_many_at_a_turn(bench, reader):
    node, turn = reader
    taken: list[int] = []
    read_all(node, String, "/words", lambda _, info: taken.append(info["publication_sequence_number"]), LISTENER_QOS)
    publish(bench, 3 * AT_A_TURN_MAX + 1)
    assert steps_until(turn, taken, 3 * AT_A_TURN_MAX + 1) == [AT_A_TURN_MAX] * 3 + [1]
    assert taken == list(range(1, 3 * AT_A_TURN_MAX + 2))


def test_others_have_their_turns_in_between(bench, reader):
    node, turn = reader
    taken: list[bytes] = []
    waited: list[int] = []
    read_all(node, String, "/words", lambda message, _: taken.append(message), LISTENER_QOS)
    node.create_timer(0.0, lambda: waited.append(len(taken)))
    publish(bench, 3 * AT_A_TURN_MAX)
    steps_until(turn, taken, 3 * AT_A_TURN_MAX)
    assert {AT_A_TURN_MAX, 2 * AT_A_TURN_MAX} <= set(waited)


def test_where_there_is_no_room_one_is_taken_at_a_turn_and_the_rest_is_kept(bench, reader):
    node, turn = reader
    taken: list[bytes] = []
    read_all(
        node, String, "/words", lambda message, _: taken.append(message), LISTENER_QOS,
        has_room=lambda: len(taken) >= 3,
    )  # fmt: skip
    publish(bench, 10)
    assert steps_until(turn, taken, 10) == [1, 1, 8]


def test_a_message_that_cannot_be_taken_in_loses_none_of_those_behind_it(bench, reader):
    node, turn = reader
    taken: list[bytes] = []

    def take(message: bytes, _: MessageInfo) -> None:
        if b"3" in message:
            msg = "no word"
            raise ValueError(msg)
        taken.append(message)

    def patient_turn() -> None:
        try:
            turn()
        except ValueError as err:
            errors.append(err)

    errors: list[ValueError] = []
    read_all(node, String, "/words", take, LISTENER_QOS)
    publish(bench, 10)
    steps_until(patient_turn, taken, 9)
    assert len(errors) == 1


def test_a_message_that_ends_its_subscription_is_the_last_one(bench, reader):
    node, turn = reader
    taken: list[bytes] = []

    def take(message: bytes, _: MessageInfo) -> None:
        taken.append(message)
        node.destroy_subscription(subscription)

    subscription = read_all(node, String, "/words", take, LISTENER_QOS)
    publish(bench, 10)
    steps_until(turn, taken, 1)
    turn()
    assert len(taken) == 1
