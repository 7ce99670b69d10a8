"""A reader takes all that waits at a turn, and leaves others theirs."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from conftest import Bench
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import String

from etd_ros.nodes.connections import LISTENER_QOS
from etd_ros.nodes.reading import AT_A_TURN_MAX, MessageInfo, read_all

TURN_S = 0.05


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


def turns_until(turn: Callable[[], None], condition: Callable[[], bool], limit: int) -> int:
    for turns in range(limit):
        if condition():
            return turns
        turn()
    pytest.fail(f"not within {limit} turns")


def test_what_waits_is_taken_in_order_and_with_its_numbers_at_few_turns(bench, reader):
    node, turn = reader
    taken: list[int] = []
    read_all(node, String, "/words", lambda _, info: taken.append(info["publication_sequence_number"]), LISTENER_QOS)
    count = 5 * AT_A_TURN_MAX
    publish(bench, count)
    # rclpy takes some turns for itself.
    turns = turns_until(turn, lambda: len(taken) == count, count // 4)
    assert taken == list(range(1, count + 1))
    assert turns >= 5, "none may take more than its share"


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
    turns_until(patient_turn, lambda: len(taken) == 9, 100)
    assert len(errors) == 1


def test_a_message_that_ends_its_subscription_is_the_last_one(bench, reader):
    node, turn = reader
    taken: list[bytes] = []

    def take(message: bytes, _: MessageInfo) -> None:
        taken.append(message)
        node.destroy_subscription(subscription)

    subscription = read_all(node, String, "/words", take, LISTENER_QOS)
    publish(bench, 10)
    turns_until(turn, lambda: bool(taken), 100)
    turn()
    assert len(taken) == 1
