"""Hours of events through a real `pipeline` process over DDS, as fast as it goes without losing any.

One recording again and again, each loop from the same start: as a bag loops (times start again), or with times that go
on, a message lost between two loops, and targets that are named anew by `~/targets` and `~/reset`. Prints each loop's
memory and latency, and whether its boxes are those of the first loop; for example
`python scripts/soak_live.py --hours 1 --times again`. Exit code 1: boxes differ, or something was lost.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from event_camera_msgs.msg import EventPacket
from std_srvs.srv import Trigger

from etd_ros.benchmarking.live_bench import LiveBench, own_place
from etd_ros.benchmarking.live_process import NODE
from etd_ros.events import Events
from etd_ros.nodes.connections import EVENT_QOS
from etd_ros.recordings import open_recording
from etd_ros.targets import TargetStart, targets_from_file
from msg_adapters import Detection, decode_detections, encode_event_packet

DEMO = Path(__file__).resolve().parents[1] / "bags" / "demo"
MESSAGES_AHEAD = 32
"""How far publishing may run ahead of the boxes: far more than a frame holds, far less than the node's queue."""

PAUSE_NS = 1_000_000_000
"""Between two loops where times go on."""

LOSSLESS = "queue_s:=3600.0"
"""The node's parameter: what waits is not dropped for its age."""

STALL_S = 60.0
TAIL_S = 2.0
"""How long a loop may go without as many boxes as the first one had, before the node is asked whether all is done."""

NS_PER_MS, NS_PER_S = 1e6, 1e9
Boxes = dict[int, tuple[Detection, ...]]


class SoakError(Exception):
    """The soak cannot go on."""


@dataclasses.dataclass
class Loop:
    """One time through the recording.

    Attributes:
        boxes: by stamp since the recording's start (ns).
        latency_ms: from publishing the message that holds a frame's end to receiving its boxes.
        resident_mib: the node's memory when the loop was over.
    """

    boxes: Boxes = dataclasses.field(default_factory=dict)
    latency_ms: list[float] = dataclasses.field(default_factory=list)
    resident_mib: float = 0.0


class Soak:
    """Publishes loops and collects what comes back.

    Args:
        bench: with the node running.
        messages: the recording's events, one message each, in time order.
        targets: to name anew for each loop where times go on; None for times that start again.
    """

    def __init__(self, bench: LiveBench, messages: Sequence[Events], targets: Sequence[TargetStart] | None) -> None:
        self._bench = bench
        self._messages = messages
        self._targets = targets
        self._firsts_ns = np.array([events.t[0] for events in messages])
        self._start_ns = int(self._firsts_ns[0])
        goes_on = targets is not None
        self._period_ns = int(messages[-1].t[-1]) - self._start_ns + PAUSE_NS if goes_on else 0
        self._publisher = bench.node.create_publisher(EventPacket, bench.place.events, EVENT_QOS)
        self._reset = bench.node.create_client(Trigger, f"{NODE}/reset")
        self._number = 0
        self._boxes_expected = 0
        self._published_ns: list[int] = []
        self._answered = 0
        self._loop = Loop()

    @property
    def is_read(self) -> bool:
        """Whether the node has subscribed."""
        return bool(self._publisher.get_subscription_count())

    def play(self) -> Loop:
        """Play the recording once: what comes back of it, which is all but the frame that its end leaves unfinished.

        Raises:
            SoakError: no boxes come any more.
        """
        self._loop, self._published_ns, self._answered = Loop(), [], 0
        shift_ns = self._number * self._period_ns
        if self._targets is not None:
            self._name_targets(self._targets, shift_ns)
        for index, events in enumerate(self._messages):
            self._wait_for_room()
            # Where times go on, a number is left out between two loops, which makes the node start a new stream.
            seq = index + self._number * (len(self._messages) + 1) if self._period_ns else index
            self._publish(dataclasses.replace(events, t=events.t + shift_ns), seq)
        self._wait_for_tail()
        self._number += 1
        self._boxes_expected = self._boxes_expected or len(self._loop.boxes)
        self._loop.resident_mib = self._bench.process.resident_mib
        return self._loop

    def _name_targets(self, targets: Sequence[TargetStart], shift_ns: int) -> None:
        for target in targets:
            self._bench.start_target(target.box, target.stamp_ns + shift_ns, target.name)
        # The second answer comes after the node has taken the targets, whatever overtook what on the way.
        for _ in range(2):
            answer = self._reset.call_async(Trigger.Request())
            self._bench.wait_until(answer.done, "the answer of ~/reset")

    def _publish(self, events: Events, seq: int) -> None:
        message = encode_event_packet(events, stamp_ns=int(events.t[0]), frame_id="event_camera", seq=seq)
        self._published_ns.append(time.monotonic_ns())
        self._publisher.publish(message)

    def _wait_for_room(self) -> None:
        deadline_s = time.monotonic() + STALL_S
        while len(self._published_ns) - self._answered >= MESSAGES_AHEAD:
            if time.monotonic() > deadline_s:
                msg = (
                    f"no boxes for {STALL_S:.0f} s after {len(self._published_ns)} messages of loop {self._number + 1}"
                )
                raise SoakError(msg)
            self._listen()

    def _wait_for_tail(self) -> None:
        """Until as many boxes have come as in the first loop; else until the node has said that it reads no more."""
        deadline_s = time.monotonic() + TAIL_S
        while time.monotonic() < deadline_s:
            if self._boxes_expected and len(self._loop.boxes) >= self._boxes_expected:
                return
            self._listen()
        quiet = 0
        while quiet < 2:
            before = len(self._loop.boxes)
            self._bench.next_diagnostics()
            self._take()
            quiet = quiet + 1 if len(self._loop.boxes) == before else 0

    def _listen(self) -> None:
        self._bench.spin_once()
        self._take()

    def _take(self) -> None:
        for received_ns, message in self._bench.take_boxes():
            decoded = decode_detections(message)
            since_ns = decoded.stamp_ns - self._number * self._period_ns
            index = int(np.searchsorted(self._firsts_ns, since_ns, "right")) - 1
            self._answered = index + 1
            self._loop.boxes[since_ns - self._start_ns] = decoded.detections
            self._loop.latency_ms.append((received_ns - self._published_ns[index]) / NS_PER_MS)


