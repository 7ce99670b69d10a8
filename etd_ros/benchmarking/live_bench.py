"""The bench of the live benchmark: a `pipeline` process, the load before it, and whoever reads its boxes behind it."""

from __future__ import annotations

import math
import os
import secrets
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from vision_msgs.msg import Detection2DArray

from etd_ros.benchmarking.live_load import LoadGenerator, Place, Play
from etd_ros.benchmarking.live_outcome import LOSSES, BoxMessage, Outcome, judged_boxes
from etd_ros.benchmarking.live_packets import TIME_HIGH_NS
from etd_ros.benchmarking.live_process import NODE, PipelineProcess
from etd_ros.benchmarking.live_scene import NS_PER_US, TARGET, TURN_US, LiveScene
from etd_ros.benchmarking.streams import BenchmarkError
from etd_ros.boxes import Box
from etd_ros.nodes.connections import FRAME_QOS, LISTENER_QOS
from etd_ros.nodes.own_context import Subscription, node_in_own_context
from msg_adapters import Detection, decode_detections, decode_diagnostics, encode_detections

SHARED_MEMORY_PROFILE = Path(__file__).resolve().parents[2] / "config" / "fastdds_shm.xml"
DOMAIN_ID_MAX = 100
TIMEOUT_S = 60.0
LEAD_NS = 300_000_000
"""From the order to the first event: the target is known to the node by then."""

PERCENTILES = (50, 99)
OWN_WINDOW_S = 10.0
"""How far back the node looks for its own percentiles."""

LEARNING_TURNS = 2
LEFT_OUT = "events left out of images"


