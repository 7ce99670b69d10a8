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

Speed comes from branches not taken: which kind of word comes next can seldom be foreseen. So the frequent kinds (row,
single event, time low, a time high said again) all do the same work, an event is written after each of them, and only
a single event is counted, so that the next word's overwrites the others'. Likewise masks write a few events at a time
and count those they have.

Where each event has a time and a row of its own, with or without the time high said again before, the next word can be
foreseen in long runs: there three or four of them are taken at once (`_decode_regular`), until something else comes.
Then the other way goes on for a while, twice as long each time unless such a run has come meanwhile.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import numpy.typing as npt

from etd_ros.borrowing_kernel import borrowing_kernel, borrowing_part, kernel_part
from etd_ros.buffers import Arrays
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
from msg_adapters.layout import MessageError

CODE_SHIFT, VALUE_MASK = 12, 0xFFF
Y, SINGLE_X, BASE_X, MASK_12, MASK_8, TIME_LOW = 0x0, 0x2, 0x3, 0x4, 0x5, 0x6
CONTINUED_4, TIME_HIGH, TRIGGER, OTHERS, CONTINUED_12 = 0x7, 0x8, 0xA, 0xE, 0xF
Y_WORD_MAX = Y << CODE_SHIFT | VALUE_MASK
COORDINATE_MASK, POLARITY_SHIFT = 0x7FF, 11
MASK_12_BITS, MASK_8_BITS, MASK_8_MASK = 12, 8, 0xFF
TRIGGER_EDGE_MASK, TRIGGER_ID_SHIFT = 0x1, 8
BASE_COLUMN_MAX = 0xFFFF - MASK_12_BITS
"""Where a senseless run of masks ends: its columns must not wrap to the sensor again."""

MASK_GROUP = 4
"""Events of a mask that are written together: most masks have few bits."""

TIME_BITS = 24
STEP_BACK_MAX = 10
"""A time high that falls by more than this many units of 4096 us has wrapped."""

WORD_BITS = 16
CODES_MASK = 0xF000F000F000
"""Where the codes of three successive words are, the first in the lowest bits."""
REGULAR_CODES = TIME_LOW << CODE_SHIFT | Y << CODE_SHIFT + WORD_BITS | SINGLE_X << CODE_SHIFT + 2 * WORD_BITS
"""What they are in a regular run."""
RUN_WORDS_MIN = 64
"""A regular run of so many words is worth looking for the next one soon."""
MIXED_WORDS_MIN, MIXED_WORDS_MAX = 64, 1 << 20
"""So many words, and those up to the next single event, are decoded one by one before a regular run is looked for
again; each message begins with a look."""

# A table over the 16 codes: which bits must be those of the last time high for the word to be a frequent one. The
# compiler cannot see through it; if it could, it would make branches of it.
_FREQUENT = (Y, SINGLE_X, TIME_LOW, CONTINUED_4, OTHERS, CONTINUED_12)
_RARE = np.array([0 if code in _FREQUENT else 0xFFFF for code in range(16)], np.int64)

# Tables over the 12-bit masks.
_BITS_SET = bits_set(MASK_12_BITS)
_SET_BITS = set_bits(MASK_12_BITS)

# Slots of the state that lasts across payloads. The time low is kept in ns; the last one says after how many words
# decoded one by one a regular run was looked for last.
_LOOP, _HIGH, _LOW_NS, _SYNC, _ROW, _BASE_COLUMN, _POLARITY, _MIXED_WORDS = range(8)
_STATE_SIZE = 8

# How much of the time is known.
_NO_TIME, _HIGH_KNOWN, _TIME_KNOWN = range(3)


class Evt3Decoder:
    """Decodes `evt3`; time, row and base column go on from payload to payload."""

    is_sensor_time: ClassVar[bool] = True

    def __init__(self) -> None:
        self._state = np.zeros(_STATE_SIZE, np.int64)
        self._is_time_known = False
        self._events = EventPool()

    def decode(self, payload: Payload, width: int, height: int, time_base_ns: int = 0) -> DecodedWords:  # noqa: ARG002
        """See `WordDecoder.decode`; `time_base_ns` is unused, times are the sensor's own."""
        words = as_words(payload, WORD_16)
        if self._is_time_known:
            return self._decoded(words, width, height)
        before = self._state.copy()
        try:
            known_from, sync = _find_time(words, self._state[_SYNC])
            *_, skipped = self._columns(words[:known_from], width, height)
            self._state[_SYNC] = sync
            decoded = self._decoded(words[known_from:], width, height)
        except MessageError:
            # A message that is refused says nothing.
            self._state[:] = before
            raise
        self._is_time_known = sync == _TIME_KNOWN
        return decoded._replace(skipped_words=skipped + decoded.skipped_words)

    def _decoded(self, words: npt.NDArray[np.void], width: int, height: int) -> DecodedWords:
        """What words hold of which the time is known."""
        columns, off_sensor, count, trigger_count, skipped = self._columns(words, width, height)
        return DecodedWords(
            events_on_sensor(columns, count, off_sensor, width, height),
            _last_as_triggers(columns, trigger_count) if trigger_count else Triggers.empty(),
            skipped,
            off_sensor,
        )

    def _columns(self, words: npt.NDArray[np.void], width: int, height: int) -> tuple[Arrays, int, int, int, int]:
        """Arrays with what the words hold: how many events are off the sensor, how many there are, triggers, and words
        skipped."""
        columns = self._events.reserve_for_words(len(words), MASK_12_BITS)
        needed, off_sensor, count, trigger_count, skipped = _decode(words, self._state, width, height, *columns)
        if needed:
            columns = self._events.reserve(needed)
            _, off_sensor, count, trigger_count, skipped = _decode(words, self._state, width, height, *columns)
        return columns, off_sensor, count, trigger_count, skipped

    def reset(self) -> None:
        """Forget time, row and base column."""
        self._state[:] = 0
        self._is_time_known = False


