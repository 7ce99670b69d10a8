"""Encoding `libcaer`: two 32-bit words an event, time in us.

uint32 data   31 .. 17 | 16 .. 2 | 1 | 0
                  x    |    y    | p | validity, unused
int32 time    us after the time base; it falls when its 31 bits wrap, which adds 2^31 us
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numba import njit

from msg_adapters.codecs.words import DecodedWords, Payload, Triggers, as_words, event_columns, filled_events

EVENT_DTYPE = "<i8"
"""Both words of an event at once: data in the low half, time in the high one."""

POLARITY_SHIFT = 1
Y_SHIFT, X_SHIFT, COORDINATE_MASK = 2, 17, 0x7FFF
TIME_SHIFT = 32
WRAP_NS = (1 << 31) * 1000


class LibcaerDecoder:
    """Decodes `libcaer`; it has no state between messages."""

    is_sensor_time: ClassVar[bool] = False

    def decode(self, payload: Payload, width: int, height: int, time_base_ns: int = 0) -> DecodedWords:
        """See `WordDecoder.decode`."""
        words = as_words(payload, EVENT_DTYPE)
        columns = event_columns(len(words))
        count = int(_decode(words, time_base_ns, width, height, *columns))
        events = filled_events(columns, count, width, height)
        return DecodedWords(events, Triggers.empty(), off_sensor=len(words) - count)

    def reset(self) -> None:
        """Nothing to forget."""


@njit(cache=True, nogil=True)
def _decode(words, time_base_ns, width, height, t, x, y, p):  # type: ignore[no-untyped-def]
    count = 0
    high_ns = np.int64(time_base_ns)
    last_us = np.int64(-(1 << 31))
    for word in words:
        time_us = word >> TIME_SHIFT
        if time_us < last_us:
            high_ns += WRAP_NS
        last_us = time_us
        column = (word >> X_SHIFT) & COORDINATE_MASK
        row = (word >> Y_SHIFT) & COORDINATE_MASK
        if column < width and row < height:
            t[count] = high_ns + time_us * 1000
            x[count] = column
            y[count] = row
            p[count] = (word >> POLARITY_SHIFT) & 1
            count += 1
    return count
