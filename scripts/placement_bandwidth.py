"""What crosses the network for each placement of the nodes on two hosts, as a Markdown table.

The hosts are those of `test/network`: each with a network and shared memory of its own, and a link that counts its
bytes (Linux namespaces; root, or a machine that lets users make them). A recording is replayed on the first one, in a
loop and at its own pace, and boxes are read on the second; for example
`PYTHONPATH=test:test/network python scripts/placement_bandwidth.py bags/demo --targets bags/demo/boxes.csv`.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from network_hosts import REPOSITORY, Host, Network, heard, network

EVENTS = "/event_camera/events"
FIRST_BOX_S, SETTLE_S, POLL_S = 60.0, 3.0, 0.1


@dataclass(frozen=True)
class Placement:
    """Which nodes stand beside the camera, and which on the other host."""

    name: str
    camera: tuple[str, ...]
    compute: tuple[str, ...]


PLACEMENTS = (
    Placement("all at the camera", ("pipeline",), ()),
    Placement("all elsewhere", (), ("pipeline",)),
    Placement("split, images made at the camera", ("accumulator", "reconstruction"), ("tracker",)),
    Placement("split", ("accumulator",), ("reconstruction", "tracker")),
)


class NothingCameError(Exception):
    """No box has reached the second host."""


@dataclass
class Run:
    """One placement at work.

    Args:
        hosts: two of them, empty.
        folder: for logs.
        options: the command line's.
    """

    hosts: Network
    folder: Path
    options: argparse.Namespace

    def start(self, placement: Placement) -> None:
        """Start the nodes, a reader of the boxes on the second host, and the replay on the first."""
        self._environment = self.hosts.environment(self.folder)
        names = (*placement.camera, *placement.compute)
        listener = REPOSITORY / "test" / "network" / "network_listener.py"
        self._process(self.hosts.compute, "listener", [str(listener), f"/{names[-1]}/detections"])
        for name in names:
            self._node(self.hosts.camera if name in placement.camera else self.hosts.compute, name)
        readers = str(sum(name != "tracker" for name in names))
        replay = ["-m", "etd_ros.nodes", "replay", str(self.options.recording), "--loop", "--wait-for", readers]
        topic = ["--ros-args", "-r", f"{self.options.topic}:={EVENTS}"] if self.options.topic != EVENTS else []
        self._process(self.hosts.camera, "replay", [*replay, *topic])

    def megabytes_per_s(self) -> tuple[float, float]:
        """What the first host sends a second, once boxes come, and how many boxes arrive a second.

        Raises:
            NothingCameError: no boxes.
        """
        self._wait_for_a_box()
        time.sleep(SETTLE_S)
        start_s, boxes, carried = time.monotonic(), self._boxes(), self.hosts.carried_bytes()
        time.sleep(self.options.duration)
        passed_s = time.monotonic() - start_s
        return (self.hosts.carried_bytes() - carried) / passed_s / 1e6, (self._boxes() - boxes) / passed_s

    def _node(self, host: Host, name: str) -> None:
        arguments = ["-r", f"~/events:={EVENTS}"] if name != "tracker" else []
        if name in ("tracker", "pipeline"):
            target = f"targets_file:={self.options.targets}" if self.options.targets else f"targets:={self.options.box}"
            arguments += ["-p", target]
        self._process(host, name, ["-m", "etd_ros.nodes", name, "--ros-args", *arguments])

    def _process(self, host: Host, name: str, arguments: list[str]) -> None:
        host.start(name, [sys.executable, *arguments], self._environment, self.folder / f"{name}.log")

    def _boxes(self) -> int:
        return sum(line.get("boxes", 0) for line in heard(self.folder / "listener.log"))

    def _wait_for_a_box(self) -> None:
        deadline_s = time.monotonic() + FIRST_BOX_S
        while not self._boxes():
            if time.monotonic() > deadline_s:
                msg = f"no box within {FIRST_BOX_S:.0f} s: see {self.folder}"
                raise NothingCameError(msg)
            time.sleep(POLL_S)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path, help="events to replay")
    parser.add_argument("--targets", type=Path, metavar="BOXES.csv", help="what to track")
    parser.add_argument("--box", default="target:60,60,40,40", metavar="NAME:X,Y,W,H", help="the same without a file")
    parser.add_argument("--topic", default=EVENTS, help=f"where the recording has its events (default: {EVENTS})")
    parser.add_argument("--duration", type=float, default=10.0, metavar="S", help="to measure for (default: 10)")
    options = parser.parse_args()
    options.recording = options.recording.resolve()
    options.targets = options.targets.resolve() if options.targets else None
    print("| placement | MB/s from the camera's host to the other | boxes/s there |\n|-|-|-|")
    for placement in PLACEMENTS:
        with network() as hosts:
            if not hosts.has_namespaces:
                return 1
            run = Run(hosts, Path(tempfile.mkdtemp(prefix="placement_")), options)
            run.start(placement)
            sent, boxes = run.megabytes_per_s()
            print(f"| {placement.name} | {sent:.1f} | {boxes:.0f} |", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
