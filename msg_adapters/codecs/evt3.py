"""Encoding `evt3` of Prophesee sensors: 16-bit words, the code in bits 12-15, sensor time in us.

    code  bits 11 .. 0                  action
    0     system type, y (11 bits)      row of all events that follow
    2     polarity, x (11 bits)         one event at (x, y)
    3     polarity, base x (11 bits)    column and polarity of the masks that follow
    4     mask (12 bits)                an event at (base x + i, y) for each set bit i; then base x += 12
    5     - , mask (8 bits)             the same with 8 bits; then base x += 8
    6     time low (us)
    8     time high (4096 us)
    A     id (bits 8-11), edge (bit 0)  external trigger
    7 E F                               continuations and counters of the sensor: passed over
    others                              of no use or unknown (9 is some vendors' padding): counted and skipped

t_us = loop * 2^24 + (time high << 12 | time low). The 24 bits wrap every 16.78 s, which shows as a time high far below
the last one; steps back of up to 10 are bit errors of the device. The state lasts across messages, and nothing is
emitted before one time high followed by one time low. The packet's time base has no meaning here.
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
    as_words,
    event_columns,
    filled_events,
    filled_triggers,
    trigger_columns,
)

CODE_SHIFT, VALUE_MASK = 12, 0xFFF
Y, SINGLE_X, BASE_X, MASK_12, MASK_8, TIME_LOW = 0x0, 0x2, 0x3, 0x4, 0x5, 0x6
CONTINUED_4, TIME_HIGH, TRIGGER, OTHERS, CONTINUED_12 = 0x7, 0x8, 0xA, 0xE, 0xF
COORDINATE_MASK, POLARITY_SHIFT = 0x7FF, 11
MASK_12_BITS, MASK_8_BITS, MASK_8_MASK = 12, 8, 0xFF
TRIGGER_EDGE_MASK, TRIGGER_ID_SHIFT = 0x1, 8

TIME_BITS = 24
STEP_BACK_MAX = 10
"""A time high that falls by more than this many units of 4096 us has wrapped."""

# Slots of the state that lasts across payloads.
_LOOP, _HIGH, _LOW, _SYNC, _ROW, _BASE_COLUMN, _POLARITY = range(7)
_STATE_SIZE = 7

# How much of the time is known.
_NO_TIME, _HIGH_KNOWN, _TIME_KNOWN = range(3)


class Evt3Decoder:
    """Decodes `evt3`; time, row and base column go on from payload to payload."""

    is_sensor_time: ClassVar[bool] = True

    def __init__(self) -> None:
        self._state = np.zeros(_STATE_SIZE, np.int64)

    def decode(self, payload: Payload, width: int, height: int, time_base_ns: int = 0) -> DecodedWords:  # noqa: ARG002
        """See `WordDecoder.decode`; `time_base_ns` is unused, times are the sensor's own."""
        words = as_words(payload, "<u2")
        event_capacity, trigger_capacity = _count(words)
        columns, triggers = event_columns(event_capacity), trigger_columns(trigger_capacity)
        count, trigger_count, skipped, off_sensor = _decode(words, self._state, width, height, *columns, *triggers)
        events = filled_events(columns, count, width, height)
        return DecodedWords(events, filled_triggers(triggers, trigger_count), skipped, off_sensor)

    def reset(self) -> None:
        """Forget time, row and base column."""
        self._state[:] = 0


@njit(cache=True, nogil=True)
def _count(words):  # type: ignore[no-untyped-def]
    events, triggers = 0, 0
    for word in words:
        code = word >> CODE_SHIFT
        if code == SINGLE_X:
            events += 1
        elif code == MASK_12:
            events += BITS_SET[word & VALUE_MASK]
        elif code == MASK_8:
            events += BITS_SET[word & MASK_8_MASK]
        elif code == TRIGGER:
            triggers += 1
    return events, triggers


@njit(cache=True, nogil=True)
def _decode(words, state, width, height, t, x, y, p, trigger_t, trigger_id, trigger_edge):  # type: ignore[no-untyped-def]
    count, trigger_count, skipped, off_sensor = 0, 0, 0, 0
    loop, high, low, sync = state[_LOOP], state[_HIGH], state[_LOW], state[_SYNC]
    row, base_column, polarity = state[_ROW], state[_BASE_COLUMN], state[_POLARITY]
    time_ns = 1000 * (loop << TIME_BITS | high << CODE_SHIFT | low)
    for word in words:
        code = word >> CODE_SHIFT
        value = np.int64(word & VALUE_MASK)
        if code in (MASK_12, MASK_8):
            mask = value if code == MASK_12 else value & MASK_8_MASK
            if sync == _TIME_KNOWN:
                while mask:
                    column = base_column + LOWEST_BIT[mask]
                    mask &= mask - 1
                    if column < width and row < height:
                        t[count] = time_ns
                        x[count] = column
                        y[count] = row
                        p[count] = polarity
                        count += 1
                    else:
                        off_sensor += 1
            base_column += MASK_12_BITS if code == MASK_12 else MASK_8_BITS
        elif code == SINGLE_X:
            if sync == _TIME_KNOWN:
                column = value & COORDINATE_MASK
                if column < width and row < height:
                    t[count] = time_ns
                    x[count] = column
                    y[count] = row
                    p[count] = value >> POLARITY_SHIFT
                    count += 1
                else:
                    off_sensor += 1
        elif code == Y:
            row = value & COORDINATE_MASK
        elif code == BASE_X:
            base_column = value & COORDINATE_MASK
            polarity = value >> POLARITY_SHIFT
        elif code == TIME_LOW:
            low = value
            if sync == _HIGH_KNOWN:
                sync = _TIME_KNOWN
            time_ns = 1000 * (loop << TIME_BITS | high << CODE_SHIFT | low)
        elif code == TIME_HIGH:
            if value + STEP_BACK_MAX < high:
                loop += 1
            high = value
            if sync == _NO_TIME:
                sync = _HIGH_KNOWN
            time_ns = 1000 * (loop << TIME_BITS | high << CODE_SHIFT | low)
        elif code == TRIGGER:
            if sync == _TIME_KNOWN:
                trigger_t[trigger_count] = time_ns
                trigger_id[trigger_count] = value >> TRIGGER_ID_SHIFT
                trigger_edge[trigger_count] = value & TRIGGER_EDGE_MASK
                trigger_count += 1
        elif code not in (CONTINUED_4, OTHERS, CONTINUED_12):
            skipped += 1
    state[_LOOP], state[_HIGH], state[_LOW], state[_SYNC] = loop, high, low, sync
    state[_ROW], state[_BASE_COLUMN], state[_POLARITY] = row, base_column, polarity
    return count, trigger_count, skipped, off_sensor
