"""A node that is killed and started again finds its place among those that run on."""

import signal
from pathlib import Path

import pytest
from camera import Camera, shots_of
from conftest import Bench
from vision_msgs.msg import Detection2DArray

from etd_ros.evaluation import read_tracks
from msg_adapters import decode_detections

REMAP = ("-r", "~/events:=/event_camera/events")
S_NS = 1_000_000_000
FIRST_NS = 1_700_000_000 * S_NS
TARGETS = "targets:=ball:64.866,34.762,40,40;drum:139.382,47.099,46,36"
BEFORE, AFTER, SOON_AFTER = slice(10, 120), slice(150, 280), slice(125, 280)
"""Messages before a node is killed, and after it is back: 0.3 s of the recording are missed, or 0.05 s."""
TAKEN_BACK = 0.5
"""IoU with the truth of a target that was learnt anew where its motion should have brought it."""


@pytest.fixture
def truth(repository):
    return repository / "bags" / "demo" / "boxes.csv"


@pytest.fixture
def shots(repository):
    return shots_of(repository / "bags" / "demo")


def three_nodes(bench: Bench, memory: Path) -> None:
    for name in ("accumulator", "reconstruction"):
        bench.start(name, ros=REMAP)
    bench.start("tracker", ros=tracking(memory))
    wait_until_linked(bench)


def tracking(memory: Path) -> tuple[str, ...]:
    return ("-p", TARGETS, "-p", f"memory_file:={memory}")


def wait_until_linked(bench: Bench) -> None:
    """Until each has said that it runs; those that were killed are still counted as readers for a while."""
    bench.wait_until(
        lambda: (
            int(bench.figure("accumulator", "frame subscribers") or 0) >= 2
            and int(bench.figure("reconstruction", "image subscribers") or 0) >= 1
            and bench.figure("tracker", "life cycle") == "active"
        ),
        "the nodes are linked",
    )


def wait_until_remembered(bench: Bench, memory: Path, camera: Camera) -> None:
    """Until the memory holds both targets' boxes of the last frame."""

    def stamps() -> list[int]:
        return [rows[-1].stamp_ns for rows in read_tracks(memory).values()] if memory.is_file() else []

    bench.wait_until(lambda: stamps() == [camera.latest_ns] * 2, "both targets are remembered")


def kill_and_start(bench: Bench, name: str, *ros: str) -> None:
    assert bench.end(name, signal.SIGKILL) == -signal.SIGKILL
    bench.diagnostics.clear()
    bench.start(name, ros=ros)


def assert_right(camera: Camera, truth: Path, least: float) -> None:
    for name in ("ball", "drum"):
        assert camera.overlap(truth, name, FIRST_NS + 2 * S_NS, FIRST_NS + 27 * S_NS // 10) > least, name


@pytest.mark.parametrize("name", ["accumulator", "reconstruction", "tracker"])
def test_each_of_three_nodes_may_be_killed_and_the_targets_go_on(bench, shots, truth, tmp_path, name):
    memory = tmp_path / "memory.csv"
    three_nodes(bench, memory)
    camera = Camera(bench, "/tracker/detections")
    camera.wait_for_readers(2)
    camera.play(shots[BEFORE])
    wait_until_remembered(bench, memory, camera)
    kill_and_start(bench, name, *(tracking(memory) if name == "tracker" else REMAP))
    wait_until_linked(bench)
    camera.wait_for_readers(2)
    camera.play(shots[SOON_AFTER if name == "tracker" else AFTER])
    assert_right(camera, truth, TAKEN_BACK if name == "tracker" else 0.7)
    if name == "tracker":
        for target in ("ball", "drum"):
            assert f"{target} is taken back" in bench.log("tracker")


def test_a_pipeline_that_is_killed_takes_its_targets_back(bench, shots, truth, tmp_path):
    memory = tmp_path / "memory.csv"
    bench.start("pipeline", ros=(*REMAP, *tracking(memory)))
    camera = Camera(bench, "/pipeline/detections")
    camera.wait_for_readers()
    camera.play(shots[BEFORE])
    wait_until_remembered(bench, memory, camera)
    kill_and_start(bench, "pipeline", *REMAP, *tracking(memory))
    camera.wait_for_readers()
    camera.play(shots[SOON_AFTER])
    assert_right(camera, truth, TAKEN_BACK)
    assert bench.log("pipeline").count("is taken back after 0.") == 2


def test_a_driver_process_that_is_killed_and_started_again_begins_a_new_stream_with_the_same_targets(
    bench, repository, truth
):
    recording = repository / "bags" / "demo"
    stamps: dict[str, list[int]] = {"ball": [], "drum": []}

    def take(message: bytes) -> None:
        decoded = decode_detections(message)
        for found in decoded.detections:
            stamps.setdefault(found.id, []).append(decoded.stamp_ns)

    bench.listen("/pipeline/detections", Detection2DArray, take)
    bench.start("pipeline", ros=(*REMAP, "-p", f"targets_file:={truth}"))
    bench.start("replay", str(recording), "--wait-for", "1")
    bench.wait_until(lambda: all(len(found) > 100 for found in stamps.values()), "boxes come")
    assert bench.end("replay", signal.SIGKILL) == -signal.SIGKILL
    killed_ns = {name: stamps[name][-1] for name in ("ball", "drum")}
    bench.start("replay", str(recording), "--wait-for", "1")

    def come_again(name: str) -> bool:
        """From the recording's start on, and beyond where the first driver was killed."""
        found = stamps[name]
        steps_back = [number for number in range(1, len(found)) if found[number] < found[number - 1]]
        return bool(steps_back) and found[-1] > killed_ns[name]

    bench.wait_until(lambda: all(map(come_again, killed_ns)), "boxes come again")
    bench.wait_until(lambda: bench.figure("pipeline", "stream restarts") == "1", "a new stream is counted")
    assert bench.next_figure("pipeline", "errors") == "0"


def test_what_is_remembered_from_long_ago_is_not_taken_back(bench, shots, truth, tmp_path):
    memory = tmp_path / "memory.csv"
    memory.write_text(
        "stamp_ns,target,x,y,w,h,score,state\n"
        f"{FIRST_NS - 60 * S_NS},ball,1.0,2.0,30.0,30.0,1.0,tracking\n"
        f"{FIRST_NS},drum,1.0,2.0,30.0,30.0,0.0,lost\n"
    )
    bench.start("pipeline", ros=(*REMAP, *tracking(memory)))
    camera = Camera(bench, "/pipeline/detections")
    camera.wait_for_readers()
    camera.play(shots[10:60])
    assert camera.overlap(truth, "ball", FIRST_NS + S_NS // 4, FIRST_NS + S_NS // 2) > 0.7
    assert "drum was lost before the restart" in bench.log("pipeline")
    assert "ball is taken back" not in bench.log("pipeline")


def test_a_memory_that_cannot_be_written_is_refused_at_the_start(bench, tmp_path):
    process = bench.start("tracker", ros=tracking(tmp_path / "nowhere" / "memory.csv"))
    assert process.wait(timeout=60) == 2
    assert "nowhere/memory.csv: cannot be written" in bench.log("tracker")
