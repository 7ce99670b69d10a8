"""Encoding `libcaer_cmp`: 16-bit words, the code in bits 12-15, time in us after the packet's time base.

    code  bits 11 .. 0             action
    0     time high                high = value << 12 (us)
    1     time low                 low = value (us)
    2     x (11 bits)              column of the single events that follow
    3     polarity, y (11 bits)    one event at (x, y)
    4     polarity, base y (11)    row of the masks that follow
    5     - , mask (8 bits)        an event at (x, base y + i) for each set bit i; then base y += 8

Code 6 is declared for 12-bit masks but no sender produces it; it and the codes above are counted and skipped.

Two defects of the sender cannot be undone: a lone event in the same group of 8 rows as the one before it is sent with
that one's row (up to 7 pixels off), and packets longer than 65.5 ms are mis-timed.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numba import njit

from msg_adapters.codecs.words import (
    BITS_SET,
    LOWEST_BIT,
    DecodedWords,
    Payload,
    Triggers,
    as_words,
    event_columns,
    filled_events,
)

CODE_SHIFT, VALUE_MASK = 12, 0xFFF
TIME_HIGH, TIME_LOW, X, SINGLE_Y, BASE_Y, MASK_8 = range(6)
COORDINATE_MASK, POLARITY_SHIFT = 0x7FF, 11
MASK_8_BITS, MASK_8_MASK = 8, 0xFF


class LibcaerCmpDecoder:
    """Decodes `libcaer_cmp`; its state begins anew with every message."""

    is_sensor_time: ClassVar[bool] = False

    def decode(self, payload: Payload, width: int, height: int, time_base_ns: int = 0) -> DecodedWords:
        """See `WordDecoder.decode`."""
        words = as_words(payload, "<u2")
        columns = event_columns(int(_count_events(words)))
        count, skipped, off_sensor = _decode(words, time_base_ns, width, height, *columns)
        return DecodedWords(filled_events(columns, count, width, height), Triggers.empty(), skipped, off_sensor)

    def reset(self) -> None:
        """Nothing to forget."""


@njit(cache=True, nogil=True)
def _count_events(words):  # type: ignore[no-untyped-def]
    count = 0
    for word in words:
        code = word >> CODE_SHIFT
        if code == SINGLE_Y:
            count += 1
        elif code == MASK_8:
            count += BITS_SET[word & MASK_8_MASK]
    return count


@njit(cache=True, nogil=True)
def _decode(words, time_base_ns, width, height, t, x, y, p):  # type: ignore[no-untyped-def]
    count, skipped, off_sensor = 0, 0, 0
    high_us, low_us = np.int64(0), np.int64(0)
    column, base_row, polarity = np.int64(0), np.int64(0), np.int64(0)
    time_ns = np.int64(time_base_ns)
    for word in words:
        code = word >> CODE_SHIFT
        value = np.int64(word & VALUE_MASK)
        if code == SINGLE_Y:
            row = value & COORDINATE_MASK
            if column < width and row < height:
                t[count] = time_ns
                x[count] = column
                y[count] = row
                p[count] = value >> POLARITY_SHIFT
                count += 1
            else:
                off_sensor += 1
        elif code == MASK_8:
            mask = value & MASK_8_MASK
            while mask:
                row = base_row + LOWEST_BIT[mask]
                mask &= mask - 1
                if column < width and row < height:
                    t[count] = time_ns
                    x[count] = column
                    y[count] = row
                    p[count] = polarity
                    count += 1
                else:
                    off_sensor += 1
            base_row += MASK_8_BITS
        elif code == X:
            column = value & COORDINATE_MASK
        elif code == BASE_Y:
            base_row = value & COORDINATE_MASK
            polarity = value >> POLARITY_SHIFT
        elif code == TIME_LOW:
            low_us = value
            time_ns = time_base_ns + 1000 * (high_us | low_us)
        elif code == TIME_HIGH:
            high_us = value << CODE_SHIFT
            time_ns = time_base_ns + 1000 * (high_us | low_us)
        else:
            skipped += 1
    return count, skipped, off_sensor
