"""Encodings `mono` (events) and `trigger` (trigger edges): one uint64 a word, time in ns after the packet's time base.

         63 | 62 .. 48 | 47 .. 32 | 31 .. 0
mono      p |    y     |    x     | dt (ns)
trigger edge|    id    |    -     | dt (ns)
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import numpy.typing as npt

from etd_ros.borrowing_kernel import borrowing_kernel
from etd_ros.events import Events
from msg_adapters.codecs.words import (
    WORD_64,
    DecodedWords,
    EventPool,
    Payload,
    Triggers,
    as_words,
    events_on_sensor,
)
from msg_adapters.layout import MessageError

DT_MASK = 0xFFFF_FFFF
X_SHIFT, X_MASK = 32, 0xFFFF
Y_SHIFT, Y_MASK = 48, 0x7FFF
POLARITY_SHIFT = 63


class MonoDecoder:
    """Decodes `mono`; it has no state."""

    is_sensor_time: ClassVar[bool] = False

    def __init__(self) -> None:
        self._events = EventPool()

    def decode(self, payload: Payload, width: int, height: int, time_base_ns: int = 0) -> DecodedWords:
        """See `WordDecoder.decode`."""
        words = as_words(payload, WORD_64)
        columns = self._events.reserve(len(words))
        off_sensor = _decode(words, time_base_ns, width, height, *columns)
        events = events_on_sensor(columns, len(words), off_sensor, width, height)
        return DecodedWords(events, Triggers.empty(), 0, off_sensor)

    def reset(self) -> None:
        """Nothing to forget."""


class TriggerDecoder:
    """Decodes `trigger`; it has no state and gives no events."""

    is_sensor_time: ClassVar[bool] = False

    def decode(self, payload: Payload, width: int, height: int, time_base_ns: int = 0) -> DecodedWords:
        """See `WordDecoder.decode`."""
        words = as_words(payload, WORD_64)["word"]
        triggers = Triggers(
            t=time_base_ns + (words & DT_MASK),
            id=((words >> Y_SHIFT) & Y_MASK).astype(np.uint16),
            edge=(words < 0).astype(np.uint8),
        )
        return DecodedWords(Events.empty(width, height), triggers)

    def reset(self) -> None:
        """Nothing to forget."""


def encode_mono(events: Events, time_base_ns: int) -> npt.NDArray[np.uint64]:
    """Events as `mono` words, uint64, shape (n,).

    Raises:
        MessageError: an event before the time base or 2^32 ns (4.3 s) or more after it, or a row above 32767.
    """
    if len(events):
        first, last = int(events.t.min()) - time_base_ns, int(events.t.max()) - time_base_ns
        if first < 0 or last > DT_MASK:
            msg = (
                f"events from {first} ns to {last} ns after the time base do not fit one packet of mono, "
                f"which holds 0..{DT_MASK} ns: split them"
            )
            raise MessageError(msg)
        if int(events.y.max()) > Y_MASK:
            msg = f"row {int(events.y.max())} does not fit mono, which holds rows up to {Y_MASK}"
            raise MessageError(msg)
    words = np.empty(len(events), np.uint64)
    _encode(events.t, events.x, events.y, events.p, time_base_ns, words.view(np.int64))
    return words


@borrowing_kernel
def _decode(words, time_base_ns, width, height, t, x, y, p):  # type: ignore[no-untyped-def]
    """The number of events off the sensor."""
    column_end, row_end = np.uint16(width), np.uint16(height)
    for i in range(len(words)):
        word = words[i].word
        t[i] = time_base_ns + (word & DT_MASK)
        x[i] = (word >> X_SHIFT) & X_MASK
        y[i] = (word >> Y_SHIFT) & Y_MASK
        p[i] = word < 0
    off_sensor = 0
    for i in range(len(words)):
        off_sensor += (x[i] >= column_end) | (y[i] >= row_end)
    return off_sensor


@borrowing_kernel
def _encode(t, x, y, p, time_base_ns, words):  # type: ignore[no-untyped-def]
    for i in range(len(words)):
        place = np.int64(x[i]) << X_SHIFT | np.int64(y[i]) << Y_SHIFT | np.int64(p[i]) << POLARITY_SHIFT
        words[i] = place | (t[i] - time_base_ns)