def _last_as_triggers(columns: Arrays, count: int) -> Triggers:
    """The `count` triggers that `_decode` wrote from the arrays' end on.

    Copied, as whoever keeps these few should not keep the message's events.
    """
    t, identifier, _, edge = columns
    backwards = slice(None, -count - 1, -1)
    return Triggers(t[backwards].copy(), identifier[backwards].copy(), edge[backwards].copy())


@borrowing_kernel
def _find_time(words, sync):  # type: ignore[no-untyped-def]
    """Index of the first word after the time is known, the number of words if it never is; and how much of the time is
    known then, `sync` before."""
    for i in range(len(words)):
        code = words[i].word >> CODE_SHIFT
        if code == TIME_HIGH:
            sync = _HIGH_KNOWN
        elif code == TIME_LOW and sync == _HIGH_KNOWN:
            return i + 1, _TIME_KNOWN
    return len(words), sync


@borrowing_kernel
def _decode(words, state, width, height, t, x, y, p):  # type: ignore[no-untyped-def]
    """Items that the arrays must have where they are too short, and then nothing is decoded; else 0, and the numbers of
    what was decoded: events off the sensor, all events, triggers, words skipped.

    One kernel does all, since many messages are so small that a call costs as much as their words.
    """
    if MASK_12_BITS * len(words) >= len(t):
        needed = _capacity(words)
        if needed > len(t):
            return needed, 0, 0, 0, 0
    count, trigger_count, skipped = _decode_all(words, state, t, x, y, p)
    return 0, _count_off_sensor(x, y, count, width, height), count, trigger_count, skipped


@borrowing_part
def _capacity(words):  # type: ignore[no-untyped-def]
    """Items that `_decode_all` may write: events, one more that is not counted, and triggers."""
    items = 1
    for i in range(len(words)):
        code = words[i].word >> CODE_SHIFT
        items += ((code == SINGLE_X) | (code == TRIGGER)) + MASK_12_BITS * ((code == MASK_12) | (code == MASK_8))
    return items


@borrowing_part
def _count_off_sensor(x, y, count, width, height):  # type: ignore[no-untyped-def]
    column_end, row_end = np.uint16(width), np.uint16(height)
    off_sensor = 0
    for i in range(count):
        off_sensor += (x[i] >= column_end) | (y[i] >= row_end)
    return off_sensor


# Indices are unsigned: for signed ones, compiled code would ask of each access whether it counts from the end.
@borrowing_part
def _decode_all(words, state, t, x, y, p):  # type: ignore[no-untyped-def]
    """Numbers of events and triggers decoded, and of words skipped."""
    count, trigger_count, skipped = np.uint64(0), np.int64(0), np.int64(0)
    i, end = np.uint64(0), np.uint64(len(words))
    mixed_words = state[_MIXED_WORDS]
    while i < end:
        before = i
        i, count = _decode_regular(words, i, state, t, x, y, p, count)
        mixed_words = 0 if i - before >= RUN_WORDS_MIN else 2 * mixed_words
        mixed_words = min(max(mixed_words, MIXED_WORDS_MIN), MIXED_WORDS_MAX)
        stop = min(end, i + np.uint64(mixed_words))
        # Groups end with a single event: in the middle of one none would be seen.
        while stop < end and words[stop - np.uint64(1)].word >> CODE_SHIFT != SINGLE_X:
            stop += np.uint64(1)
        if i < stop:
            count, trigger_count, skipped = _decode_mixed(
                words, i, stop, state, t, x, y, p, count, trigger_count, skipped
            )
        i = stop
    state[_MIXED_WORDS] = mixed_words
    return np.int64(count), trigger_count, skipped


