"""A subscriber that stops reading holds nobody up."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import Bench
from vision_msgs.msg import Detection2DArray

BOXES = 600
"""Several times as many as publishers keep for a reliable reader."""
GROWTH_MAX_MIB = 30.0
RATE = "0.2"
"""Slow enough for a busy machine to keep up, so that only a publisher that waits makes boxes late."""
LATENCY_MAX_MS = 1000.0
READER = """
import sys, rclpy
from rclpy.node import Node
from sensor_msgs.msg import Image
from vision_msgs.msg import Detection2DArray
from etd_ros.nodes.connections import FRAME_QOS
rclpy.init()
node = Node("viewer")
kept = [
    node.create_subscription(kind, f"/pipeline/{name}", lambda _: print(end=".", flush=True), FRAME_QOS, raw=True)
    for name, kind in (("frames", Image), ("overlay", Image), ("detections", Detection2DArray))
]
rclpy.spin(node)
"""


class Viewer:
    """A process that reads frames, overlay and boxes, reliably, and prints a dot for each message."""

    def __init__(self, bench: Bench, log: Path) -> None:
        self._log = log
        with log.open("wb") as output:
            self.process = subprocess.Popen(
                [sys.executable, "-c", READER],
                env={**os.environ, "ROS_DOMAIN_ID": str(bench.domain)},
                stdout=output,
            )

    @property
    def messages(self) -> int:
        """How many it has read."""
        return self._log.stat().st_size

    def close(self) -> None:
        """End it, standing still or not."""
        self.process.kill()
        self.process.wait()


@pytest.fixture
def viewer(bench: Bench, tmp_path: Path) -> Iterator[Viewer]:
    made = Viewer(bench, tmp_path / "viewer.log")
    yield made
    made.close()


def resident_mib(process: subprocess.Popen[str]) -> float:
    (kib,) = re.findall(r"^VmRSS:\s*(\d+)", Path(f"/proc/{process.pid}/status").read_text(), re.MULTILINE)
    return int(kib) / 1024


def test_a_reader_that_stops_reading_costs_the_others_nothing_and_reads_on_afterwards(bench, viewer, repository):
    recording = repository / "bags" / "demo"
    bench.listen("/pipeline/detections", Detection2DArray)
    boxes = bench.messages["/pipeline/detections"]
    targets = ("-r", "~/events:=/event_camera/events", "-p", f"targets_file:={recording / 'boxes.csv'}")
    pipeline = bench.start("pipeline", ros=targets)
    bench.start("replay", str(recording), "--loop", "--rate", RATE, "--wait-for", "1")
    bench.wait_until(lambda: viewer.messages > BOXES and len(boxes) > BOXES, "both read")
    viewer.process.send_signal(signal.SIGSTOP)
    read, came = viewer.messages, len(boxes)
    bench.wait_until(lambda: len(boxes) > came + BOXES, "boxes reach the other reader, and what is kept is full")
    full_mib = resident_mib(pipeline)
    bench.wait_until(lambda: len(boxes) > came + 2 * BOXES, "boxes go on reaching it")
    bench.diagnostics.clear()
    bench.wait_until(lambda: bench.figure("pipeline", "latency p50 ms") not in ("", "nan"), "the latency is known")
    assert float(bench.figure("pipeline", "latency p50 ms")) < LATENCY_MAX_MS
    assert resident_mib(pipeline) < full_mib + GROWTH_MAX_MIB
    assert viewer.messages == read, "it stands still"
    viewer.process.send_signal(signal.SIGCONT)
    bench.wait_until(lambda: viewer.messages > read + BOXES, "it reads on")
