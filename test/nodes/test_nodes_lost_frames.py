"""Frames that DDS could not keep for a node are counted."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from conftest import Bench
from rclpy.duration import Duration
from sensor_msgs.msg import Image

from etd_ros.nodes.connections import FRAME_QOS, Arrivals
from msg_adapters import encode_image

S_NS = 10**9
FRAME_INTERVAL_NS = 2_000_000
KEPT_SURELY = 50
FRAME = np.zeros((180, 240, 2), np.uint8)
TARGET = ("-p", "targets:=cup:100,80,30,30")
STANDSTILL_US = 2_000_000
TRACKER_THAT_STANDS_STILL = """
import ctypes, sys, threading
from etd_ros.nodes.programs import start

def stand_still():
    for line in sys.stdin:
        print("still", flush=True)
        ctypes.PyDLL(None).usleep(int(line))  # with Python's lock held

threading.Thread(target=stand_still, daemon=True).start()
start(sys.argv.pop(1))
"""


def test_a_publishers_first_number_and_those_that_follow_lose_nothing():
    arrivals = Arrivals()
    assert [arrivals.note_number(number, lambda: 1) for number in (7, 8, 9)] == [0, 0, 0]


def test_numbers_that_are_left_out_are_lost():
    arrivals = Arrivals()
    assert [arrivals.note_number(number, lambda: 1) for number in (7, 8, 11, 12, 14)] == [0, 0, 2, 0, 1]
    assert arrivals.lost == 3


def test_a_publisher_that_starts_anew_has_lost_nothing():
    arrivals = Arrivals()
    assert [arrivals.note_number(number, lambda: 1) for number in (700, 1, 2, 4)] == [0, 0, 0, 1]


def test_of_two_publishers_nobody_can_tell_what_is_lost():
    arrivals = Arrivals()
    assert [arrivals.note_number(number, lambda: 2) for number in (700, 1, 701, 2)] == [0, 0, 0, 0]


class Accumulator:
    """Sends frames, each with the next stamp."""

    def __init__(self, bench: Bench) -> None:
        self.sent = 0
        self.publisher = bench.node.create_publisher(Image, "/accumulator/frames", FRAME_QOS)
        bench.wait_until(lambda: self.publisher.get_subscription_count() == 1, "frames are read")

    def send(self, count: int) -> None:
        for _ in range(count):
            self.sent += 1
            stamp_ns = S_NS + self.sent * FRAME_INTERVAL_NS
            self.publisher.publish(encode_image(FRAME, stamp_ns=stamp_ns, frame_id="camera"))


def received(bench: Bench) -> int:
    return int(bench.figure("tracker", "frames received") or 0)


def lost(bench: Bench) -> int:
    return int(bench.figure("tracker", "frames lost") or 0)


@pytest.mark.parametrize("beyond", [-KEPT_SURELY, 800])
def test_a_tracker_that_was_stopped_tells_how_many_frames_it_has_lost(bench, beyond):
    tracker = bench.start("tracker", ros=TARGET)
    accumulator = Accumulator(bench)
    accumulator.send(1)
    bench.wait_until(lambda: received(bench) == 1, "the first frame has come")
    tracker.send_signal(signal.SIGSTOP)
    accumulator.send(FRAME_QOS.depth + beyond)
    tracker.send_signal(signal.SIGCONT)
    bench.wait_until(lambda: received(bench) >= FRAME_QOS.depth - KEPT_SURELY, "what was kept has come")
    accumulator.send(1)
    bench.wait_until(lambda: received(bench) + lost(bench) == accumulator.sent, "each has come or is counted")
    assert (lost(bench) > 0) == (beyond > 0)
    assert ("were lost" in bench.log("tracker")) == (beyond > 0)


def test_a_tracker_whose_python_stands_still_while_dds_receives_loses_nothing(bench):
    command = [sys.executable, "-c", TRACKER_THAT_STANDS_STILL, "tracker", "--ros-args", *TARGET]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(bench.domain)}
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, env=environment, text=True) as tracker:
        try:
            accumulator = Accumulator(bench)
            accumulator.send(1)
            bench.wait_until(lambda: received(bench) == 1, "the first frame has come")
            tracker.stdin.write(f"{STANDSTILL_US}\n")
            tracker.stdin.flush()
            assert tracker.stdout.readline() == "still\n"
            while accumulator.sent < 3 * FRAME_QOS.depth:
                accumulator.send(FRAME_QOS.depth // 2)
                assert accumulator.publisher.wait_for_all_acked(Duration(seconds=10)), "DDS receives"
            bench.wait_until(lambda: received(bench) + lost(bench) == accumulator.sent, "each has come or is counted")
            assert lost(bench) == 0
        finally:
            tracker.send_signal(signal.SIGINT)
