"""The pictures that are labelled: a recording's video frames, or intensity images reconstructed from its events."""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from types import TracebackType
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.labelling.interpolation import StampArray
from etd_ros.labelling.key_frames import LabellingError
from etd_ros.reconstruction import HighPassConfig, HighPassFilter, SynchronisedReconstruction
from etd_ros.recordings import Recording

PictureKind = Literal["video", "reconstruction"]

PICTURES_MAX = 200_000
RATE_HZ_MAX = 1000.0
NS_PER_S = 1e9

TimedImage = tuple[int, npt.NDArray[np.generic]]
"""Stamp (ns) and pixels, shape (height, width[, channel])."""


class Pictures:
    """PNG pictures in a temporary file, to be used as a context manager: any of them at once, however many there are.

    Attributes:
        kind: what they are.
        stamps: their times in ascending order (ns), int64, shape (n,), on the events' clock.
        width, height: their size, that of the sensor (pixels).
    """

    def __init__(self, kind: PictureKind, width: int, height: int) -> None:
        self.kind = kind
        self.width, self.height = width, height
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 - closed by the context manager that this is
        self._stamps: list[int] = []
        self._ends = [0]

    @property
    def stamps(self) -> StampArray:
        return np.array(self._stamps, np.int64)

    def __len__(self) -> int:
        return len(self._stamps)

    def add(self, stamp_ns: int, image: npt.NDArray[np.generic]) -> None:
        """Append a picture. One that is not later than the last is left out: it starts another pass of a loop.

        Raises:
            LabellingError: too many, or there is no room for them.
        """
        if self._stamps and stamp_ns <= self._stamps[-1]:
            return
        if len(self) >= PICTURES_MAX:
            msg = f"more than {PICTURES_MAX} pictures: cut the recording, or give a lower --rate"
            raise LabellingError(msg)
        png = cv2.imencode(".png", _eight_bit(image))[1].tobytes()
        try:
            self._file.write(png)
        except OSError as err:
            msg = f"pictures cannot be kept in {tempfile.gettempdir()} ({err.strerror or err}): free space there"
            raise LabellingError(msg) from err
        self._stamps.append(stamp_ns)
        self._ends.append(self._ends[-1] + len(png))

    def finish(self) -> None:
        """Have all that was added ready for `png`."""
        self._file.flush()

    def png(self, index: int) -> bytes:
        """A picture, from 0 on; may be called from several threads at once.

        Raises:
            IndexError: there is none of this number.
        """
        if not 0 <= index < len(self):
            msg = f"picture {index} of {len(self)}"
            raise IndexError(msg)
        start, end = self._ends[index], self._ends[index + 1]
        return os.pread(self._file.fileno(), end - start, start)

    def __enter__(self) -> Pictures:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._file.close()


def make_pictures(recording: Recording, kind: PictureKind | None = None, *, rate_hz: float = 30.0) -> Pictures:
    """All pictures of a recording.

    Args:
        recording: an open recording.
        kind: what to show; None takes video frames where there are any.
        rate_hz: how many reconstructions a second.

    Raises:
        LabellingError: no picture, video frames of another size than the sensor, or a rate out of range.
        RecordingError: the recording is damaged.
    """
    if not 0 < rate_hz <= RATE_HZ_MAX:
        msg = f"--rate {rate_hz:g} is out of range (0, {RATE_HZ_MAX:g}]: give pictures a second"
        raise LabellingError(msg)
    if kind is None:
        kind = "reconstruction" if next(recording.images(), None) is None else "video"
    with ExitStack() as stack:
        pictures = stack.enter_context(Pictures(kind, recording.width, recording.height))
        for stamp_ns, image in _video(recording) if kind == "video" else reconstructions(recording, rate_hz):
            pictures.add(stamp_ns, image)
        if not len(pictures):
            cure = "--on reconstruction" if kind == "video" else "a higher --rate"
            msg = f"{recording.path}: no {kind} picture to label: try {cure}"
            raise LabellingError(msg)
        pictures.finish()
        stack.pop_all()
    return pictures


def reconstructions(recording: Recording, rate_hz: float) -> Iterator[TimedImage]:
    """Intensity images at a constant rate from the first event on, as far as time does not step back."""
    reconstruction = SynchronisedReconstruction(HighPassFilter(recording.width, recording.height, HighPassConfig()))
    first_ns = last_ns = None
    count = 1
    for batch in recording.events():
        first_ns = int(batch.t[0]) if first_ns is None else first_ns
        if last_ns is not None and int(batch.t[0]) < last_ns:
            return
        last_ns = int(batch.t[-1])
        reconstruction.push(batch)
        due = math.floor((last_ns - first_ns) * rate_hz / NS_PER_S)
        if due - count > PICTURES_MAX:
            msg = f"{recording.path}: more than {PICTURES_MAX} pictures: cut the recording, or give a lower --rate"
            raise LabellingError(msg)
        for number in range(count, due + 1):
            reconstruction.request(first_ns + round(number * NS_PER_S / rate_hz))
        count = max(count, due + 1)
        yield from reconstruction.ready()


def _video(recording: Recording) -> Iterator[TimedImage]:
    for image in recording.images():
        height, width = image.data.shape[:2]
        if (width, height) != (recording.width, recording.height):
            msg = (
                f"{recording.path}: video frames of {width}x{height} beside a sensor of "
                f"{recording.width}x{recording.height}: label with --on reconstruction, whose pixels are the events'"
            )
            raise LabellingError(msg)
        yield image.stamp_ns, image.data


def _eight_bit(image: npt.NDArray[np.generic]) -> npt.NDArray[np.uint8]:
    """As PNG shows it: 16-bit pixels by their upper byte, two channels (On and Off) by the brighter one."""
    pixels = np.asarray(image)
    if pixels.dtype == np.uint16:
        pixels = pixels >> np.uint16(8)
    if pixels.ndim == 3 and pixels.shape[2] == 2:
        pixels = pixels.max(axis=2)
    return np.ascontiguousarray(pixels, np.uint8)