class LiveBench:
    """Starts the node, tells it its target, and listens.

    Args:
        place: where it works.
        folder: for what the node prints.
    """

    def __init__(self, place: Place, folder: Path) -> None:
        self.place = place
        self._folder = folder
        self._ros = node_in_own_context("live_bench", place.domain, place.namespace)
        self._process: PipelineProcess | None = None
        self._boxes: list[BoxMessage] = []
        self._reader: Subscription | None = None
        self._diagnostics: dict[str, str] = {}
        self._diagnostics_ns = 0
        self._misses_last = False

    def __enter__(self) -> LiveBench:
        self.node, self._executor = self._ros.__enter__()
        self._targets = self.node.create_publisher(Detection2DArray, f"{NODE}/targets", FRAME_QOS)
        self._states = self.node.create_subscription(
            DiagnosticArray, "/diagnostics", self._take_diagnostics, LISTENER_QOS, raw=True
        )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end_pipeline()
        self._ros.__exit__(kind, error, trace)

    @property
    def process(self) -> PipelineProcess:
        """The node."""
        assert self._process is not None
        return self._process

    def start_pipeline(self, *parameters: str) -> None:
        """Start the node, with parameters as `NAME:=VALUE`; it is ready some seconds later."""
        self._diagnostics = {}
        self._process = PipelineProcess(self.place, self._folder / f"{NODE}.log", parameters)

    def end_pipeline(self) -> None:
        """End the node."""
        if self._process is not None:
            self._process.end()
            self._process = None

    def read(self, topic: str | None) -> None:
        """Read boxes from a topic, or no longer from any."""
        if self._reader is not None:
            self.node.destroy_subscription(self._reader)
            self._reader = None
        if topic is not None:
            self._reader = self.node.create_subscription(
                Detection2DArray, topic, self._take_box, LISTENER_QOS, raw=True
            )

    def start_target(self, box: Box, stamp_ns: int, name: str = TARGET) -> None:
        """Have a target start at a box at a time (ns); a box of size 0 stops it."""
        detection = Detection(name, box, 1.0, name)
        self._targets.publish(encode_detections([detection], stamp_ns=stamp_ns, frame_id=""))

    def figure(self, key: str) -> int:
        """A count of the node's diagnostics, 0 where there is none."""
        return int(self._diagnostics.get(key, 0))

    @property
    def listens(self) -> bool:
        """Whether the node takes targets."""
        return bool(self._targets.get_subscription_count())

    @property
    def hears_boxes(self) -> bool:
        """Whether somebody's boxes reach this process."""
        return self._reader is not None and bool(self._reader.get_publisher_count())

    @property
    def reads_events(self) -> bool:
        """Whether the node says that it reads events."""
        return self._diagnostics.get("reading events") == "True"

    def wait_until(self, condition: Callable[[], bool], what: str) -> None:
        """Listen until the condition holds.

        Raises:
            BenchmarkError: it never does, or the node has ended.
        """
        deadline_s = time.monotonic() + TIMEOUT_S
        while not condition():
            if time.monotonic() > deadline_s:
                msg = f"waited {TIMEOUT_S:.0f} s in vain for {what}: see what `python -m etd_ros.nodes pipeline` says"
                raise BenchmarkError(msg)
            self.spin_once()

    def spin_once(self) -> None:
        """Take what has come, or wait for it a little."""
        self._executor.spin_once(timeout_sec=0.05)
        if self._process is not None:
            self._process.check()

    def next_diagnostics(self) -> dict[str, str]:
        """Listen until the node has said how it fares."""
        now_ns = time.monotonic_ns()
        self.wait_until(lambda: self._diagnostics_ns > now_ns, "the node's diagnostics")
        return self._diagnostics

    def listen_for(self, duration_s: float) -> None:
        """Listen for some time (s)."""
        end_s = time.monotonic() + duration_s
        while time.monotonic() < end_s:
            self.spin_once()

    def take_boxes(self) -> list[BoxMessage]:
        """The messages with boxes since the last call, each with when it came (ns on the monotonic clock)."""
        taken, self._boxes = self._boxes, []
        return taken

    def first_box_ns(self) -> int:
        """When the first box of the target was received (ns on the monotonic clock); waits for it."""
        self.take_boxes()
        found: list[int] = []

        def has_come() -> bool:
            found.extend(at_ns for at_ns, message in self.take_boxes() if decode_detections(message).detections)
            return bool(found)

        self.wait_until(has_come, "the first box")
        return found[0]

    def run(
        self, generator: LoadGenerator, scene: LiveScene, duration_s: float, before: LoadGenerator | None = None
    ) -> Outcome:
        """Have the generator play what it has prepared, for `duration_s`, the target starting anew; see what comes.

        Args:
            generator: of the load.
            scene: that it plays.
            duration_s: of its play.
            before: plays two turns of the target first, of which nothing is judged: what the target looks like is
                learnt from them.
        """
        if self._misses_last:
            # What was lost last shows as a gap before the next message, which must not be this play's.
            self._misses_last = False
            self._play(generator, scene, generator.message_s)
        outcome = self._play(generator, scene, duration_s, before)
        self._misses_last = not outcome.is_lossless
        return outcome

    def _play(
        self, generator: LoadGenerator, scene: LiveScene, duration_s: float, learning: LoadGenerator | None = None
    ) -> Outcome:
        # Nothing has been published since the node said this.
        before = self._diagnostics
        self.take_boxes()
        start_ns = rounded_start_ns(time.time_ns() + LEAD_NS)
        self.start_target(scene.box(0), start_ns)
        if learning is not None:
            learning.play(Play(start_ns, LEARNING_TURNS * TURN_US * 1e-6))
            start_ns += LEARNING_TURNS * TURN_US * NS_PER_US
        generator.play(Play(start_ns, duration_s))
        resident_mib = []
        while not generator.is_done:
            self.spin_once()
            resident_mib.append(self.process.resident_mib)
        played = generator.played()
        learnt = 0 if learning is None else len(learning.played().published_ns)
        decoded = self._decoded_at_rest(before, len(played.published_ns) + learnt) - learnt
        losses = {key: self.figure(key) - int(before.get(key, 0)) for key in LOSSES}
        left_out, events = (self.figure(key) - int(before.get(key, 0)) for key in (LEFT_OUT, "events"))
        after_s, latency_ms, iou = judged_boxes(self.take_boxes(), played, scene)
        return Outcome(
            published=len(played.published_ns),
            duration_s=played.duration_s,
            decoded=decoded,
            losses=losses,
            unimaged=100 * left_out / max(1, events),
            after_s=after_s,
            latency_ms=latency_ms,
            iou=iou,
            resident_mib=np.array(resident_mib),
            own_latency_ms={
                percent: float(text)
                for percent in PERCENTILES
                if (text := self._diagnostics.get(f"latency p{percent} ms", "nan")) != "nan"
            },
        )

    def _decoded_at_rest(self, before: dict[str, str], published: int) -> int:
        """How many messages the node has decoded since, once it has got all or gets no more."""
        last = -1
        while True:
            now = int(self.next_diagnostics().get("event messages", 0)) - int(before.get("event messages", 0))
            if now in (published, last):
                return now
            last = now

    def _take_box(self, message: bytes) -> None:
        self._boxes.append((time.monotonic_ns(), message))

    def _take_diagnostics(self, message: bytes) -> None:
        for status in decode_diagnostics(message).statuses:
            if status.name == f"{self.place.namespace}/{NODE}":
                self._diagnostics = dict(status.values)
                self._diagnostics_ns = time.monotonic_ns()


def rounded_start_ns(stamp_ns: int) -> int:
    """The next time at which a scene can start."""
    return math.ceil(stamp_ns / TIME_HIGH_NS) * TIME_HIGH_NS


@contextmanager
def own_place() -> Iterator[Place]:
    """A place on this machine alone, with the shared-memory profile, for this process and those it starts."""
    wanted = {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(SHARED_MEMORY_PROFILE),
    }
    before = {name: os.environ.get(name) for name in wanted}
    os.environ.update(wanted)
    try:
        yield Place(1 + secrets.randbelow(DOMAIN_ID_MAX), f"live_{secrets.token_hex(4)}")
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
