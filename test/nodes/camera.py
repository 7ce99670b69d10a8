"""A camera driver that tests can break: plays a recording's events as messages, changed as they like."""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from conftest import Bench
from event_camera_msgs.msg import EventPacket
from vision_msgs.msg import Detection2DArray

from etd_ros.boxes import Box
from etd_ros.evaluation import read_boxes
from etd_ros.events import Events
from etd_ros.nodes.connections import EVENT_QOS
from etd_ros.recordings import open_recording
from msg_adapters import decode_detections, encode_event_packet

EVENTS = "/event_camera/events"
AHEAD_NS = 100_000_000
"""How far the messages may run ahead of the boxes: so nothing is lost on a busy machine but what is to be lost."""
MESSAGE_NS = 10_000_000
PATIENCE_S = 2.0


@dataclass(frozen=True)
class Shot:
    """One message to be sent; `shift_ns` is added to its times."""

    events: Events
    seq: int
    shift_ns: int = 0

    def encoded(self) -> bytes:
        events = dataclasses.replace(self.events, t=self.events.t + self.shift_ns)
        return encode_event_packet(events, stamp_ns=int(events.t[0]), frame_id="camera", seq=self.seq)

    @property
    def end_ns(self) -> int:
        return int(self.events.t[-1]) + self.shift_ns


def shots_of(recording: Path) -> list[Shot]:
    """A recording's events, 10 ms a message."""
    with open_recording(recording) as opened:
        parts = [item for item in opened.items() if isinstance(item, Events)]
    t = np.concatenate([part.t for part in parts])
    x, y, p = (np.concatenate([getattr(part, name) for part in parts]) for name in ("x", "y", "p"))
    everything = Events(t, x, y, p, parts[0].width, parts[0].height)
    edges = np.arange(t[0], t[-1], MESSAGE_NS)
    bounds = [*np.searchsorted(t, edges), len(t)]
    chunks = [everything[first:last] for first, last in itertools.pairwise(bounds) if last > first]
    return [Shot(events, seq) for seq, events in enumerate(chunks)]


class Camera:
    """Publishes messages no faster than the node under test makes boxes of them.

    Args:
        bench: with the node.
        topic: of its boxes.
    """

    def __init__(self, bench: Bench, topic: str) -> None:
        self.boxes: dict[int, dict[str, Box]] = {}
        """Stamp (ns) to the targets' boxes, of the last time that the stamp came."""
        self.latest_ns = 0
        self._bench = bench
        self._publisher = bench.node.create_publisher(EventPacket, EVENTS, EVENT_QOS)
        bench.listen(topic, Detection2DArray, self._take)

    def wait_for_readers(self, count: int = 1) -> None:
        """Until so many nodes read the events."""
        self._bench.wait_until(lambda: self._publisher.get_subscription_count() == count, "the events are read")

    def play(self, shots: Iterable[Shot], encode: Callable[[Shot], bytes] = Shot.encoded) -> None:
        """Publish; each message waits for the boxes to be near, but not for ever: a node may not be linked yet."""
        before_ns = None
        for shot in shots:
            if before_ns is not None and abs(shot.end_ns - before_ns) <= AHEAD_NS:
                self._wait_for_boxes(before_ns - AHEAD_NS)
            else:
                self.latest_ns = shot.end_ns
            before_ns = shot.end_ns
            self.send(encode(shot))
        assert before_ns is not None
        self._bench.wait_until(lambda: abs(self.latest_ns - before_ns) < AHEAD_NS, "the last boxes come")

    def _wait_for_boxes(self, since_ns: int) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while self.latest_ns < since_ns and time.monotonic() < end_s:
            self._bench.spin_once()

    def send(self, message: bytes) -> None:
        """Publish a message of any kind."""
        self._publisher.publish(message)

    def overlap(self, truth: Path, name: str, since_ns: int, until_ns: int, shift_ns: int = 0) -> float:
        """Mean IoU of a target's boxes with the truth between two times (ns) of the recording; no box counts as 0."""
        rows = [row for row in read_boxes(truth)[name] if since_ns <= row.stamp_ns < until_ns]
        stamps = np.array(sorted(self.boxes))
        found = []
        for row in rows:
            at = stamps[np.searchsorted(stamps, row.stamp_ns + shift_ns, side="right") - 1]
            box = self.boxes[at].get(name)
            found.append(0.0 if box is None else row.box.iou(box))
        return float(np.mean(found))

    def _take(self, message: bytes) -> None:
        decoded = decode_detections(message)
        self.latest_ns = decoded.stamp_ns
        self.boxes[decoded.stamp_ns] = {found.id: found.box for found in decoded.detections}
