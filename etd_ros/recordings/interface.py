"""What every recording offers, whatever its container."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np
import numpy.typing as npt

from etd_ros.errors import EtdError
from etd_ros.events import Events
from etd_ros.stream import StreamBatch, StreamConfig, StreamGuard
from msg_adapters import EventMessage, Layout, SensorClock, Triggers

BATCH_DURATION_NS = 10_000_000
BATCH_EVENTS_MAX = 65_536
FRAME_ID = "event_camera"


class RecordingError(EtdError):
    """A recording that is missing, damaged, of an unknown kind, or without events."""


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """One topic or data stream of a recording.

    Attributes:
        name: topic, or the stream's name in containers that are not bags.
        type_name: ROS 2 message type, or what the stream holds.
        count: messages, where the container says so without being read through.
        encoding: the events' encoding, for the event topic that is read.
    """

    name: str
    type_name: str
    count: int | None = None
    encoding: str | None = None


@dataclass(frozen=True, slots=True)
class RecordedMessage:
    """A bag's message as recorded.

    Attributes:
        receive_ns: when the recorder received it (ns).
        topic: the topic's name.
        type_name: the ROS 2 name of its type.
        layout: how `data` is serialised.
        data: the serialised message.
    """

    receive_ns: int
    topic: str
    type_name: str
    layout: Layout
    data: bytes


@dataclass(frozen=True, slots=True)
class RecordedImage:
    """A video frame.

    Attributes:
        stamp_ns: its time, on the events' clock (ns).
        frame_id: its coordinate frame.
        data: pixels, shape (height, width[, channel]); colours in OpenCV's order, blue first.
    """

    stamp_ns: int
    frame_id: str
    data: npt.NDArray[np.generic]


class Recording(ABC):
    """A recording, open for reading. Each iterator starts at the beginning, reads lazily and in bounded memory.

    Attributes:
        path: the file or folder.
        kind: the container, in words.
        topics: what it holds.
        topic: the event topic that is read; "" where the container has no topics.
        event_type: ROS 2 type of that topic's messages; "" where the container is no bag.
        width, height: sensor size (pixels).
        duration_ns: time from the first to the last message (ns), where known without reading all.
    """

    path: Path
    kind: str
    topics: tuple[TopicInfo, ...]
    topic: str = ""
    event_type: str = ""
    width: int
    height: int
    duration_ns: int | None = None

    @abstractmethod
    def packets(self) -> Iterator[EventMessage]:
        """The event messages in the order recorded, their times as the messages say.

        Raises:
            RecordingError: the file breaks off or is damaged, raised when the break is reached.
        """

    def events(self) -> Iterator[Events]:
        """Batches of events on the ROS clock; sensor time is mapped to it (msg_adapters.clock).

        Raises:
            RecordingError: see `packets`.
        """
        clock = SensorClock()
        for packet in self.packets():
            if len(packet.events):
                yield clock.to_ros(packet)

    def streams(self, config: StreamConfig | None = None) -> Iterator[StreamBatch]:
        """Batches on the ROS clock, split into streams exactly as the live nodes split the same messages.

        Raises:
            RecordingError: see `packets`.
        """
        clock, guard = SensorClock(), StreamGuard(config)
        for packet in self.packets():
            yield from guard.feed(clock.to_ros(packet), packet.seq, packet.encoding)

    def images(self) -> Iterator[RecordedImage]:
        """The video frames beside the events; none where the container holds none.

        Raises:
            RecordingError: see `packets`.
        """
        yield from ()

    def messages(self) -> Iterator[RecordedMessage]:
        """A bag's event and image messages as bytes, in the order received.

        Raises:
            RecordingError: see `packets`; the recording is not a bag.
        """
        msg = f"{self.path}: {self.kind} holds no ROS messages: read its events instead"
        raise RecordingError(msg)

    def items(self) -> Iterator[Events | RecordedImage]:
        """Events and images in the order of time; an image comes after all events before its stamp.

        Raises:
            RecordingError: see `packets`.
        """
        images = self.images()
        image = next(images, None)
        for batch in self.events():
            rest = batch
            while image is not None and len(rest) and int(rest.t[-1]) >= image.stamp_ns:
                before = rest[: int(np.searchsorted(rest.t, image.stamp_ns))]
                if len(before):
                    yield before
                yield image
                rest = rest[len(before) :]
                image = next(images, None)
            if len(rest):
                yield rest
        if image is not None:
            yield image
            yield from images

    def close(self) -> None:  # noqa: B027 - only containers that hold something open need it
        """Release what is held open."""

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self, error_type: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()


def file_packets(
    events: Events, encoding: str, *, triggers: Triggers | None = None, skipped_words: int = 0, off_sensor: int = 0
) -> Iterator[EventMessage]:
    """Events of a file without messages, cut into packets of at most 10 ms and 65,536 events.

    The counts go with the first packet, so that their sum over a recording stays right.
    """
    start = 0
    while start < len(events) or start == 0:
        part = events[start : start + BATCH_EVENTS_MAX]
        if len(part):
            part = part[: max(1, int(np.searchsorted(part.t, int(part.t[0]) + BATCH_DURATION_NS)))]
        yield EventMessage(
            stamp_ns=int(part.t[0]) if len(part) else 0,
            frame_id=FRAME_ID,
            seq=None,
            encoding=encoding,
            events=part,
            is_sensor_time=False,
            triggers=triggers if triggers is not None and start == 0 else Triggers.empty(),
            skipped_words=skipped_words if start == 0 else 0,
            off_sensor=off_sensor if start == 0 else 0,
        )
        start += max(1, len(part))


def on_sensor(events: Events) -> tuple[Events, int]:
    """The events that lie on the sensor, and how many do not."""
    inside = (events.x < events.width) & (events.y < events.height)
    dropped = len(events) - int(np.count_nonzero(inside))
    if not dropped:
        return events, 0
    kept = (events.t[inside], events.x[inside], events.y[inside], events.p[inside])
    return Events(*kept, events.width, events.height), dropped
