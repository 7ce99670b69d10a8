"""What our own figures are held against where no package does the same: the least that any solution must do."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.benchmarking.encoders import (
    ARRAY_LAYOUTS,
    NS_PER_S,
    ROS1_EVENT,
    ROS2_RECORD,
    ROS2_TAIL_BYTES,
    event_array_body_size,
    packet_content,
)
from etd_ros.benchmarking.measure import Subject
from etd_ros.events import Events

BARE_MAP = "bare last-event map"
NUMPY = "NumPy"

Columns = tuple[npt.NDArray[np.int64], npt.NDArray[np.uint16], npt.NDArray[np.uint16], npt.NDArray[np.uint8]]


def bare_map(messages: Sequence[Events]) -> Subject:
    """Writing each event's time into a map of pixel and polarity: no checks, no frames, no trigger."""
    first = messages[0]
    last_ns = np.zeros((first.height, first.width, 2), np.int64)

    def run() -> None:
        for events in messages:
            _store(last_ns, events.t, events.x, events.y, events.p)

    return Subject(BARE_MAP, run, sum(map(len, messages)))


def numpy_decoder(what: str, messages: Sequence[bytes], counts: Sequence[int]) -> Subject:
    """Whole-array NumPy decoding of an encoding of `NUMPY_DECODERS`, without any checks.

    Finding the events in the messages is not timed.

    Args:
        what: the encoding, as in the rows.
        messages: the serialised messages.
        counts: the number of events in each.
    """
    decode = NUMPY_DECODERS[what]
    bodies = event_bodies(what, messages, counts)

    def run() -> None:
        for time_base_ns, body in bodies:
            decode(time_base_ns, body)

    return Subject(NUMPY, run, sum(counts))


def event_bodies(what: str, messages: Sequence[bytes], counts: Sequence[int]) -> list[tuple[int, bytes]]:
    """(time base in ns, bytes of the events) of each message; EventArrays need no time base: 0."""
    if what not in ARRAY_LAYOUTS:
        return [packet_content(message) for message in messages]
    sizes = (event_array_body_size(count, ARRAY_LAYOUTS[what]) for count in counts)
    return [(0, message[len(message) - size :]) for message, size in zip(messages, sizes, strict=True)]


def _libcaer(base_ns: int, body: bytes) -> Columns:
    words = np.frombuffer(body, "<u4").reshape(-1, 2)
    data = words[:, 0]
    t = base_ns + 1000 * words[:, 1].astype(np.int64)
    return t, (data >> 17).astype(np.uint16), (data >> 2 & 0x7FFF).astype(np.uint16), (data >> 1 & 1).astype(np.uint8)


def _mono(base_ns: int, body: bytes) -> Columns:
    fields = np.frombuffer(body, [("dt", "<u4"), ("x", "<u2"), ("y", "<u2")])
    t = base_ns + fields["dt"].astype(np.int64)
    return t, fields["x"].copy(), (fields["y"] & 0x7FFF).astype(np.uint16), (fields["y"] >> 15).astype(np.uint8)


def _event_array_ros1(_: int, body: bytes) -> Columns:
    records = np.frombuffer(body, ROS1_EVENT)
    return _time_ns(records), records["x"].copy(), records["y"].copy(), records["polarity"].copy()


def _event_array_ros2(_: int, body: bytes) -> Columns:
    records = np.frombuffer(body + bytes(ROS2_TAIL_BYTES), ROS2_RECORD)
    x, y = np.empty(len(records), np.uint16), records["y"].copy()
    x[0], x[1:], y[0] = records["y"][0], records["next_x"][:-1], records["first_y"][0]
    return _time_ns(records), x, y, records["polarity"].copy()


def _time_ns(records: npt.NDArray[np.void]) -> npt.NDArray[np.int64]:
    time_ns: npt.NDArray[np.int64] = records["sec"].astype(np.int64) * NS_PER_S + records["nsec"]
    return time_ns


NUMPY_DECODERS: dict[str, Callable[[int, bytes], Columns]] = {
    "libcaer": _libcaer,
    "mono": _mono,
    "event_array_ros1": _event_array_ros1,
    "event_array_ros2": _event_array_ros2,
}


@njit(cache=True, nogil=True)
def _store(last_ns, t, x, y, p):  # type: ignore[no-untyped-def]
    for i in range(len(t)):
        last_ns[y[i], x[i], p[i]] = t[i]
