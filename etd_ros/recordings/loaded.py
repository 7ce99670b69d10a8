"""Recordings held in memory, for whoever goes through one many times or starts in the middle of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np

from etd_ros.events import Events
from etd_ros.recordings.interface import RecordedImage, Recording, RecordingError
from etd_ros.stream import StreamBatch, StreamConfig, StreamGuard
from msg_adapters import SensorClock


class EventSource(Protocol):
    """Events of one sensor and the video frames beside them: what trackers need of a `Recording`, in memory or not.

    Attributes:
        width, height: sensor size (pixels).
    """

    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...

    def streams(self, config: StreamConfig | None = None) -> Iterator[StreamBatch]:
        """Batches on the ROS clock, split into streams; each call starts at the beginning."""
        ...

    def images(self) -> Iterator[RecordedImage]:
        """The video frames in order of time; each call starts at the beginning."""
        ...


Packet = tuple[Events, "int | None", "str | None"]
"""A decoded message: its events on the ROS clock, its sequence number and its encoding, where they are known."""


class LoadedRecording:
    """An `EventSource` whose events and images are in memory, 13 bytes an event.

    Args:
        packets: one or more decoded messages in the order recorded; also those without events, as their numbers tell
            that no message was lost.
        images: the video frames in order of time.
    """

    def __init__(self, packets: list[Packet], images: list[RecordedImage]) -> None:
        self._packets = packets
        self._images = images
        first, _, _ = packets[0]
        self.width, self.height = first.width, first.height

    @classmethod
    def load(cls, recording: Recording) -> LoadedRecording:
        """All of a recording, once decoded.

        Raises:
            RecordingError: it is damaged, or holds no events.
        """
        clock = SensorClock()
        packets: list[Packet] = [(clock.to_ros(packet), packet.seq, packet.encoding) for packet in recording.packets()]
        if not any(len(events) for events, _, _ in packets):
            msg = f"{recording.path}: holds no events: record while something moves before the camera"
            raise RecordingError(msg)
        return cls(packets, list(recording.images()))

    @property
    def events(self) -> int:
        """Number of events held."""
        return sum(len(events) for events, _, _ in self._packets)

    def streams(self, config: StreamConfig | None = None) -> Iterator[StreamBatch]:
        """Batches on the ROS clock, split into streams as those of the recording are."""
        guard = StreamGuard(config)
        for events, seq, encoding in self._packets:
            yield from guard.feed(events, seq, encoding)

    def images(self) -> Iterator[RecordedImage]:
        """The video frames in order of time."""
        return iter(self._images)

    def since(self, stamp_ns: int) -> LoadedRecording:
        """The events and images from a time (ns) on; nothing is copied.

        Raises:
            RecordingError: there are no events from then on.
        """
        packets: list[Packet] = []
        for events, seq, encoding in self._packets:
            rest = events[int(np.searchsorted(events.t, stamp_ns)) :]
            if packets or len(rest):
                packets.append((rest, seq, encoding))
        if not packets:
            msg = f"the recording holds no events from {stamp_ns} ns on: start earlier"
            raise RecordingError(msg)
        return LoadedRecording(packets, [image for image in self._images if image.stamp_ns >= stamp_ns])