def main() -> int:
    """Run the loops and print what they took."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=1.0, help="of events (default: 1)")
    parser.add_argument(
        "--times", choices=("again", "on"), default="again", help="start again or go on (default: again)"
    )
    parser.add_argument("--recording", type=Path, default=DEMO, help="default: the bundled one")
    parser.add_argument(
        "--targets", type=Path, default=DEMO / "boxes.csv", metavar="BOXES.csv", help="default: bundled"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of words")
    options = parser.parse_args()
    figures = soak(options.recording, options.targets, options.hours * 3600, options.times, tell=not options.json)
    if options.json:
        print(json.dumps(figures))
    else:
        memory = figures["resident_mib"]
        print(
            f"{figures['loops']} loops, {figures['events'] / 1e6:.0f} M events in {figures['took_s']:.0f} s; "
            f"{memory[1]:.1f} MiB after two loops, {memory[-1]:.1f} MiB at the end, in the second half "
            f"{figures['mib_per_hour']:+.1f} MiB an hour; "
            f"losses {figures['losses']}; loops whose boxes differ: {figures['differing'] or 'none'}"
        )
    return 1 if figures["differing"] or any(figures["losses"].values()) else 0


def soak(recording: Path, boxes: Path, duration_s: float, times: str, *, tell: bool) -> dict[str, Any]:
    """Play the recording for so many of its own seconds, twice at least.

    Args:
        recording: any that can be opened.
        boxes: its targets.
        duration_s: how long (s).
        times: `again` or `on`.
        tell: whether to print a line for each loop.

    Raises:
        SoakError: boxes stop coming.
        EtdError: a file cannot be read, or the node ends.
    """
    with open_recording(recording) as opened:
        messages = [events for events in opened.events() if len(events)]
    targets = targets_from_file(boxes)
    wanted = max(2, round(duration_s * NS_PER_S / int(messages[-1].t[-1] - messages[0].t[0])))
    started_s = time.monotonic()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="etd_ros_soak_")))
        bench = stack.enter_context(LiveBench(stack.enter_context(own_place()), folder))
        player = Soak(bench, messages, targets if times == "on" else None)
        bench.read(f"{NODE}/detections")
        of_targets = () if times == "on" else (f"targets_file:={boxes.resolve()}",)
        bench.start_pipeline(LOSSLESS, *of_targets)
        bench.wait_until(lambda: bench.listens and bench.hears_boxes and player.is_read, "the node")
        loops = []
        first: Loop | None = None
        for number in range(1, wanted + 1):
            loop = player.play()
            first = first or loop
            loops.append(figures_of(number, loop, first))
            if tell:
                print(", ".join(f"{key} {value}" for key, value in loops[-1].items()), flush=True)
        bench.next_diagnostics()
        losses = {key: bench.figure(key) for key in ("dropped messages", "decode errors", "errors")}
        losses["not decoded"] = wanted * len(messages) - bench.figure("event messages")
    took_s = time.monotonic() - started_s
    memory = [loop["MiB"] for loop in loops]
    later = memory[len(memory) // 2 :]
    slope_mib = float(np.polyfit(np.arange(len(later)), later, 1)[0]) if len(later) > 1 else 0.0
    return {
        "loops": wanted,
        "events": wanted * sum(map(len, messages)),
        "took_s": took_s,
        "boxes": loops[0]["boxes"],
        "resident_mib": memory,
        "mib_per_hour": slope_mib * wanted * 3600 / took_s,
        "latency_p50_ms": [loop["p50 ms"] for loop in loops],
        "latency_p99_ms": [loop["p99 ms"] for loop in loops],
        "losses": losses,
        "differing": [loop["loop"] for loop in loops if loop["stamps that differ"]],
    }


def figures_of(number: int, loop: Loop, first: Loop) -> dict[str, float]:
    """One loop in figures; `stamps that differ` counts those at which it has other boxes than the first loop."""
    stamps = {*first.boxes, *loop.boxes}
    return {
        "loop": number,
        "boxes": sum(map(len, loop.boxes.values())),
        "stamps that differ": sum(first.boxes.get(stamp) != loop.boxes.get(stamp) for stamp in stamps),
        "p50 ms": round(float(np.percentile(loop.latency_ms, 50)), 2),
        "p99 ms": round(float(np.percentile(loop.latency_ms, 99)), 2),
        "MiB": round(loop.resident_mib, 2),
    }


if __name__ == "__main__":
    sys.exit(main())
