"""Two hosts on one machine, each with a network, an IP address and shared memory of its own.

Where the machine allows it, a host is a set of Linux namespaces, held by a process, and the two are linked by a pair of
virtual interfaces. Everything is gone as soon as those processes are. Elsewhere both hosts are the loopback, and their
processes are kept to UDP.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import time
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from loopback_profile import write_loopback_profile
from ros_domains import fresh_domains

REPOSITORY = Path(__file__).resolve().parents[2]
DOMAINS = fresh_domains()
TIMEOUT_S, POLL_S = 60.0, 0.05
INTERFACE = "camera_link"
DISCOVERY_GROUP = "0100FFEF"
"""239.255.0.1, where Fast DDS announces itself, as /proc/net/igmp writes it."""
HOLD = "mount -t tmpfs tmpfs /dev/shm && ip link set lo up && echo ready && exec cat"
"""A host's process: it lives until its input ends, with whoever has made it."""


class NoNamespacesError(Exception):
    """This machine gives no network namespaces, or has nothing to link them with."""


@dataclass
class Host:
    """Where processes run.

    Attributes:
        name: for log files.
        address: IPv4 address under which the other host reaches it.
        holder: the process that holds the namespaces; None on the loopback.
    """

    name: str
    address: str
    holder: subprocess.Popen[str] | None = None
    processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    def start(self, name: str, command: list[str], environment: Mapping[str, str], log: Path) -> None:
        """Start a process here, with its output in a file."""
        with log.open("wb") as output:
            self.processes[name] = subprocess.Popen(
                [*self._enter(), *command],
                cwd=REPOSITORY,
                env={**os.environ, **environment},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
            )

    def stop(self) -> None:
        """Interrupt every process and wait for it; what stays is killed."""
        for process in self.processes.values():
            process.send_signal(signal.SIGINT)
        for process in self.processes.values():
            try:
                process.wait(timeout=TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self.processes.clear()

    def proc_net(self, file: str) -> str:
        """A file of the host's /proc/net."""
        return Path(f"/proc/{self.holder.pid if self.holder else 'self'}/net/{file}").read_text()

    def _enter(self) -> list[str]:
        if self.holder is None:
            return []
        return ["nsenter", f"--target={self.holder.pid}", "--net", "--mount", "--ipc", f"--wd={REPOSITORY}", "--"]


@dataclass
class Network:
    """Two hosts and the link between them."""

    camera: Host
    compute: Host
    kind: str

    @property
    def has_namespaces(self) -> bool:
        """Whether the link is one that can be cut and counts its bytes."""
        return self.camera.holder is not None

    def environment(self, folder: Path) -> dict[str, str]:
        """What makes this checkout's processes meet over this link alone, in a ROS domain of their own: nothing of it
        leaves the machine.

        Args:
            folder: where a configuration can be written.
        """
        shared_memory = REPOSITORY / "config" / "fastdds_shm.xml"
        profile = shared_memory if self.has_namespaces else write_loopback_profile(folder)
        return {
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
            "FASTRTPS_DEFAULT_PROFILES_FILE": str(profile),
            "PYTHONUNBUFFERED": "1",
            "ROS_DOMAIN_ID": str(next(DOMAINS)),
            "PYTHONPATH": str(REPOSITORY),
        }

    def carried_bytes(self) -> int:
        """Bytes that the camera host has sent to the other one so far."""
        interface = INTERFACE if self.has_namespaces else "lo"
        (line,) = (
            line for line in self.camera.proc_net("dev").splitlines() if line.strip().startswith(f"{interface}:")
        )
        return int(line.partition(":")[2].split()[8])

    def announces_by_multicast(self) -> bool:
        """Whether a process of the camera host listens to the address of multicast discovery."""
        return DISCOVERY_GROUP in self.camera.proc_net("igmp")

    @contextmanager
    def cut(self) -> Iterator[None]:
        """The link is down, or, without one that could be, the camera host's processes stand still."""
        if self.has_namespaces:
            self._set_link("down")
        else:
            self._signal(signal.SIGSTOP)
        try:
            yield
        finally:
            if self.has_namespaces:
                self._set_link("up")
            else:
                self._signal(signal.SIGCONT)

    def _set_link(self, state: str) -> None:
        subprocess.run([*self.camera._enter(), "ip", "link", "set", INTERFACE, state], check=True)

    def _signal(self, number: signal.Signals) -> None:
        for process in self.camera.processes.values():
            process.send_signal(number)


@contextmanager
def network() -> Iterator[Network]:
    """Two hosts, by namespaces if they can be had, else both on the loopback, which is said in a warning."""
    try:
        made = _linked_hosts()
    except NoNamespacesError as err:
        warnings.warn(f"no network namespaces here ({err}): the same processes run on the loopback", stacklevel=3)
        made = Network(Host("camera", "127.0.0.1"), Host("compute", "127.0.0.1"), "loopback")
    try:
        yield made
    finally:
        for host in (made.camera, made.compute):
            host.stop()
            _release(host)


def heard(log: Path) -> list[dict[str, Any]]:
    """What `network_listener.py` has said so far."""
    whole_lines, _, _ = log.read_text().rpartition("\n")
    return [json.loads(line) for line in whole_lines.splitlines() if line.startswith("{")]


def _linked_hosts() -> Network:
    missing = [tool for tool in ("ip", "nsenter", "unshare") if shutil.which(tool) is None]
    if missing:
        msg = f"{', '.join(missing)} missing: apt install iproute2 util-linux"
        raise NoNamespacesError(msg)
    camera, compute = Host("camera", "10.77.0.1"), Host("compute", "10.77.0.2")
    try:
        for host in (camera, compute):
            host.holder = _hold()
        assert camera.holder is not None
        assert compute.holder is not None
        peer = ["peer", "name", INTERFACE, "netns", str(compute.holder.pid)]
        _run(["ip", "link", "add", INTERFACE, "netns", str(camera.holder.pid), "type", "veth", *peer])
        for host in (camera, compute):
            _run([*host._enter(), "ip", "address", "add", f"{host.address}/24", "dev", INTERFACE])
            _run([*host._enter(), "ip", "link", "set", INTERFACE, "up"])
        for host in (camera, compute):
            _wait_for_link(host)
    except NoNamespacesError:
        _release(camera)
        _release(compute)
        raise
    return Network(camera, compute, "namespaces")


def _hold() -> subprocess.Popen[str]:
    command = ["unshare", "--net", "--mount", "--ipc", "sh", "-c", HOLD]
    pipe = subprocess.PIPE
    holder = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True)
    assert holder.stdout is not None
    if holder.stdout.readline().strip() != "ready":
        _, reason = holder.communicate()
        raise NoNamespacesError(reason.strip())
    return holder


def _release(host: Host) -> None:
    """The namespaces go with their last process, and the link with them."""
    if host.holder is not None:
        host.holder.communicate()
        host.holder = None


def _wait_for_link(host: Host) -> None:
    """Until the link works, which is up to a second after it is set up: Fast DDS leaves out for good an interface that
    does not work yet when a process starts."""
    deadline_s = time.monotonic() + TIMEOUT_S
    while "state UP" not in _run([*host._enter(), "ip", "link", "show", INTERFACE]):
        if time.monotonic() > deadline_s:
            msg = f"{INTERFACE} of {host.name} does not come up"
            raise NoNamespacesError(msg)
        time.sleep(POLL_S)


def _run(command: list[str]) -> str:
    result = subprocess.run(command, capture_output=True, text=True)
    if result.returncode:
        raise NoNamespacesError(result.stderr.strip())
    return result.stdout
