"""What a system is given of a recording, and the time that goes by with reading it."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

import numpy as np

from etd_ros.recordings.interface import RecordedImage
from etd_ros.recordings.loaded import EventSource, LoadedRecording
from etd_ros.stream import StreamBatch, StreamConfig
from etd_ros.systems.interface import CompareError

T = TypeVar("T")


class Stopwatch:
    """Measures what a system takes for its steps, without the time in which it waits for what it is given."""

    def __init__(self) -> None:
        self._waiting_s = 0.0

    def waiting(self, items: Iterable[T]) -> Iterator[T]:
        """The same items; the time that they take does not count."""
        iterator = iter(items)
        while True:
            start_s = time.perf_counter()
            try:
                item = next(iterator)
            except StopIteration:
                return
            finally:
                self._waiting_s += time.perf_counter() - start_s
            yield item

    def steps(self, made: Iterable[T]) -> Iterator[tuple[T, float]]:
        """What is made of these items, each with the time that it took (s)."""
        iterator = iter(made)
        while True:
            start_s, waiting_s = time.perf_counter(), self._waiting_s
            try:
                item = next(iterator)
            except StopIteration:
                return
            yield item, time.perf_counter() - start_s - (self._waiting_s - waiting_s)


class SourceSince:
    """An `EventSource` that passes over what comes before a time (ns)."""

    def __init__(self, source: EventSource, stamp_ns: int) -> None:
        self._source = source
        self._stamp_ns = stamp_ns
        self.width, self.height = source.width, source.height

    def streams(self, config: StreamConfig | None = None) -> Iterator[StreamBatch]:
        for batch in self._source.streams(config):
            rest = batch.events[int(np.searchsorted(batch.events.t, self._stamp_ns)) :]
            if len(rest):
                yield dataclasses.replace(batch, events=rest)

    def images(self) -> Iterator[RecordedImage]:
        return (image for image in self._source.images() if image.stamp_ns >= self._stamp_ns)


def since(source: EventSource, stamp_ns: int) -> EventSource:
    """The events and images of a source from a time (ns) on.

    Raises:
        RecordingError: a recording in memory has no events from then on.
    """
    return source.since(stamp_ns) if isinstance(source, LoadedRecording) else SourceSince(source, stamp_ns)


def one_stream(batches: Iterable[StreamBatch], name: str) -> Iterator[StreamBatch]:
    """Batches of one sensor whose times never decrease, as they come from the streams of a recording.

    Compared systems know nothing of streams that end: lost messages are a pause to them.

    Args:
        batches: a recording's streams.
        name: the system's, for the error.

    Raises:
        CompareError: the sensor size changes, or time goes back.
    """
    last: StreamBatch | None = None
    for batch in batches:
        events = batch.events
        if last is not None and (events.width, events.height) != (last.events.width, last.events.height):
            msg = (
                f"system {name!r}: the sensor size changes from {last.events.width}x{last.events.height} to "
                f"{events.width}x{events.height} at {events.t[0]} ns: cut the recording there"
            )
            raise CompareError(msg)
        if last is not None and events.t[0] < last.events.t[-1]:
            msg = (
                f"system {name!r}: time goes back from {last.events.t[-1]} to {events.t[0]} ns: cut the recording there"
            )
            raise CompareError(msg)
        yield batch
        last = batch
