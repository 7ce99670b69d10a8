"""The demo as its user runs it: what it leaves when it ends, and that nothing stays when it is interrupted."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import cv2
import pytest
from conftest import DOMAINS, TIMEOUT_S
from ros_domains import SHARED_MEMORY, clear, domain_of
from rosbags.rosbag2 import Reader

from etd_ros.cadence import Cadence
from etd_ros.cli import main
from etd_ros.evaluation import read_boxes, read_tracks, score
from etd_ros.tracking import DEFAULT_METHOD, METHODS

RATE = "0.5"
"""Slow enough for a busy machine of two cores to drop nothing, so that the boxes are those of `track`."""
TOPICS = {
    "/accumulator/frames",
    "/clock",
    "/diagnostics",
    "/event_camera/events",
    "/reconstruction/image_raw",
    "/tracker/detections",
    "/tracker/status",
}


class Demo:
    """`python -m etd_ros demo` in a session and a ROS domain of its own."""

    def __init__(self, output: Path, repository: Path, *arguments: str) -> None:
        self.output = output
        self.domain = next(DOMAINS)
        self.memory: set[str] = set()
        self._log = output.with_name("demo.log")
        environment = {**os.environ, "ROS_DOMAIN_ID": str(self.domain), "PYTHONPATH": str(repository)}
        with self._log.open("w") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "etd_ros", "demo", "--output", str(output), *arguments],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,
            )

    @property
    def text(self) -> str:
        """What it has printed."""
        return self._log.read_text()

    def wait_until(self, condition: Callable[[], bool], what: str) -> None:
        deadline_s = time.monotonic() + TIMEOUT_S
        while not condition():
            assert self.process.poll() is None, f"it ended before {what}:\n{self.text}"
            assert time.monotonic() < deadline_s, f"waited in vain until {what}:\n{self.text}"
            time.sleep(0.05)
        self.watch()

    def watch(self) -> None:
        """Note the shared memory that its processes use now."""
        for folder in self._processes():
            with suppress(OSError):
                self.memory |= {name for name in shared_memory_of(folder) if self._is_own(name)}

    def leftovers(self) -> list[str]:
        """Its processes that still run, and files in shared memory that it has used and nobody uses now."""
        commands = [(folder / "cmdline").read_bytes().replace(b"\0", b" ").decode() for folder in self._processes()]
        return commands + sorted(name for name in self.memory if (SHARED_MEMORY / name).exists())

    def _processes(self) -> list[Path]:
        mark = f"ROS_DOMAIN_ID={self.domain}".encode()
        found = []
        for folder in (folder for folder in Path("/proc").iterdir() if folder.name.isdecimal()):
            # A process may end while it is looked at, or belong to another user.
            with suppress(OSError):
                is_etd_ros = b"etd_ros" in (folder / "cmdline").read_bytes()
                if is_etd_ros and mark in (folder / "environ").read_bytes().split(b"\0"):
                    found.append(folder)
        return found

    def _is_own(self, name: str) -> bool:
        """A few ports are shared by all domains, and whoever else uses them now may leave them."""
        return "fastrtps" in name and domain_of(name) in (None, self.domain)

    def close(self) -> None:
        """End the demo and its nodes, whatever it has done."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        for folder in self._processes():
            with suppress(OSError):
                os.kill(int(folder.name), signal.SIGKILL)
        clear(self.domain)


def shared_memory_of(process: Path) -> set[str]:
    """Names of the files in shared memory that a process has mapped."""
    return set(re.findall(rf"{SHARED_MEMORY}/(\S+)", (process / "maps").read_text(errors="replace")))


@pytest.fixture(scope="module")
def finished(repository, tmp_path_factory) -> Iterator[Demo]:
    """A demo that has run to its end."""
    demo = Demo(tmp_path_factory.mktemp("demo") / "results", repository, "--rate", RATE)
    try:
        demo.wait_until(lambda: has_frames(demo.output), "it is under way")
        demo.process.wait(timeout=2 * TIMEOUT_S)
        yield demo
    finally:
        demo.close()


@pytest.fixture(scope="module")
def offline_tracks(repository, tmp_path_factory) -> Path:
    output = tmp_path_factory.mktemp("offline") / "tracks.csv"
    bundled = repository / "bags" / "demo"
    assert main(["track", str(bundled), "--targets", str(bundled / "boxes.csv"), "--output", str(output)]) == 0
    return output


def test_the_demo_ends_well_and_leaves_its_results_but_no_process_and_no_shared_memory(finished):
    assert finished.process.returncode == 0, finished.text
    assert sorted(path.name for path in finished.output.iterdir()) == ["bag", "logs", "overlay.mp4", "tracks.csv"]
    assert finished.memory, "it has used shared memory"
    assert finished.leftovers() == []


