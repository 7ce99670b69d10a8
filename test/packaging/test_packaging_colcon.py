"""The package in a colcon workspace: what is installed, and that it starts."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

NODES = {"accumulator", "pipeline", "reconstruction", "replay", "tracker"}
GENERATED = shutil.ignore_patterns(".*", "demo", "build", "install", "log", "*.egg-info", "__pycache__", "test", "bags")
TIMEOUT_S = 600
"""Kernels are compiled in a place without a cache: a minute and a half of processor time, on a shared machine."""
DOMAIN = 97


def in_workspace(workspace: Path, command: str) -> list[str]:
    """A command line that runs in the workspace with its install space sourced, as exec."""
    return ["bash", "-c", f"cd '{workspace}' && source install/setup.bash && exec {command}"]


@pytest.fixture(scope="module")
def environment() -> dict[str, str]:
    bin_folder = str(Path(sys.executable).parent)
    return {
        **os.environ,
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


def test_colcon_finds_this_package_and_no_interface_package(workspace: Path, environment: dict[str, str]) -> None:
    command = ["colcon", "list", "--names-only"]
    found = subprocess.run(command, cwd=workspace, env=environment, check=True, capture_output=True, text=True)
    assert found.stdout.split() == ["etd_ros"]


def test_the_nodes_are_where_ros2_run_looks(workspace: Path) -> None:
    executables = workspace / "install" / "etd_ros" / "lib" / "etd_ros"
    assert {path.name for path in executables.iterdir()} == NODES
    assert all(os.access(path, os.X_OK) for path in executables.iterdir())


def test_the_index_marker_and_the_shared_files_are_installed(workspace: Path, repository: Path) -> None:
    share = workspace / "install" / "etd_ros" / "share"
    assert (share / "ament_index" / "resource_index" / "packages" / "etd_ros").is_file()
    assert (share / "etd_ros" / "package.xml").is_file()
    for folder in ("config", "launch"):
        expected = {path.name for path in (repository / folder).iterdir() if path.is_file()}
        assert {path.name for path in (share / "etd_ros" / folder).glob("*")} == expected


def nodes_heard(expected: set[str]) -> set[str]:
    """Names of the nodes that report to /diagnostics, once all expected ones have or the time is over."""
    heard: set[str] = set()
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    listener = Node("listener", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(listener)

    def take(message: DiagnosticArray) -> None:
        heard.update(status.name for status in message.status)

    listener.create_subscription(DiagnosticArray, "/diagnostics", take, 10)
    end_s = time.monotonic() + TIMEOUT_S
    while not expected <= heard and time.monotonic() < end_s:
        executor.spin_once(timeout_sec=1.0)
    listener.destroy_node()
    rclpy.shutdown(context=context)
    return heard


def test_each_installed_node_starts_and_leaves_quietly(workspace: Path, environment: dict[str, str]) -> None:
    nodes: dict[str, subprocess.Popen[str]] = {}
    try:
        # The pipeline has the kernels of all others, which need not be compiled by each then.
        for started in ({"pipeline"}, NODES - {"pipeline", "replay"}):
            for node in started:
                nodes[node] = subprocess.Popen(
                    in_workspace(workspace, f"install/etd_ros/lib/etd_ros/{node}"),
                    env=environment,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT,
                    text=True,
                )
            assert nodes_heard(set(nodes)) >= set(nodes)
        for process in nodes.values():
            process.send_signal(signal.SIGINT)
        for node, process in nodes.items():
            rest, _ = process.communicate(timeout=TIMEOUT_S)
            assert process.returncode == 0, f"{node}: {rest}"
            assert "Traceback" not in rest
    finally:
        for process in nodes.values():
            process.kill()
            process.wait()


def test_the_installed_replay_asks_for_a_recording(workspace: Path, environment: dict[str, str]) -> None:
    command = in_workspace(workspace, "install/etd_ros/lib/etd_ros/replay")
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=TIMEOUT_S)
    assert result.returncode == 2
    assert "recording" in result.stderr.lower()
