"""What all codecs share: the result, the conversion of bytes to words, and the arrays that events are decoded to."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from etd_ros.borrowing_kernel import borrowing_kernel
from etd_ros.buffers import LENGTH_SHORT, ArrayPool, Arrays
from etd_ros.events import Events
from msg_adapters.layout import MessageError

Payload: TypeAlias = "bytes | bytearray | memoryview | npt.NDArray[Any]"
"""Encoded words as contiguous bytes."""

TriggerColumns: TypeAlias = "tuple[npt.NDArray[np.int64], npt.NDArray[np.uint16], npt.NDArray[np.uint8]]"
"""The arrays t, id, edge that a kernel fills."""

WORD_16, WORD_32, WORD_64 = (np.dtype([("word", code)]) for code in ("<u2", "<u4", "<i8"))
"""Words as packed records of one field. Payloads start at any byte of a message, and the fields of packed records may:
one compiled kernel reads them all, without a copy. (64-bit words are signed because compiled code makes a float of an
unsigned and a signed integer.)"""


MESSAGE_EVENTS_MAX = 1 << 25
"""Events that one message may hold: they take 0.4 GiB, and a mask of 2 bytes may claim 12 of them."""


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

    def __init__(self, t: npt.NDArray[np.int64], id: npt.NDArray[np.uint16], edge: npt.NDArray[np.uint8]) -> None:  # noqa: A002
        # What the generated method does, in half its time, as in `Events`.
        _set_t(self, t)
        _set_id(self, id)
        _set_edge(self, edge)

    @classmethod
    def empty(cls) -> Triggers:
        """No trigger; the arrays are shared."""
        return _NO_TRIGGERS

    def __len__(self) -> int:
        return len(self.t)


_set_t, _set_id, _set_edge = (getattr(Triggers, field.name).__set__ for field in dataclasses.fields(Triggers))


class DecodedWords(NamedTuple):
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
            MessageError: the payload ends inside a word, or may hold more than `MESSAGE_EVENTS_MAX` events.
        """

    def reset(self) -> None:
        """Forget everything that earlier payloads said."""


def as_words(payload: Payload, dtype: np.dtype[Any]) -> npt.NDArray[Any]:
    """A payload as a read-only array of one of the dtypes above, not copied.

    Raises:
        MessageError: the payload ends inside a word.
    """
    # Read-only whatever the source, so that compiled kernels see one type of array.
    is_read_only = isinstance(payload, bytes) or (isinstance(payload, memoryview) and payload.readonly)
    data = payload if is_read_only else memoryview(cast("bytes", payload)).toreadonly()
    try:
        return np.frombuffer(data, dtype)
    except ValueError as err:
        size = memoryview(cast("bytes", payload)).nbytes
        msg = (
            f"message cut short: {size} bytes of events end inside a word of {dtype.itemsize} bytes; "
            "get the whole message, or check its encoding"
        )
        raise MessageError(msg) from err


def bits_set(mask_bits: int) -> npt.NDArray[np.uint64]:
    """Number of set bits of every mask of `mask_bits` bits, shape (2^mask_bits,)."""
    return np.array([bin(mask).count("1") for mask in range(1 << mask_bits)], np.uint64)


def set_bits(mask_bits: int) -> npt.NDArray[np.uint8]:
    """Indices of the set bits of every mask from the lowest on, then zeros; shape (2^mask_bits, mask_bits)."""
    is_set = np.arange(1 << mask_bits)[:, None] >> np.arange(mask_bits) & 1
    order = np.argsort(1 - is_set, axis=1, kind="stable")
    return np.where(np.sort(is_set, axis=1)[:, ::-1], order, 0).astype(np.uint8)


class EventPool(ArrayPool):
    """Arrays t, x, y, p that a decoder fills with events."""

    def __init__(self) -> None:
        super().__init__(np.int64, np.uint16, np.uint16, np.uint8)

    def reserve(self, length: int) -> Arrays:
        """See `ArrayPool.reserve`.

        Raises:
            MessageError: so many events that they are refused rather than given memory.
        """
        if length > MESSAGE_EVENTS_MAX:
            msg = f"the message may hold {length} events, more than {MESSAGE_EVENTS_MAX}: send them in smaller messages"
            raise MessageError(msg)
        return super().reserve(length)

    def reserve_for_words(self, word_count: int, events_per_word_max: int) -> Arrays:
        """Arrays that are long enough for this many words, or, where the words are many, if few of them have more than
        one event.

        For many words the memory would count, and a kernel that is called again with longer arrays does not.
        """
        capacity = word_count * events_per_word_max + 1
        if capacity <= LENGTH_SHORT:
            # The usual case, without asking once more.
            return ArrayPool.reserve(self, capacity)
        return self.reserve(word_count + 1)


def trigger_columns(capacity: int) -> TriggerColumns:
    """Uninitialised arrays t, id, edge for up to `capacity` triggers; they are few, so each message has its own."""
    if not capacity:
        return _NO_TRIGGER_COLUMNS
    return np.empty(capacity, np.int64), np.empty(capacity, np.uint16), np.empty(capacity, np.uint8)


def events_on_sensor(columns: Arrays, count: int, off_sensor: int, width: int, height: int) -> Events:
    """The events on the sensor among the first `count` of the arrays, as views; the others are overwritten.

    Args:
        columns: the arrays.
        count: the number of events in them.
        off_sensor: how many of those lie outside the sensor.
        width: sensor width (pixels).
        height: sensor height (pixels).
    """
    t, x, y, p = columns
    if off_sensor:
        _keep_on_sensor(t, x, y, p, count, width, height)
        count -= off_sensor
    first = slice(count)
    return Events(t[first], x[first], y[first], p[first], width, height)


def first_triggers(columns: TriggerColumns, count: int) -> Triggers:
    """The first `count` triggers of the arrays, as views."""
    if not count:
        return _NO_TRIGGERS
    t, identifier, edge = columns
    return Triggers(t[:count], identifier[:count], edge[:count])


_NO_TRIGGER_COLUMNS: TriggerColumns = np.empty(0, np.int64), np.empty(0, np.uint16), np.empty(0, np.uint8)
_NO_TRIGGERS = Triggers(*_NO_TRIGGER_COLUMNS)


@borrowing_kernel
def count_off_sensor(x, y, count, width, height):  # type: ignore[no-untyped-def]
    """How many of the first `count` events lie outside the sensor.

    To ask once, of all events at a time, costs next to nothing; to ask while decoding would cost more than decoding.
    """
    column_end, row_end = np.uint16(width), np.uint16(height)
    off_sensor = 0
    for i in range(count):
        off_sensor += (x[i] >= column_end) | (y[i] >= row_end)
    return off_sensor


@borrowing_kernel
def _keep_on_sensor(t, x, y, p, count, width, height):  # type: ignore[no-untyped-def]
    column_end, row_end = np.uint16(width), np.uint16(height)
    kept = np.uint64(0)  # unsigned: a signed index is asked at each access whether it counts from the end
    for i in range(np.uint64(count)):
        t[kept], x[kept], y[kept], p[kept] = t[i], x[i], y[i], p[i]
        kept += np.uint64((x[i] < column_end) & (y[i] < row_end))
