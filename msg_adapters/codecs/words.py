"""What all codecs share: the result, the conversion of bytes to words, and tables of bits for the mask words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from etd_ros.events import Events
from msg_adapters.layout import MessageError

Payload: TypeAlias = "bytes | bytearray | memoryview | npt.NDArray[Any]"
"""Encoded words as contiguous bytes."""

Columns: TypeAlias = (
    "tuple[npt.NDArray[np.int64], npt.NDArray[np.uint16], npt.NDArray[np.uint16], npt.NDArray[np.uint8]]"
)
"""The arrays t, x, y, p that a kernel fills."""

TriggerColumns: TypeAlias = "tuple[npt.NDArray[np.int64], npt.NDArray[np.uint16], npt.NDArray[np.uint8]]"
"""The arrays t, id, edge that a kernel fills."""

MASK_BITS_MAX = 12
BITS_SET = np.array([bin(mask).count("1") for mask in range(1 << MASK_BITS_MAX)], np.uint8)
"""Number of set bits of every 12-bit mask."""

LOWEST_BIT = np.array([max((mask & -mask).bit_length() - 1, 0) for mask in range(1 << MASK_BITS_MAX)], np.uint8)
"""Index of the lowest set bit of every 12-bit mask but 0."""


@dataclass(frozen=True, slots=True)
class Triggers:
    """Edges seen at the camera's trigger inputs.

    Attributes:
        t: time (ns) on the clock of the message's events, int64, shape (n,).
        id: input, uint16, shape (n,).
        edge: 1 rising, 0 falling; uint8, shape (n,).
    """

    t: npt.NDArray[np.int64]
    id: npt.NDArray[np.uint16]
    edge: npt.NDArray[np.uint8]

    @classmethod
    def empty(cls) -> Triggers:
        return cls(*trigger_columns(0))

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, slots=True)
class DecodedWords:
    """What one payload held.

    Attributes:
        events: the events on the sensor, in the order sent.
        triggers: the trigger edges.
        skipped_words: words of no known meaning.
        off_sensor: events dropped since they lie outside the sensor.
    """

    events: Events
    triggers: Triggers
    skipped_words: int = 0
    off_sensor: int = 0


class WordDecoder(Protocol):
    """A codec. Decoders of stateful encodings go on where the last payload ended."""

    is_sensor_time: ClassVar[bool]
    """Whether the words carry the camera's own time only, which starts near 0."""

    def decode(self, payload: Payload, width: int, height: int, time_base_ns: int = 0) -> DecodedWords:
        """The events of a payload of whole words.

        Raises:
            MessageError: the payload ends inside a word.
        """

    def reset(self) -> None:
        """Forget everything that earlier payloads said."""


def as_words(payload: Payload, dtype: str) -> npt.NDArray[Any]:
    """A payload as an aligned, writable array of words.

    It is copied: payloads start at any byte of a message, and one kind of array means one compiled kernel.

    Raises:
        MessageError: the payload ends inside a word.
    """
    data = memoryview(cast("bytes", payload)).cast("B")
    size = np.dtype(dtype).itemsize
    if len(data) % size:
        msg = (
            f"message cut short: {len(data)} bytes of events end inside a word of {size} bytes; "
            "get the whole message, or check its encoding"
        )
        raise MessageError(msg)
    return np.frombuffer(data, dtype).copy()


def event_columns(capacity: int) -> Columns:
    """Uninitialised arrays for up to `capacity` events."""
    return (
        np.empty(capacity, np.int64),
        np.empty(capacity, np.uint16),
        np.empty(capacity, np.uint16),
        np.empty(capacity, np.uint8),
    )


def trigger_columns(capacity: int) -> TriggerColumns:
    """Uninitialised arrays for up to `capacity` triggers."""
    return np.empty(capacity, np.int64), np.empty(capacity, np.uint16), np.empty(capacity, np.uint8)


def filled_events(columns: Columns, count: int, width: int, height: int) -> Events:
    """The first `count` events of the arrays, as views."""
    t, x, y, p = columns
    return Events(t[:count], x[:count], y[:count], p[:count], width, height)


def filled_triggers(columns: TriggerColumns, count: int) -> Triggers:
    """The first `count` triggers of the arrays, as views."""
    t, identifier, edge = columns
    return Triggers(t[:count], identifier[:count], edge[:count])
