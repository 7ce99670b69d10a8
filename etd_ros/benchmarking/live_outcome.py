"""What became of one play of the live benchmark: its boxes held against the load's times and the scene's truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from etd_ros.benchmarking.live_load import NS_PER_S, Played
from etd_ros.benchmarking.live_scene import NS_PER_US, LiveScene
from msg_adapters import decode_detections

NS_PER_MS = 1_000_000
LOSSES = ("dropped messages", "lost messages", "sequence gaps", "steps back in time", "decode errors", "errors")
"""Keys of the node's diagnostics of which none may grow."""

Seconds = npt.NDArray[np.float64]
Milliseconds = npt.NDArray[np.float64]
BoxMessage = tuple[int, bytes]
"""A message with boxes, and when it came (ns on the monotonic clock)."""


@dataclass(frozen=True)
class Outcome:
    """What became of one play.

    Attributes:
        published: messages that the generator published.
        duration_s: how long it took for them (s).
        decoded: messages that the node decoded.
        losses: by the node's diagnostics, what grew meanwhile of `LOSSES`.
        unimaged: share of the decoded events that were left out of the images (percent).
        after_s: when each box's frame ended, since the start of the scene (s), shape (n,).
        latency_ms: from publishing the message that holds a frame's end to receiving the frame's box, shape (n,).
        iou: of each box with the truth, 0 where the target had none, shape (n,).
        resident_mib: memory of the node now and then during the play, shape (m,).
        own_latency_ms: by percentile, what the node says of its last ten seconds (ms), received to published.
    """

    published: int
    duration_s: float
    decoded: int
    losses: dict[str, int]
    unimaged: float
    after_s: Seconds
    latency_ms: Milliseconds
    iou: npt.NDArray[np.float64]
    resident_mib: npt.NDArray[np.float64]
    own_latency_ms: dict[int, float]

    @property
    def is_lossless(self) -> bool:
        """Whether every message was decoded, and nothing was missed."""
        return self.decoded == self.published and not any(self.losses.values())

    @property
    def dropped(self) -> int:
        """Messages that the node did not decode."""
        return self.published - self.decoded


def box_latencies(messages: Sequence[BoxMessage], played: Played) -> tuple[Seconds, Milliseconds]:
    """When boxes are of (s since the start of the scene) and their latencies (ms), each of shape (n,)."""
    stamps = np.array([decode_detections(message).stamp_ns for _, message in messages], np.int64)
    received = np.array([at_ns for at_ns, _ in messages], np.int64)
    return _seconds(played, stamps), _latencies(played, stamps, received)


def judged_boxes(
    taken: Sequence[BoxMessage], played: Played, scene: LiveScene
) -> tuple[Seconds, Milliseconds, npt.NDArray[np.float64]]:
    """What `box_latencies` says of the boxes from the scene's start on, and the IoU of each with the truth."""
    messages = [(at_ns, decode_detections(message)) for at_ns, message in taken]
    messages = [(at_ns, message) for at_ns, message in messages if message.stamp_ns >= played.start_ns]
    stamps = np.array([message.stamp_ns for _, message in messages], np.int64)
    latency_ms = _latencies(played, stamps, np.array([at_ns for at_ns, _ in messages], np.int64))
    iou = np.zeros(len(messages))
    for index, (_, message) in enumerate(messages):
        truth = scene.box((message.stamp_ns - played.start_ns) / NS_PER_US)
        if message.detections:
            iou[index] = message.detections[0].box.iou(truth)
    return _seconds(played, stamps), latency_ms, iou


def _seconds(played: Played, stamps: npt.NDArray[np.int64]) -> Seconds:
    return np.asarray((stamps - played.start_ns) / NS_PER_S, np.float64)


def _latencies(played: Played, stamps: npt.NDArray[np.int64], received_ns: npt.NDArray[np.int64]) -> Milliseconds:
    number = np.clip((stamps - played.start_ns) // played.message_ns, 0, len(played.published_ns) - 1)
    return np.asarray((received_ns - played.published_ns[number]) / NS_PER_MS, np.float64)
