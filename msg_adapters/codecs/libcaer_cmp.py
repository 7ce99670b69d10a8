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

The kernel is made like that of `evt3`, whose module says why: the frequent words (time low, column, single event) all
do the same work.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from etd_ros.borrowing_kernel import borrowing_kernel, borrowing_part
from msg_adapters.codecs.words import (
    WORD_16,
    DecodedWords,
    EventPool,
    Payload,
    Triggers,
    as_words,
    bits_set,
    events_on_sensor,
    set_bits,
)

CODE_SHIFT, VALUE_MASK = 12, 0xFFF
TIME_HIGH, TIME_LOW, X, SINGLE_Y, BASE_Y, MASK_8 = range(6)
COORDINATE_MASK, POLARITY_SHIFT = 0x7FF, 11
MASK_8_BITS, MASK_8_MASK = 8, 0xFF
BASE_ROW_MAX = np.int64(0xFFFF - MASK_8_BITS)
"""Where a senseless run of masks ends: its rows must not wrap to the sensor again."""

# The frequent words TIME_LOW < X < SINGLE_Y are told apart as a whole: of repeated questions for the code the compiler
# would make branches.
X_WORD, SINGLE_Y_WORD = X << CODE_SHIFT, SINGLE_Y << CODE_SHIFT
_IS_FREQUENT = np.array([code in (TIME_LOW, X, SINGLE_Y) for code in range(16)])

# Tables over the 8-bit masks.
_BITS_SET = bits_set(MASK_8_BITS)
_SET_BITS = set_bits(MASK_8_BITS)


class LibcaerCmpDecoder:
    """Decodes `libcaer_cmp`; its state begins anew with every message."""

    is_sensor_time: ClassVar[bool] = False

    def __init__(self) -> None:
        self._events = EventPool()

    def decode(self, payload: Payload, width: int, height: int, time_base_ns: int = 0) -> DecodedWords:
        """See `WordDecoder.decode`."""
        words = as_words(payload, WORD_16)
        columns = self._events.reserve_for_words(len(words), MASK_8_BITS)
        needed, off_sensor, count, skipped = _decode(words, time_base_ns, width, height, *columns)
        if needed:
            columns = self._events.reserve(needed)
            _, off_sensor, count, skipped = _decode(words, time_base_ns, width, height, *columns)
        events = events_on_sensor(columns, count, off_sensor, width, height)
        return DecodedWords(events, Triggers.empty(), skipped, off_sensor)

    def reset(self) -> None:
        """Nothing to forget."""


@borrowing_kernel
def _decode(words, time_base_ns, width, height, t, x, y, p):  # type: ignore[no-untyped-def]
    """Items that the arrays must have where they are too short, and then nothing is decoded; else 0, and the numbers of
    what was decoded: events off the sensor, all events, words skipped."""
    if MASK_8_BITS * len(words) >= len(t):
        needed = _capacity(words)
        if needed > len(t):
            return needed, 0, 0, 0
    count, skipped = _decode_words(words, time_base_ns, t, x, y, p)
    return 0, _count_off_sensor(x, y, count, width, height), count, skipped


@borrowing_part
def _capacity(words):  # type: ignore[no-untyped-def]
    """Items that `_decode_words` may write: events, and one more that is not counted."""
    items = 1
    for i in range(len(words)):
        code = words[i].word >> CODE_SHIFT
        items += (code == SINGLE_Y) + MASK_8_BITS * (code == MASK_8)
    return items


@borrowing_part
def _count_off_sensor(x, y, count, width, height):  # type: ignore[no-untyped-def]
    column_end, row_end = np.uint16(width), np.uint16(height)
    off_sensor = 0
    for i in range(count):
        off_sensor += (x[i] >= column_end) | (y[i] >= row_end)
    return off_sensor


@borrowing_part
def _decode_words(words, time_base_ns, t, x, y, p):  # type: ignore[no-untyped-def]
    count, skipped = np.uint64(0), 0
    column, base_row, base_polarity = np.int64(0), np.int64(0), np.int64(0)
    high_ns = time_ns = np.int64(time_base_ns)
    for i in range(np.uint64(len(words))):
        word = np.int64(words[i].word)
        code = word >> CODE_SHIFT
        value = word & VALUE_MASK
        if _IS_FREQUENT[code]:
            coordinate = value & COORDINATE_MASK
            column = coordinate if (word ^ X_WORD) <= VALUE_MASK else column
            low_time_ns = high_ns + 1000 * value
            time_ns = low_time_ns if word < X_WORD else time_ns
            t[count] = time_ns
            x[count] = column
            y[count] = coordinate
            p[count] = value >> POLARITY_SHIFT
            count += np.uint64(word >= SINGLE_Y_WORD)
        elif code == MASK_8:
            mask = value & MASK_8_MASK
            for k in range(MASK_8_BITS):
                t[count + np.uint64(k)] = time_ns
            for k in range(MASK_8_BITS):
                x[count + np.uint64(k)] = column
            for k in range(MASK_8_BITS):
                y[count + np.uint64(k)] = base_row + _SET_BITS[mask, k]
            for k in range(MASK_8_BITS):
                p[count + np.uint64(k)] = base_polarity
            count += _BITS_SET[mask]
            base_row = min(base_row + MASK_8_BITS, BASE_ROW_MAX)
        elif code == BASE_Y:
            base_row = value & COORDINATE_MASK
            base_polarity = value >> POLARITY_SHIFT
        elif code == TIME_HIGH:
            low_ns = time_ns - high_ns
            high_ns = time_base_ns + 1000 * (value << CODE_SHIFT)
            time_ns = high_ns + low_ns
        else:
            skipped += 1
    return np.int64(count), skipped
