"""Encoding `evt2` of Prophesee raw files: 32-bit words, the type in bits 28-31, sensor time in us.

    type  27 .. 22 | 21 .. 11 | 10 .. 0    action
    0     time low |    x     |    y       Off event
    1     time low |    x     |    y       On event
    8     time high (28 bits, 64 us)       time of all words that follow
    A     time low | id (8-12), edge (0)   external trigger

t_us = loop * 2^34 + (time high << 6 | time low). The 34 bits wrap every 4.8 h, which shows as a time high that falls by
more than half its range. Nothing is emitted before one time high. Other types are counted and skipped.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from etd_ros.borrowing_kernel import borrowing_kernel
from msg_adapters.codecs.words import (
    WORD_32,
    DecodedWords,
    EventPool,
    Payload,
    as_words,
    count_off_sensor,
    events_on_sensor,
    first_triggers,
    trigger_columns,
)

TYPE_SHIFT, OFF, ON, TIME_HIGH, TRIGGER = 28, 0x0, 0x1, 0x8, 0xA
TIME_HIGH_MASK, TIME_HIGH_BITS = 0xFFF_FFFF, 28
TIME_LOW_SHIFT, TIME_LOW_MASK, TIME_LOW_BITS = 22, 0x3F, 6
X_SHIFT, COORDINATE_MASK = 11, 0x7FF
TRIGGER_EDGE_MASK, TRIGGER_ID_SHIFT, TRIGGER_ID_MASK = 0x1, 8, 0x1F
WRAP_FALL_MIN = 1 << (TIME_HIGH_BITS - 1)

# The state that lasts across payloads: time high with its wraps added (-1 while unknown).
_HIGH, _STATE_SIZE = 0, 1


class Evt2Decoder:
    """Decodes `evt2`; the time goes on from payload to payload."""

    is_sensor_time: ClassVar[bool] = True

    def __init__(self) -> None:
        self._state = np.full(_STATE_SIZE, -1, np.int64)
        self._events = EventPool()

    def decode(self, payload: Payload, width: int, height: int, time_base_ns: int = 0) -> DecodedWords:  # noqa: ARG002
        """See `WordDecoder.decode`; `time_base_ns` is unused, times are the sensor's own."""
        words = as_words(payload, WORD_32)
        event_capacity, trigger_capacity = _count(words)
        columns, triggers = self._events.reserve(event_capacity), trigger_columns(trigger_capacity)
        count, trigger_count, skipped = _decode(words, self._state, *(*columns, *triggers))
        _, x, y, _ = columns
        off_sensor = count_off_sensor(x, y, count, width, height)
        events = events_on_sensor(columns, count, off_sensor, width, height)
        return DecodedWords(events, first_triggers(triggers, trigger_count), skipped, off_sensor)

    def reset(self) -> None:
        """Forget the time."""
        self._state[:] = -1


@borrowing_kernel
def _count(words):  # type: ignore[no-untyped-def]
    events, triggers = 0, 0
    for record in words:
        kind = record.word >> TYPE_SHIFT
        events += kind in (OFF, ON)
        triggers += kind == TRIGGER
    return events, triggers


@borrowing_kernel
def _decode(words, state, t, x, y, p, trigger_t, trigger_id, trigger_edge):  # type: ignore[no-untyped-def]
    count, trigger_count, skipped = 0, 0, 0
    high = state[_HIGH]
    for record in words:
        word = np.int64(record.word)
        kind = word >> TYPE_SHIFT
        low = (word >> TIME_LOW_SHIFT) & TIME_LOW_MASK
        time_ns = 1000 * (high << TIME_LOW_BITS | low)
        if kind in (OFF, ON):
            if high >= 0:
                t[count] = time_ns
                x[count] = (word >> X_SHIFT) & COORDINATE_MASK
                y[count] = word & COORDINATE_MASK
                p[count] = kind
                count += 1
        elif kind == TIME_HIGH:
            value = word & TIME_HIGH_MASK
            loop = max(high, 0) >> TIME_HIGH_BITS
            if (high & TIME_HIGH_MASK) - value > WRAP_FALL_MIN and high >= 0:
                loop += 1
            high = loop << TIME_HIGH_BITS | value
        elif kind == TRIGGER:
            if high >= 0:
                trigger_t[trigger_count] = time_ns
                trigger_id[trigger_count] = (word >> TRIGGER_ID_SHIFT) & TRIGGER_ID_MASK
                trigger_edge[trigger_count] = word & TRIGGER_EDGE_MASK
                trigger_count += 1
        else:
            skipped += 1
    state[_HIGH] = high
    return count, trigger_count, skipped
