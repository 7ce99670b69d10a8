"""Tracks from a bag of what the nodes published: everything that belongs to one stamp, joined again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
import numpy.typing as npt
from rosbags.rosbag2 import Reader

from etd_ros.tracking import TargetReport, TargetState
from msg_adapters import (
    DetectionsMessage,
    DiagnosticsMessage,
    ImageMessage,
    Layout,
    decode_detections,
    decode_diagnostics,
    decode_image,
)

FRAMES = "/accumulator/frames"
IMAGES = "/reconstruction/image_raw"
DETECTIONS = "/tracker/detections"
STATUS = "/tracker/status"

MessageT = TypeVar("MessageT", ImageMessage, DetectionsMessage)


@dataclass(frozen=True, slots=True)
class TrackedFrame:
    """Everything that belongs to one stamp.

    Attributes:
        stamp_ns: the frame's time (ns).
        reports: the targets' states.
        frame: uint8, shape (h, w, 2); None where the recorder missed it.
        image: the intensity image, uint8, shape (h, w), where there is one.
    """

    stamp_ns: int
    reports: tuple[TargetReport, ...]
    frame: npt.NDArray[np.uint8] | None
    image: npt.NDArray[np.uint8] | None


def recorded_tracks(bag: Path) -> Iterator[TrackedFrame]:
    """What the tracker said of each frame, in order; lazily and in bounded memory."""
    frames = _Stamped(bag, FRAMES, _decode_picture)
    images = _Stamped(bag, IMAGES, _decode_picture)
    detections = _Stamped(bag, DETECTIONS, decode_detections)
    for status in map(decode_diagnostics, _messages(bag, STATUS)):
        frame, image = frames.at(status.stamp_ns), images.at(status.stamp_ns)
        yield TrackedFrame(
            stamp_ns=status.stamp_ns,
            reports=_reports(status, detections.at(status.stamp_ns)),
            frame=frame.data if frame else None,
            image=image.data if image else None,
        )


class _Stamped(Generic[MessageT]):
    """A topic's messages, found by stamps that are asked for in order."""

    def __init__(self, bag: Path, topic: str, decode: Callable[[bytes], MessageT]) -> None:
        self._messages: Iterator[MessageT] = map(decode, _messages(bag, topic))
        self._next: MessageT | None = next(self._messages, None)

    def at(self, stamp_ns: int) -> MessageT | None:
        """The message with this stamp; None where there is none."""
        while self._next is not None and self._next.stamp_ns < stamp_ns:
            self._next = next(self._messages, None)
        return self._next if self._next is not None and self._next.stamp_ns == stamp_ns else None


def _messages(bag: Path, topic: str) -> Iterator[bytes]:
    # A reader for each topic: a reader keeps one place in its file, whoever iterates.
    with Reader(bag) as reader:
        connections = [connection for connection in reader.connections if connection.topic == topic]
        if connections:
            yield from (bytes(data) for _, _, data in reader.messages(connections))


def _decode_picture(message: bytes) -> ImageMessage:
    return decode_image(message, Layout.ROS2)


def _reports(status: DiagnosticsMessage, detections: DetectionsMessage | None) -> tuple[TargetReport, ...]:
    boxes = {item.id: item.box for item in detections.detections} if detections else {}
    values = [dict(target.values) for target in status.statuses]
    return tuple(
        TargetReport(value["target"], TargetState(value["state"]), boxes.get(value["target"]), float(value["score"]))
        for value in values
    )
