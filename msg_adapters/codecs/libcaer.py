"""Encoding `libcaer`: two 32-bit words an event, time in us.

uint32 data   31 .. 17 | 16 .. 2 | 1 | 0
                  x    |    y    | p | validity, unused
int32 time    us after the time base; it falls when its 31 bits wrap, which adds 2^31 us
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from etd_ros.borrowing_kernel import borrowing_kernel
from msg_adapters.codecs.words import (
    WORD_64,
    DecodedWords,
    EventPool,
    Payload,
    Triggers,
    as_words,
    events_on_sensor,
)

# Both words of an event are read at once: data in the low half, time in the high one.
POLARITY_SHIFT = 1
Y_SHIFT, X_SHIFT, COORDINATE_MASK = 2, 17, 0x7FFF
TIME_SHIFT = 32
WRAP_NS = (1 << 31) * 1000


class LibcaerDecoder:
    """Decodes `libcaer`; it has no state between messages."""

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


@borrowing_kernel
def _decode(words, time_base_ns, width, height, t, x, y, p):  # type: ignore[no-untyped-def]
    """The number of events off the sensor."""
    column_end, row_end = np.uint16(width), np.uint16(height)
    high_ns = np.int64(time_base_ns)
    last_us = np.int64(-(1 << 31))
    for i in range(len(words)):
        word = words[i].word
        time_us = word >> TIME_SHIFT
        high_ns += WRAP_NS * (time_us < last_us)
        last_us = time_us
        t[i] = high_ns + time_us * 1000
        x[i] = (word >> X_SHIFT) & COORDINATE_MASK
        y[i] = (word >> Y_SHIFT) & COORDINATE_MASK
        p[i] = (word >> POLARITY_SHIFT) & 1
    off_sensor = 0
    for i in range(len(words)):
        off_sensor += (x[i] >= column_end) | (y[i] >= row_end)
    return off_sensor
