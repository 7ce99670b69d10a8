"""Encoding `evt21` (EVT 2.1) of Prophesee raw files: 64-bit words, the type in bits 60-63, sensor time in us.

    type  59 .. 54 | 53 .. 43 | 42 .. 32 | 31 .. 0    action
    0     time low |    x     |    y     |  mask      an Off event at (x + i, y) for each set bit i
    1     time low |    x     |    y     |  mask      an On event at (x + i, y) for each set bit i
    8     time high (28 bits, 64 us)     |  -         time of all words that follow
    A     time low | id (40-44), edge (32) |  -       external trigger

Time is that of evt2: t_us = loop * 2^34 + (time high << 6 | time low). Nothing is emitted before one time high. Other
types are counted and skipped. Some sensors swap the two 32-bit halves of every word.
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
    as_words,
    bits_set,
    count_off_sensor,
    events_on_sensor,
    first_triggers,
    set_bits,
    trigger_columns,
)

TYPE_SHIFT, TYPE_MASK, OFF, ON, TIME_HIGH, TRIGGER = 60, 0xF, 0x0, 0x1, 0x8, 0xA
TIME_HIGH_SHIFT, TIME_HIGH_MASK, TIME_HIGH_BITS = 32, 0xFFF_FFFF, 28
TIME_LOW_SHIFT, TIME_LOW_MASK, TIME_LOW_BITS = 54, 0x3F, 6
X_SHIFT, Y_SHIFT, COORDINATE_MASK = 43, 32, 0x7FF
VALID_BITS = 32
GROUP_BITS, GROUP_MASK = 8, 0xFF
"""A group of the mask's bits writes as many events as it may have, and counts those it has."""
TRIGGER_EDGE_SHIFT, TRIGGER_ID_SHIFT, TRIGGER_ID_MASK = 32, 40, 0x1F
WRAP_FALL_MIN = 1 << (TIME_HIGH_BITS - 1)

_BITS_SET = bits_set(GROUP_BITS)
_SET_BITS = set_bits(GROUP_BITS)

# The state that lasts across payloads: time high with its wraps added (-1 while unknown).
_HIGH, _STATE_SIZE = 0, 1


class Evt21Decoder:
    """Decodes `evt21`; the time goes on from payload to payload.

    Args:
        halves_swapped: whether the sensor sends the upper 32 bits of every word first.
    """

    is_sensor_time: ClassVar[bool] = True

    def __init__(self, *, halves_swapped: bool = False) -> None:
        self._halves_swapped = halves_swapped
        self._state = np.full(_STATE_SIZE, -1, np.int64)
        self._events = EventPool()

    def decode(self, payload: Payload, width: int, height: int, time_base_ns: int = 0) -> DecodedWords:  # noqa: ARG002
        """See `WordDecoder.decode`; `time_base_ns` is unused, times are the sensor's own."""
        words = as_words(payload, WORD_64)
        if self._halves_swapped:
            words = as_words(words.view("<u4").reshape(-1, 2)[:, ::-1].tobytes(), WORD_64)
        event_capacity, trigger_capacity = _count(words)
        columns, triggers = self._events.reserve(event_capacity + GROUP_BITS), trigger_columns(trigger_capacity)
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
    events, triggers = np.uint64(0), 0
    for record in words:
        word = record.word
        kind = (word >> TYPE_SHIFT) & TYPE_MASK
        if kind in (OFF, ON):
            for shift in range(0, VALID_BITS, GROUP_BITS):
                events += _BITS_SET[(word >> shift) & GROUP_MASK]
        triggers += kind == TRIGGER
    return np.int64(events), triggers


@borrowing_kernel
def _decode(words, state, t, x, y, p, trigger_t, trigger_id, trigger_edge):  # type: ignore[no-untyped-def]
    count, trigger_count, skipped = np.uint64(0), 0, 0
    high = state[_HIGH]
    for record in words:
        word = record.word
        kind = (word >> TYPE_SHIFT) & TYPE_MASK
        low = (word >> TIME_LOW_SHIFT) & TIME_LOW_MASK
        time_ns = 1000 * (high << TIME_LOW_BITS | low)
        if kind in (OFF, ON):
            if high >= 0:
                column = (word >> X_SHIFT) & COORDINATE_MASK
                row = (word >> Y_SHIFT) & COORDINATE_MASK
                for shift in range(0, VALID_BITS, GROUP_BITS):
                    group = (word >> shift) & GROUP_MASK
                    if group:
                        for k in range(GROUP_BITS):
                            t[count + np.uint64(k)] = time_ns
                            x[count + np.uint64(k)] = column + shift + _SET_BITS[group, k]
                            y[count + np.uint64(k)] = row
                            p[count + np.uint64(k)] = kind
                        count += _BITS_SET[group]
        elif kind == TIME_HIGH:
            value = (word >> TIME_HIGH_SHIFT) & TIME_HIGH_MASK
            loop = max(high, 0) >> TIME_HIGH_BITS
            if (high & TIME_HIGH_MASK) - value > WRAP_FALL_MIN and high >= 0:
                loop += 1
            high = loop << TIME_HIGH_BITS | value
        elif kind == TRIGGER:
            if high >= 0:
                trigger_t[trigger_count] = time_ns
                trigger_id[trigger_count] = (word >> TRIGGER_ID_SHIFT) & TRIGGER_ID_MASK
                trigger_edge[trigger_count] = (word >> TRIGGER_EDGE_SHIFT) & 1
                trigger_count += 1
        else:
            skipped += 1
    state[_HIGH] = high
    return np.int64(count), trigger_count, skipped
