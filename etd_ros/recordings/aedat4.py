"""AEDAT4 files, decoded packet by packet by the `aedat` package."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import aedat
import numpy as np

from etd_ros.events import Events, check_pixel_map
from etd_ros.recordings.interface import (
    FRAME_ID,
    RecordedImage,
    Recording,
    RecordingError,
    TopicInfo,
    file_packets,
    on_sensor,
)
from msg_adapters import EventMessage

ENCODING = "aedat4"
NS_PER_US = 1000
TIME_MAX_US = (2**63 - 1) // NS_PER_US


class Aedat4Recording(Recording):
    """The first event stream of an AEDAT4 file, and its first stream of frames.

    Missing and truncated files are errors; bytes changed inside a packet can make the decoder itself end the process.

    Raises:
        RecordingError: no AEDAT4 file, or one without events.
    """

    kind = "AEDAT4"

    def __init__(self, path: Path) -> None:
        self.path = path
        streams = self._translated(lambda: self._decoder().id_to_stream())
        self._event_stream = _first(streams, "events")
        self._frame_stream = _first(streams, "frame")
        if self._event_stream is None:
            held = ", ".join(sorted({stream["type"] for stream in streams.values()})) or "nothing"
            msg = f"{path}: no event stream; it holds {held}: record the camera's events"
            raise RecordingError(msg)
        size = streams[self._event_stream]
        self.width, self.height = int(size["width"]), int(size["height"])
        check_pixel_map(self.width, self.height)
        self.topics = tuple(
            TopicInfo(str(key), stream["type"], encoding=ENCODING if key == self._event_stream else None)
            for key, stream in sorted(streams.items())
        )

    def packets(self) -> Iterator[EventMessage]:
        for packet in self._packets_of(self._event_stream):
            array = packet["events"]
            if len(array) and int(array["t"].max()) > TIME_MAX_US:
                msg = f"{self.path}: damaged: an event time of {int(array['t'].max())} us: copy the file again"
                raise RecordingError(msg)
            t = array["t"].astype(np.int64) * NS_PER_US
            x, y = np.ascontiguousarray(array["x"]), np.ascontiguousarray(array["y"])
            events, dropped = on_sensor(Events(t, x, y, array["on"].astype(np.uint8), self.width, self.height))
            yield from file_packets(events, ENCODING, off_sensor=dropped)

    def images(self) -> Iterator[RecordedImage]:
        if self._frame_stream is None:
            return
        for packet in self._packets_of(self._frame_stream):
            frame = packet["frame"]
            yield RecordedImage(int(frame["exposure_begin_t"]) * NS_PER_US, FRAME_ID, frame["pixels"])

    def _packets_of(self, stream: int | None) -> Iterator[dict[str, Any]]:
        decoder = self._translated(self._decoder)
        while (packet := self._translated(partial(next, decoder, None))) is not None:
            if packet["stream_id"] == stream:
                yield packet

    def _decoder(self) -> Any:
        return aedat.Decoder(str(self.path))

    def _translated(self, read: Callable[[], Any]) -> Any:
        try:
            return read()
        except (KeyboardInterrupt, SystemExit):
            raise
        # The decoder's panics derive from BaseException.
        except BaseException as err:
            msg = f"{self.path}: truncated or damaged AEDAT4 ({err}): copy the file again"
            raise RecordingError(msg) from err


def _first(streams: dict[int, dict[str, Any]], kind: str) -> int | None:
    return next((key for key, stream in sorted(streams.items()) if stream["type"] == kind), None)