@kernel_part
def _decode_regular(words, i, state, t, x, y, p, count):  # type: ignore[no-untyped-def]
    """Decode words from i on as long as they are a time low, a row and a single event, with or without the last time
    high before them and four words are left; the index of the first one that is not decoded, and the number of
    events."""
    high = state[_HIGH]
    high_word = np.uint64(TIME_HIGH << CODE_SHIFT | high)
    high_ns = 1000 * (state[_LOOP] << TIME_BITS | high << CODE_SHIFT)
    low_ns, row = state[_LOW_NS], state[_ROW]
    codes, regular = np.uint64(CODES_MASK), np.uint64(REGULAR_CODES)
    high_and_regular = regular << np.uint64(WORD_BITS) | high_word
    high_and_codes = codes << np.uint64(WORD_BITS) | np.uint64(0xFFFF)
    end = np.uint64(len(words))
    while i + np.uint64(4) <= end:
        group = _four_words(words, i)
        if group & high_and_codes == high_and_regular:
            group >>= np.uint64(WORD_BITS)
            i += np.uint64(4)
        elif group & codes == regular:
            i += np.uint64(3)
        else:
            break
        low_ns = 1000 * np.int64(group & np.uint64(VALUE_MASK))
        row = np.int64(group >> np.uint64(WORD_BITS) & np.uint64(COORDINATE_MASK))
        t[count] = high_ns + low_ns
        x[count] = group >> np.uint64(2 * WORD_BITS) & np.uint64(COORDINATE_MASK)
        y[count] = row
        p[count] = group >> np.uint64(2 * WORD_BITS + POLARITY_SHIFT) & np.uint64(1)
        count += np.uint64(1)
    state[_LOW_NS], state[_ROW] = low_ns, row
    return i, count


@kernel_part
def _four_words(words, i):  # type: ignore[no-untyped-def]
    """Words i to i + 3 in one integer, the first in the lowest bits; compiled to one load."""
    four = np.uint64(0)
    for k in range(np.uint64(4)):
        four |= np.uint64(words[i + k].word) << k * np.uint64(WORD_BITS)
    return four


# Triggers are written from the arrays' end on: time to t, input to x, edge to p.
@borrowing_part
def _decode_mixed(words, begin, stop, state, t, x, y, p, count, trigger_count, skipped):  # type: ignore[no-untyped-def]
    """Decode words begin .. stop - 1, whatever they are; numbers as `_decode_all`'s, those before added."""
    loop, high, row = state[_LOOP], state[_HIGH], state[_ROW]
    base_column, base_polarity = state[_BASE_COLUMN], state[_POLARITY]
    high_word = TIME_HIGH << CODE_SHIFT | high
    high_ns = 1000 * (loop << TIME_BITS | high << CODE_SHIFT)
    time_ns = high_ns + state[_LOW_NS]
    for i in range(begin, stop):
        word = np.int64(words[i].word)
        code = word >> CODE_SHIFT
        value = word & VALUE_MASK
        if not _RARE[code] & (word ^ high_word):
            column = value & COORDINATE_MASK
            row = column if word <= Y_WORD_MAX else row
            low_time_ns = high_ns + 1000 * value
            time_ns = low_time_ns if code == TIME_LOW else time_ns
            t[count] = time_ns
            x[count] = column
            y[count] = row
            p[count] = value >> POLARITY_SHIFT
            count += np.uint64(code == SINGLE_X)
        elif code in (MASK_12, MASK_8):
            mask = value if code == MASK_12 else value & MASK_8_MASK
            bits = _BITS_SET[mask]
            for first in range(0, MASK_12_BITS, MASK_GROUP):
                if bits > np.uint64(first):
                    start = count + np.uint64(first)
                    for k in range(MASK_GROUP):
                        t[start + np.uint64(k)] = time_ns
                    for k in range(MASK_GROUP):
                        x[start + np.uint64(k)] = base_column + _SET_BITS[mask, first + k]
                    for k in range(MASK_GROUP):
                        y[start + np.uint64(k)] = row
                    for k in range(MASK_GROUP):
                        p[start + np.uint64(k)] = base_polarity
            count += bits
            base_column = min(base_column + (MASK_12_BITS if code == MASK_12 else MASK_8_BITS), BASE_COLUMN_MAX)
        elif code == BASE_X:
            base_column = value & COORDINATE_MASK
            base_polarity = value >> POLARITY_SHIFT
        elif code == TIME_HIGH:
            low_ns = time_ns - high_ns
            loop += value + STEP_BACK_MAX < high
            high, high_word = value, word
            high_ns = 1000 * (loop << TIME_BITS | high << CODE_SHIFT)
            time_ns = high_ns + low_ns
        elif code == TRIGGER:
            trigger_count += 1
            place = np.uint64(len(t) - trigger_count)
            t[place] = time_ns
            x[place] = value >> TRIGGER_ID_SHIFT
            p[place] = value & TRIGGER_EDGE_MASK
        else:
            skipped += 1
    state[_LOOP], state[_HIGH], state[_LOW_NS] = loop, high, time_ns - high_ns
    state[_ROW], state[_BASE_COLUMN], state[_POLARITY] = row, base_column, base_polarity
    return count, trigger_count, skipped
