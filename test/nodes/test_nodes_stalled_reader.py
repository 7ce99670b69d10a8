"""Subscribers that stop reading hold nobody up.

Fast DDS 2.14 gives up the shared-memory port of a process that stands still for a second, and both sides make it anew:
once in some hundred times they make two, and the reader stays deaf (docs/robot.md). So only a reader over UDP, as one
on another machine is, has to read on here.
"""

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
from loopback_profile import write_loopback_profile
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

    def __init__(self, bench: Bench, log: Path, **environment: str) -> None:
        self._log = log
        with log.open("wb") as output:
            self._process = subprocess.Popen(
                [sys.executable, "-c", READER],
                env={**os.environ, "ROS_DOMAIN_ID": str(bench.domain), **environment},
                stdout=output,
            )

    @property
    def has_shared_memory(self) -> bool:
        """Whether it listens at a port of shared memory."""
        return "fastrtps_port" in Path(f"/proc/{self._process.pid}/maps").read_text()

    @property
    def messages(self) -> int:
        """How many it has read."""
        return self._log.stat().st_size

    def stop(self) -> None:
        """Have it stand still, and wait until it does: it may be about to print a dot."""
        self._process.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, self._process.pid, os.WSTOPPED)

    def go_on(self) -> None:
        """Have it read on."""
        self._process.send_signal(signal.SIGCONT)

    def close(self) -> None:
        """End it, standing still or not."""
        self._process.kill()
        self._process.wait()


@pytest.fixture
def near_viewer(bench: Bench, tmp_path: Path) -> Iterator[Viewer]:
    made = Viewer(bench, tmp_path / "near.log")
    yield made
    made.close()


@pytest.fixture
def far_viewer(bench: Bench, tmp_path: Path) -> Iterator[Viewer]:
    made = Viewer(
        bench,
        tmp_path / "far.log",
        FASTRTPS_DEFAULT_PROFILES_FILE=str(write_loopback_profile(tmp_path)),
        ROS_AUTOMATIC_DISCOVERY_RANGE="SYSTEM_DEFAULT",
    )
    yield made
    made.close()


def resident_mib(process: subprocess.Popen[str]) -> float:
    (kib,) = re.findall(r"^VmRSS:\s*(\d+)", Path(f"/proc/{process.pid}/status").read_text(), re.MULTILINE)
    return int(kib) / 1024


def test_readers_that_stop_reading_cost_the_others_nothing_and_one_over_udp_reads_on_afterwards(
    bench, near_viewer, far_viewer, repository
):
    viewers = near_viewer, far_viewer
    recording = repository / "bags" / "demo"
    bench.listen("/pipeline/detections", Detection2DArray)
    boxes = bench.messages["/pipeline/detections"]
    targets = ("-r", "~/events:=/event_camera/events", "-p", f"targets_file:={recording / 'boxes.csv'}")
    pipeline = bench.start("pipeline", ros=targets)
    bench.start("replay", str(recording), "--loop", "--rate", RATE, "--wait-for", "1")
    bench.wait_until(lambda: min(len(boxes), *(viewer.messages for viewer in viewers)) > BOXES, "all read")
    assert [viewer.has_shared_memory for viewer in viewers] == [True, False]
    for viewer in viewers:
        viewer.stop()
    read, came = [viewer.messages for viewer in viewers], len(boxes)
    bench.wait_until(lambda: len(boxes) > came + BOXES, "boxes reach the other reader, and what is kept is full")
    full_mib = resident_mib(pipeline)
    bench.wait_until(lambda: len(boxes) > came + 2 * BOXES, "boxes go on reaching it")
    bench.diagnostics.clear()
    bench.wait_until(lambda: bench.figure("pipeline", "latency p50 ms") not in ("", "nan"), "the latency is known")
    assert float(bench.figure("pipeline", "latency p50 ms")) < LATENCY_MAX_MS
    assert resident_mib(pipeline) < full_mib + GROWTH_MAX_MIB
    assert [viewer.messages for viewer in viewers] == read, "they stand still"
    far_viewer.go_on()
    bench.wait_until(lambda: far_viewer.messages > read[1] + BOXES, "it reads on")
