"""A camera host and a compute host: frames cross the network, boxes come out on the other side."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from network_hosts import POLL_S, REPOSITORY, TIMEOUT_S, Host, Network, heard, network

CAMERA = "front"
RECORDING = REPOSITORY / "bags" / "demo"
FRAME_BYTES = 240 * 180 * 2
SERVER_PORT = 11811


class Machines:
    """The nodes of one camera on two hosts, and a listener beside the tracker."""

    def __init__(self, hosts: Network, folder: Path) -> None:
        self.hosts = hosts
        self._folder = folder
        self._environment = hosts.environment(folder)

    def serve_discovery(self, *, tells_all: bool) -> None:
        """A discovery server on the camera host, which all processes started from now on ask for each other.

        Args:
            tells_all: whether processes ask for everything there is, or for what they read and write.
        """
        server = shutil.which("fast-discovery-server", path=f"{Path(sys.executable).parent}") or "fast-discovery-server"
        address = self.hosts.camera.address
        command = [server, "--server-id", "0", "--udp-address", address, "--udp-port", str(SERVER_PORT)]
        self.hosts.camera.start("discovery_server", command, self._environment, self._log("discovery_server"))
        port = f":{SERVER_PORT:04X} "
        self.wait_until(lambda: port in self.hosts.camera.proc_net("udp"), "the discovery server listens")
        is_super = "TRUE" if tells_all else "FALSE"
        self._environment |= {"ROS_DISCOVERY_SERVER": f"{address}:{SERVER_PORT}", "ROS_SUPER_CLIENT": is_super}

    def start(self, reconstruction: str) -> None:
        """Driver and accumulator on the camera host, the tracker on the other, the reconstruction on either."""
        events = ("-r", f"~/events:=/{CAMERA}/events")
        camera, compute = self.hosts.camera, self.hosts.compute
        truth = RECORDING / "boxes.csv"
        self._listen()
        self._node(camera, "accumulator", ros=events)
        self._node(getattr(self.hosts, reconstruction), "reconstruction", ros=events)
        self._node(compute, "tracker", ros=("-p", f"targets_file:={truth}"))
        to_camera = ("-r", f"/event_camera/events:=/{CAMERA}/events")
        self._node(camera, "replay", str(RECORDING), "--loop", "--wait-for", "2", ros=to_camera)

    def boxes(self) -> int:
        """How many boxes have arrived."""
        return sum(line.get("boxes", 0) for line in self._heard())

    def figure(self, node: str, key: str) -> int:
        """A number of a node's latest diagnostics."""
        return (self._figures(node, key) or [0])[-1]

    def stands_still(self, node: str, key: str) -> bool:
        """Whether a number has been the same in the last few diagnostics."""
        last = self._figures(node, key)[-3:]
        return len(last) == 3 and len(set(last)) == 1

    def wait_until(self, condition: Callable[[], bool], what: str) -> None:
        """Fail with the logs where the condition never holds."""
        deadline_s = time.monotonic() + TIMEOUT_S
        while not condition():
            if time.monotonic() > deadline_s:
                logs = (f"--- {path.name}\n{path.read_text()[-2000:]}" for path in sorted(self._folder.glob("*.log")))
                pytest.fail("\n".join([f"waited in vain until {what}, on {self.hosts.kind}", *logs]))
            time.sleep(POLL_S)

    def _listen(self) -> None:
        command = [
            sys.executable,
            str(Path(__file__).with_name("network_listener.py")),
            f"/{CAMERA}/tracker/detections",
        ]
        self.hosts.compute.start("listener", command, self._environment, self._log("listener"))

    def _node(self, host: Host, name: str, *arguments: str, ros: tuple[str, ...]) -> None:
        command = [sys.executable, "-m", "etd_ros.nodes", name, *arguments]
        # These tests are of the network: nodes that a busy machine makes late are to drop nothing.
        patience = () if name == "replay" else ("-p", "queue_s:=3600.0")
        ros_arguments = ["--ros-args", "-r", f"__ns:=/{CAMERA}", *patience, *ros]
        host.start(name, command + ros_arguments, self._environment, self._log(name))

    def _figures(self, node: str, key: str) -> list[int]:
        return [int(line["values"].get(key, 0)) for line in self._heard() if line.get("node") == f"{CAMERA}/{node}"]

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"

    def _heard(self) -> list[dict]:
        return heard(self._log("listener"))


@pytest.fixture
def machines(tmp_path: Path) -> Iterator[Machines]:
    with network() as hosts:
        yield Machines(hosts, tmp_path)


def assert_frames_crossed_the_link(machines: Machines) -> None:
    machines.wait_until(lambda: machines.figure("tracker", "frames received") > 0, "the tracker says what it got")
    frames = machines.figure("tracker", "frames received")
    assert machines.hosts.carried_bytes() > frames * FRAME_BYTES


def test_hosts_find_each_other_by_multicast_and_boxes_come_again_after_the_link_was_down(machines):
    machines.start(reconstruction="compute")
    machines.wait_until(lambda: machines.boxes() > 100, "boxes arrive")
    assert_frames_crossed_the_link(machines)
    assert machines.hosts.announces_by_multicast() or not machines.hosts.has_namespaces
    with machines.hosts.cut():
        machines.wait_until(lambda: machines.stands_still("tracker", "frames received"), "no frame arrives any more")
        before = machines.figure("tracker", "frames received")
    machines.wait_until(lambda: machines.figure("tracker", "frames received") > before + 100, "frames arrive again")
    boxes = machines.boxes()
    machines.wait_until(lambda: machines.boxes() > boxes + 100, "boxes arrive again")


@pytest.mark.parametrize("tells_all", [True, False], ids=["super clients", "clients"])
def test_hosts_find_each_other_by_a_discovery_server_without_multicast(machines, tells_all):
    machines.serve_discovery(tells_all=tells_all)
    machines.start(reconstruction="camera")
    machines.wait_until(lambda: machines.boxes() > 100, "boxes arrive")
    machines.wait_until(lambda: machines.figure("tracker", "images received") > 0, "images arrive")
    assert_frames_crossed_the_link(machines)
    assert not machines.hosts.announces_by_multicast() or not machines.hosts.has_namespaces