def test_its_boxes_are_those_of_track(finished, offline_tracks):
    live, offline = read_tracks(finished.output / "tracks.csv"), read_tracks(offline_tracks)
    assert live.keys() == offline.keys()
    for name, rows in offline.items():
        for row, other in zip(live[name], rows, strict=True):
            assert (row.stamp_ns, row.state, row.score) == (other.stamp_ns, other.state, other.score)
            assert (row.box is None) == (other.box is None)
            # Messages hold a box's middle instead of its corner.
            assert row.box is None or row.box == pytest.approx(other.box, abs=1e-9)


def test_it_prints_the_scores_and_the_last_states(finished, repository):
    scores = score(read_tracks(finished.output / "tracks.csv"), read_boxes(repository / "bags" / "demo" / "boxes.csv"))
    for name, value in scores.items():
        assert re.search(rf"{name}\W+{value.ap:.3f}\W+{value.ar:.3f}\W+{value.n}\b", finished.text), finished.text
        assert re.search(rf"target {name}\W+(tracking|recovering|lost)", finished.text), finished.text


def test_its_video_lasts_as_long_as_the_recording(finished):
    capture = cv2.VideoCapture(str(finished.output / "overlay.mp4"))
    pictures = 0
    while capture.read()[0]:
        pictures += 1
    frames = sorted({row.stamp_ns for rows in read_tracks(finished.output / "tracks.csv").values() for row in rows})
    assert pictures / capture.get(cv2.CAP_PROP_FPS) == pytest.approx((frames[-1] - frames[0]) * 1e-9, abs=0.1)
    assert pictures > 100


def test_its_bag_holds_everything_published_and_the_events_as_recorded(finished, repository):
    with Reader(finished.output / "bag") as reader, Reader(repository / "bags" / "demo") as bundled:
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
        events = [connection for connection in reader.connections if connection.topic == "/event_camera/events"]
        recorded = [bytes(data) for _, _, data in reader.messages(events)]
        assert recorded == [bytes(data) for _, _, data in bundled.messages()]
    assert counts.keys() == TOPICS
    assert all(counts.values())
    frames = {row.stamp_ns for rows in read_tracks(finished.output / "tracks.csv").values() for row in rows}
    for topic in ("/accumulator/frames", "/tracker/detections", "/tracker/status"):
        assert counts[topic] == len(frames), topic
    cadence = Cadence(METHODS[DEFAULT_METHOD].image_interval_s)
    assert counts["/reconstruction/image_raw"] == sum(map(cadence.is_due, sorted(frames)))


def has_frames(output: Path) -> bool:
    return any(file.stat().st_size > 1_000_000 for file in output.glob("bag/*.mcap"))


def has_nodes(output: Path) -> bool:
    return (output / "logs" / "tracker.log").exists()


@pytest.mark.parametrize(
    ("number", "to_group", "moment"),
    [
        (signal.SIGINT, True, has_frames),
        (signal.SIGINT, False, has_frames),
        (signal.SIGTERM, False, has_frames),
        (signal.SIGINT, True, has_nodes),
    ],
    ids=["ctrl-c", "interrupt of the demo alone", "termination", "ctrl-c while the nodes start"],
)
def test_an_interrupted_demo_leaves_no_process_no_shared_memory_and_no_half_results(
    tmp_path, repository, number, to_group, moment
):
    demo = Demo(tmp_path / "results", repository)
    try:
        demo.wait_until(lambda: moment(demo.output), "it is under way")
        (os.killpg if to_group else os.kill)(demo.process.pid, number)
        assert demo.process.wait(timeout=TIMEOUT_S) == 130, demo.text
        assert "Traceback" not in demo.text
        assert demo.leftovers() == []
        assert sorted(path.name for path in demo.output.iterdir()) == ["bag", "logs"]
        with Reader(demo.output / "bag") as reader:
            assert {connection.topic for connection in reader.connections} <= TOPICS
    finally:
        demo.close()


def test_a_folder_that_holds_more_than_a_demos_results_is_refused_and_left_alone(tmp_path, capsys):
    (tmp_path / "bag").mkdir()
    (tmp_path / "thesis.tex").write_text("mine")
    assert main(["demo", "--output", str(tmp_path)]) == 2
    assert "thesis.tex" in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bag", "thesis.tex"]


def test_a_file_in_the_place_of_the_output_folder_is_refused_and_left_alone(tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("mine")
    assert main(["demo", "--output", str(tmp_path / "notes.txt")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "notes.txt is no folder" in line
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_the_bag_of_a_demo_is_not_replaced_by_its_own_replay(finished, capsys):
    bag = finished.output / "bag"
    before = sorted(bag.iterdir())
    assert main(["demo", "--recording", str(bag), "--output", str(finished.output)]) == 2
    assert "choose another --output" in capsys.readouterr().err
    assert sorted(bag.iterdir()) == before
