"""What nodes do when something is missing, wrong, or over."""

import os
import re
import resource
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from conftest import DOMAINS, Bench
from event_camera_msgs.msg import EventPacket
from sensor_msgs.msg import Image
from vision_msgs.msg import Detection2DArray

from etd_ros.boxes import Box
from etd_ros.nodes.connections import EVENT_QOS, FRAME_QOS
from msg_adapters import Detection, decode_detections, encode_detections

EVENTS = "/event_camera/events"
DISK_BYTES, CHUNK_BYTES = 8 << 20, 1 << 20
WOKEN = 20_000
"""Executors that a signal is handed round to: so many that it takes longer than to let go of the node's own."""
REMAP = ("-r", f"~/events:={EVENTS}")
NODES = ("accumulator", "reconstruction", "tracker", "pipeline")


def shared_memory_of(process_id: int) -> set[str]:
    """Fast DDS's segments (16 hexadecimal digits) that a process has mapped; ports are shared with other processes."""
    maps = Path(f"/proc/{process_id}/maps").read_text()
    return set(re.findall(r"/dev/shm/(fastrtps_[0-9a-f]{16})", maps))


@pytest.mark.parametrize("name", NODES)
@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_a_node_leaves_quietly_when_told_to(bench, name, by):
    bench.start(name)
    bench.wait_until(lambda: name in bench.diagnostics, f"the {name} runs")
    assert bench.end(name, by) == 0
    assert "Traceback" not in bench.log(name)


@pytest.mark.parametrize("library", ["numpy", "rclpy", "torch"])
@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_a_node_leaves_quietly_while_it_loads_its_libraries(bench, library, by):
    """numpy and rclpy before there is a node, torch beside its start, in a thread."""
    process = bench.start("pipeline")
    maps = Path(f"/proc/{process.pid}/maps")
    bench.wait_until(lambda: f"/{library}/" in maps.read_text(), f"{library} is being loaded")
    assert bench.end("pipeline", by) == 0
    assert "Traceback" not in bench.log("pipeline")
    assert "exception" not in bench.log("pipeline")


