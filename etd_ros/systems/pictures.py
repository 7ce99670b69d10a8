"""The pictures that systems are given: video frames as recorded, reconstructions, ATSLTD frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.engine import FrameSource
from etd_ros.events import Events
from etd_ros.per_sensor import PerSensor
from etd_ros.reconstruction import HighPassFilter
from etd_ros.recordings.interface import RecordedImage
from etd_ros.settings import Settings
from etd_ros.stream import StreamBatch
from etd_ros.systems.interface import CompareError, Picture

RECONSTRUCTION_NS = 10_000_000
"""Reconstructions are made at 100 Hz."""


@dataclass(frozen=True, slots=True)
class Given:
    """What a picture tracker is given.

    Attributes:
        stamp_ns: the picture's time (ns).
        picture: for the tracker, uint8, shape (h, w) or (h, w, 3).
        shown: for those who look on: the same, or the ATSLTD frame of which it is made, uint8, shape (h, w, 2).
    """

    stamp_ns: int
    picture: Picture
    shown: npt.NDArray[np.uint8]


def video_pictures(images: Iterable[RecordedImage], width: int, height: int, name: str) -> Iterator[Given]:
    """A recording's video frames.

    Args:
        images: the frames, grey or colour, 8 or 16 bits.
        width: sensor width (pixels).
        height: sensor height (pixels).
        name: the system's, for the errors.

    Raises:
        CompareError: one is of another size than the sensor, or no picture.
    """
    for image in images:
        if image.data.shape[:2] != (height, width):
            rows, columns = image.data.shape[:2]
            msg = (
                f"system {name!r}: the video is {columns}x{rows}, the sensor {width}x{height}, so that boxes on its "
                "pixels do not fit: choose a system that is fed with events"
            )
            raise CompareError(msg)
        picture = _eight_bits(image, name)
        yield Given(image.stamp_ns, picture, picture)


def _eight_bits(image: RecordedImage, name: str) -> Picture:
    """The frame as uint8, shape (h, w) or (h, w, 3); of 16 bits the upper 8."""
    data = image.data[..., 0] if image.data.ndim == 3 and image.data.shape[2] == 1 else image.data
    if data.dtype not in (np.uint8, np.uint16) or not (data.ndim == 2 or (data.ndim == 3 and data.shape[2] == 3)):
        msg = (
            f"system {name!r}: the image at {image.stamp_ns} ns is {data.dtype} {data.shape}, no grey or colour "
            "picture: name a recording with mono8, bgr8 or mono16 images"
        )
        raise CompareError(msg)
    return np.ascontiguousarray(data if data.dtype == np.uint8 else data.astype(np.uint16) >> 8, np.uint8)


class Reconstructions:
    """High-pass reconstructions (`settings.reconstruction`) every 10 ms from the stream's first event on. The image at
    T holds the events with t < T."""

    def __init__(self, width: int, height: int, settings: Settings) -> None:
        self._filter = HighPassFilter(width, height, settings.reconstruction)
        self._next_ns: int | None = None

    def pictures(self, events: Events) -> Iterator[Given]:
        """The images that this batch finishes."""
        if self._next_ns is None:
            self._next_ns = int(events.t[0]) + RECONSTRUCTION_NS
        while self._next_ns <= events.t[-1]:
            end = int(np.searchsorted(events.t, self._next_ns))
            self._filter.integrate(events[:end])
            events = events[end:]
            image = self._filter.image(self._next_ns)
            yield Given(self._next_ns, image, image)
            self._next_ns += RECONSTRUCTION_NS
        self._filter.integrate(events)

    def reset(self) -> None:
        """Start a new stream."""
        self._filter.reset()
        self._next_ns = None


def reconstructions(batches: Iterable[StreamBatch], settings: Settings) -> Iterator[Given]:
    """The events as images at 100 Hz."""
    stages = PerSensor(lambda width, height: Reconstructions(width, height, settings))
    for batch in batches:
        yield from stages.at(batch).pictures(batch.events)


def atsltd_pictures(batches: Iterable[StreamBatch], settings: Settings) -> Iterator[Given]:
    """The events as ATSLTD frames, grey: the stronger of the two channels at each pixel."""
    stages = PerSensor(lambda width, height: FrameSource("atsltd", width, height, settings))
    for batch in batches:
        for frame in stages.at(batch).frames(batch.events):
            on, off = cv2.split(frame.data)
            grey: Any = cv2.max(on, off)
            yield Given(frame.stamp_ns, grey, frame.data)


PICTURES_OF_EVENTS: dict[str, Callable[[Iterable[StreamBatch], Settings], Iterator[Given]]] = {
    "reconstruction": reconstructions,
    "atsltd": atsltd_pictures,
}
"""How events become pictures, by what a system is fed with."""
