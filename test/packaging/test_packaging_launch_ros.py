"""The launch files under the real `ros2 launch`, on machines that have it; test_packaging_launch.py is for all."""

import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from vision_msgs.msg import Detection2DArray

TIMEOUT_S = 300
"""The nodes compile their kernels at once, in a place without a cache."""
DOMAIN = 96
GENERATED = shutil.ignore_patterns(".*", "demo", "build", "install", "log", "*.egg-info", "__pycache__", "test", "bags")
PROFILES_FILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
HAS_ROS_LAUNCH = importlib.util.find_spec("launch_ros") is not None and shutil.which("ros2") is not None


@pytest.fixture(scope="module")
def environment() -> dict[str, str]:
    bin_folder = str(Path(sys.executable).parent)
    inherited = {name: value for name, value in os.environ.items() if name != PROFILES_FILE}
    return {
        **inherited,
        "PATH": f"{bin_folder}{os.pathsep}{os.environ['PATH']}",
        "PYTHONUNBUFFERED": "1",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": str(DOMAIN),
    }


@pytest.fixture(scope="module")
def workspace(repository: Path, environment: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("workspace")
    shutil.copytree(repository, folder / "src" / "etd_ros", ignore=GENERATED)
    build = subprocess.run(["colcon", "build"], cwd=folder, env=environment, capture_output=True, text=True)
    assert build.returncode == 0, build.stdout + build.stderr
    return folder


@contextmanager
def running(workspace: Path, environment: dict[str, str], command: str, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A command with the install space sourced; ended by Ctrl-C."""
    with log.open("wb") as output:
        process = subprocess.Popen(
            ["bash", "-c", f"source '{workspace}/install/setup.bash' && exec {command}"],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
        )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(timeout=TIMEOUT_S)


def wait_for_boxes(topics: set[str], logs: list[Path]) -> None:
    """Return once a box has come on every topic."""
    heard: set[str] = set()
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    listener = Node("listener", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(listener)
    for topic in topics:

        def take(message: Detection2DArray, topic: str = topic) -> None:
            heard.update([topic] if message.detections else [])

        listener.create_subscription(Detection2DArray, topic, take, 100)
    end_s = time.monotonic() + TIMEOUT_S
    while heard != topics and time.monotonic() < end_s:
        executor.spin_once(timeout_sec=1.0)
    listener.destroy_node()
    rclpy.shutdown(context=context)
    assert heard == topics, "\n".join(log.read_text() for log in logs)


def profiles_of_nodes() -> set[str]:
    """The middleware profiles of all node processes of this domain."""
    profiles = set()
    for process in Path("/proc").glob("[0-9]*"):
        try:
            command, variables = (process / "cmdline").read_bytes(), (process / "environ").read_bytes()
        except OSError:
            continue  # ended meanwhile
        values = dict(line.partition("=")[::2] for line in variables.decode(errors="replace").split("\0"))
        if values.get("ROS_DOMAIN_ID") == str(DOMAIN) and b"/lib/etd_ros/" in command and b"replay" not in command:
            profiles.add(values.get(PROFILES_FILE, ""))
    return profiles


CASES = {
    "camera": (["camera.launch.py camera:=front"], {"/tracker/detections"}),
    "pipeline": (["pipeline.launch.py camera:=front namespace:=one"], {"/one/pipeline/detections"}),
    "cameras": (
        ["cameras.launch.py cameras:='front rear'"],
        {f"/{name}/pipeline/detections" for name in ("front", "rear")},
    ),
    "hosts": (
        ["camera_host.launch.py cameras:=front", "compute_host.launch.py cameras:=front"],
        {"/front/tracker/detections"},
    ),
    "hosts, images made at the camera": (
        [f"{host}_host.launch.py cameras:=front reconstruction:=camera" for host in ("camera", "compute")],
        {"/front/tracker/detections"},
    ),
}

if HAS_ROS_LAUNCH:

    @pytest.mark.parametrize(("files", "topics"), CASES.values(), ids=CASES)
    def test_boxes_flow_under_ros2_launch(workspace, environment, demo, tmp_path, files, topics):
        cameras = ("front", "rear") if any("rear" in file for file in files) else ("front",)
        # A machine that is busy with all these nodes makes them late; they are to drop nothing here.
        parameters = tmp_path / "patient.yaml"
        parameters.write_text("/**:\n  ros__parameters:\n    queue_s: 3600.0\n")
        given = f"targets_file:='{demo}/boxes.csv' params_file:='{parameters}'"
        commands = [f"ros2 launch etd_ros {file} {given}" for file in files]
        replay = f"'{workspace}/install/etd_ros/lib/etd_ros/replay' '{demo}' --loop --wait-for 1 --ros-args"
        commands += [f"{replay} -r __ns:=/{name} -r /event_camera/events:=/{name}/events" for name in cameras]
        logs = [tmp_path / f"{number}.log" for number in range(len(commands))]
        with ExitStack() as stack:
            started = [
                stack.enter_context(running(workspace, environment, command, log))
                for command, log in zip(commands, logs, strict=True)
            ]
            wait_for_boxes(topics, logs)
            assert profiles_of_nodes() == {f"{workspace}/install/etd_ros/share/etd_ros/config/fastdds_shm.xml"}
        for process, log in list(zip(started, logs, strict=True))[: len(files)]:
            assert process.returncode == 0, log.read_text()
            assert "process has died" not in log.read_text()

    def test_a_recording_is_replayed_by_one_command(workspace, environment, demo, tmp_path):
        command = f"ros2 launch etd_ros replay.launch.py recording:='{demo}' targets_file:='{demo}/boxes.csv'"
        log = tmp_path / "launch.log"
        with running(workspace, environment, command, log):
            wait_for_boxes({"/tracker/detections"}, [log])

    def test_the_arguments_of_what_is_included_are_shown(workspace, environment, tmp_path):
        log = tmp_path / "arguments.log"
        with running(workspace, environment, "ros2 launch etd_ros compute_host.launch.py --show-args", log) as process:
            assert process.wait(timeout=TIMEOUT_S) == 0
        for name in ("cameras", "reconstruction", "params_file", "shared_memory"):
            assert f"'{name}':" in log.read_text()