@pytest.mark.parametrize("by", ["SIGINT", "SIGTERM"])
def test_a_node_that_is_told_to_leave_while_it_publishes_leaves_quietly(by):
    program = f"""
import signal, time
from etd_ros.nodes.base import EtdNode
from etd_ros.nodes.node_parameters import NodeOptions
from etd_ros.nodes.programs import run
from etd_ros.nodes.running import run_node

class Publishing(EtdNode):
    def diagnostics(self):
        signal.raise_signal(signal.{by})
        while self.context.ok():
            time.sleep(0.001)
        return {{}}

run(lambda: run_node(lambda: Publishing("publishing", (), NodeOptions)))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_node_leaves_while_ros_still_hands_the_signal_round():
    """To very many executors, so that handing it round is still going on when the node's own executor is let go."""
    program = f"""
import signal
from rclpy.signals import SignalHandlerGuardCondition
from etd_ros.nodes.base import EtdNode
from etd_ros.nodes.node_parameters import NodeOptions
from etd_ros.nodes.programs import run
from etd_ros.nodes.running import run_node

class Crowded(EtdNode):
    def __init__(self):
        super().__init__("crowded", (), NodeOptions)
        self.woken = [SignalHandlerGuardCondition() for _ in range({WOKEN})]

    def diagnostics(self):
        signal.raise_signal(signal.SIGINT)
        return {{}}

run(lambda: run_node(Crowded))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_nothing_of_a_node_stays_in_shared_memory(tmp_path, by):
    bench = Bench(tmp_path)
    process = bench.start("pipeline")
    bench.wait_until(lambda: "pipeline" in bench.diagnostics, "the pipeline runs")
    used = shared_memory_of(process.pid)
    assert used, "the node uses shared memory, so that its end can be seen there"
    bench.end("pipeline", by)
    bench.close()
    assert not [name for name in used if Path("/dev/shm", name).exists()]


def test_an_accumulator_that_waits_names_topic_type_qos_and_provider(bench):
    bench.listen("/accumulator/frames", Image)
    bench.start("accumulator", ros=REMAP)
    bench.wait_until(lambda: "waiting for" in bench.log("accumulator"), "the accumulator says what it waits for")
    for part in (EVENTS, "event_camera_msgs/msg/EventPacket", "best effort", "ros2 run etd_ros replay"):
        assert part in bench.log("accumulator")


def test_a_tracker_that_waits_names_frames_images_and_targets(bench):
    bench.start("tracker")
    bench.wait_until(lambda: "waiting for targets" in bench.log("tracker"), "the tracker says what it waits for")
    for part in (
        "/accumulator/frames",
        "/reconstruction/image_raw",
        "ros2 run etd_ros accumulator",
        "/tracker/targets",
    ):
        assert part in bench.log("tracker")


def test_a_topic_without_events_is_named(bench):
    bench.listen("/accumulator/frames", Image)
    publisher = bench.node.create_publisher(Image, EVENTS, 1)
    bench.start("accumulator", ros=REMAP)
    bench.wait_until(lambda: "not events" in bench.log("accumulator"), "the type is refused")
    assert "sensor_msgs/msg/Image" in bench.log("accumulator")
    bench.node.destroy_publisher(publisher)


@pytest.mark.parametrize(
    ("name", "arguments", "words"),
    [
        ("tracker", ("-p", "tracking.failure_iou:=7.0"), "tracking.failure_iou"),
        ("tracker", ("-p", "method:=magic"), "magic"),
        ("tracker", ("-p", "targets_file:=/nowhere/boxes.csv"), "/nowhere/boxes.csv"),
        ("accumulator", ("-p", "conversion:=magic"), "magic"),
        ("accumulator", ("-p", "atsltd.max_duration_s:=-1.0"), "max_duration_s"),
    ],
)
def test_a_wrong_parameter_is_one_line_and_exit_code_2(bench, name, arguments, words):
    process = bench.start(name, ros=arguments)
    assert process.wait(timeout=60) == 2
    lines = [line for line in bench.log(name).splitlines() if line.startswith("etd_ros:")]
    assert len(lines) == 1
    assert words in lines[0]
    assert "Traceback" not in bench.log(name)


def test_garbage_is_counted_and_the_node_goes_on(bench, repository):
    bench.listen("/accumulator/frames", Image)
    publisher = bench.node.create_publisher(EventPacket, EVENTS, EVENT_QOS)
    bench.start("accumulator", ros=REMAP)
    bench.wait_until(lambda: publisher.get_subscription_count() == 1, "the accumulator subscribes")
    garbage = EventPacket(width=64, height=48, encoding="evt9", events=bytes(16))
    zero_size = EventPacket(width=0, height=48, encoding="mono", events=bytes(16))
    cut = EventPacket(width=64, height=48, encoding="mono", events=bytes(13))
    for message in (garbage, zero_size, cut):
        publisher.publish(message)
    bench.wait_until(lambda: bench.figure("accumulator", "errors") == "3", "the errors are counted")
    replay = bench.start("replay", str(repository / "bags" / "demo"), "--rate", "4")
    bench.wait_until(lambda: replay.poll() is not None, "the replay is over")
    bench.wait_until(lambda: len(bench.messages["/accumulator/frames"]) > 10, "frames come all the same")
    assert "Traceback" not in bench.log("accumulator")


def test_a_target_can_be_started_by_a_message(bench, repository):
    bench.listen("/pipeline/detections", Detection2DArray)
    targets = bench.node.create_publisher(Detection2DArray, "/pipeline/targets", FRAME_QOS)
    bench.start("pipeline", ros=(*REMAP, "-p", "method:=etd-nr"))
    bench.wait_until(lambda: targets.get_subscription_count() == 1, "the pipeline listens")
    wanted = Detection(id="", box=Box(20.0, 20.0, 100.0, 80.0), score=1.0, class_id="")
    targets.publish(encode_detections([wanted], stamp_ns=0, frame_id=""))
    bench.start("replay", str(repository / "bags" / "demo"), "--rate", "4")
    bench.wait_until(
        lambda: any(decode_detections(message).detections for message in bench.messages["/pipeline/detections"]),
        "the target has a box",
    )
    first = next(filter(None, (decode_detections(m).detections for m in bench.messages["/pipeline/detections"])))
    assert [detection.id for detection in first] == ["target_1"]


def test_an_unreadable_recording_ends_the_replay_with_one_line(bench, tmp_path: Path):
    assert bench.start("replay", str(tmp_path / "missing.bag")).wait(timeout=60) == 2
    assert bench.log("replay").startswith("etd_ros: ")
    assert len(bench.log("replay").splitlines()) == 1


def test_a_demo_whose_disk_is_full_says_so_in_one_line_and_leaves_no_process(tmp_path, repository):
    """A limit on the size of files stands for the full disk; it would hold for shared memory too, hence UDP."""
    limited = f"import resource as r; r.setrlimit(r.RLIMIT_FSIZE, ({DISK_BYTES}, {DISK_BYTES})); " + (
        "import sys; from etd_ros.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    domain = str(next(DOMAINS))
    done = subprocess.run(
        [sys.executable, "-c", limited, "demo", "--output", str(tmp_path / "results")],
        env={
            **os.environ,
            "ROS_DOMAIN_ID": domain,
            "FASTRTPS_DEFAULT_PROFILES_FILE": str(repository / "config" / "fastdds_udp.xml"),
        },
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.strip().splitlines()
    for part in (str(tmp_path / "results" / "bag"), "File too large", "free space", "mcap recover"):
        assert part in line
    assert (tmp_path / "results" / "bag" / "bag.mcap").stat().st_size > DISK_BYTES - 2 * CHUNK_BYTES
    assert not processes_of(domain)


def test_a_memory_that_cannot_be_written_any_more_is_counted_and_the_node_goes_on(bench, tmp_path, repository):
    memory = tmp_path / "memory"
    memory.mkdir()
    bench.listen("/pipeline/detections", Detection2DArray)
    boxes = bench.messages["/pipeline/detections"]
    target = ("-p", "targets:=ball:64.866,34.762,40,40", "-p", f"memory_file:={memory / 'targets.csv'}")
    process = bench.start("pipeline", ros=(*REMAP, *target))
    bench.start("replay", str(repository / "bags" / "demo"), "--loop", "--wait-for", "1")
    bench.wait_until(lambda: (memory / "targets.csv").exists(), "targets are remembered")
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (0, 0))
    bench.wait_until(lambda: int(bench.figure("pipeline", "errors") or 0) > 0, "it is counted")
    before = len(boxes)
    bench.wait_until(lambda: len(boxes) > before + 100, "boxes come all the same")


def processes_of(domain: str) -> list[str]:
    """Command lines of the processes in a ROS domain."""
    mark = f"ROS_DOMAIN_ID={domain}".encode()
    found = []
    for folder in (folder for folder in Path("/proc").iterdir() if folder.name.isdecimal()):
        # A process may end while it is looked at, or belong to another user.
        with suppress(OSError):
            if mark in (folder / "environ").read_bytes().split(b"\0"):
                found.append((folder / "cmdline").read_text())
    return found
