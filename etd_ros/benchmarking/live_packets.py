"""A scene as EventPackets that can be sent for as long as one likes: encoded once, stamped anew from loop to loop."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.benchmarking.encoders import FRAME_ID
from etd_ros.benchmarking.live_scene import NS_PER_US, SEED, TURN_US, IntArray, LiveScene
from etd_ros.benchmarking.streams import BenchmarkError
from etd_ros.events import Events
from msg_adapters import Header
from msg_adapters.header import write_header
from msg_adapters.layout import Writer

US_PER_S = 1_000_000
TIME_BITS, TIME_MASK = 12, 0xFFF
TIME_HIGH_NS = NS_PER_US << TIME_BITS
"""What a step of a time high stands for."""

WORDS_PER_EVENT_MAX = 4
WordArray = npt.NDArray[np.uint16]


@dataclass(frozen=True)
class Encoding:
    """How a camera's driver says what happened: words of 16 bits, with a code in the upper four.

    Attributes:
        name: of the encoding.
        time_high, time_low, line, event: the codes, in place.
        lines_are_rows: whether a line is a row (events then tell their columns) or a column.
        is_sensor_time: whether the words tell the sensor's own time, not that since the packet's time base.
    """

    name: str
    time_high: int
    time_low: int
    line: int
    event: int
    lines_are_rows: bool
    is_sensor_time: bool


EVT3 = Encoding("evt3", 0x8000, 0x6000, 0x0000, 0x2000, lines_are_rows=True, is_sensor_time=True)
LIBCAER_CMP = Encoding("libcaer_cmp", 0x0000, 0x1000, 0x2000, 0x3000, lines_are_rows=False, is_sensor_time=False)
ENCODINGS = {(240, 180): LIBCAER_CMP, (640, 480): EVT3, (1280, 720): EVT3}
"""What the drivers of cameras with such sensors send."""


@dataclass(frozen=True)
class Payload:
    """The words of one message.

    Attributes:
        words: uint16, shape (n,).
        time_highs: where the time highs stand, shape (m,).
        start_us: the message's start since that of the scene.
        first_us: time of the first event since the start of the scene.
    """

    words: WordArray
    time_highs: IntArray
    start_us: int
    first_us: int


class Packets:
    """A scene's messages at a rate, as bytes.

    They come round with the target: after a whole number of turns and of messages.

    Args:
        scene: what the sensor sees.
        rate: events per second.
        messages_per_s: how many messages they come in.

    Raises:
        BenchmarkError: messages would not last a whole number of microseconds.
    """

    def __init__(self, scene: LiveScene, rate: float, messages_per_s: int) -> None:
        if US_PER_S % messages_per_s:
            msg = f"{messages_per_s} messages/s do not last whole microseconds: choose a divisor of a million"
            raise BenchmarkError(msg)
        self.duration_us = US_PER_S // messages_per_s
        self._width, self._height = scene.width, scene.height
        self._encoding = ENCODINGS[scene.width, scene.height]
        self._loop_us = math.lcm(TURN_US, self.duration_us)
        count, rng = round(rate / messages_per_s), np.random.default_rng(SEED)
        self._payloads = [
            self._payload(scene.events(start_us, self.duration_us, count, rng), start_us)
            for start_us in range(0, self._loop_us, self.duration_us)
        ]

    def __len__(self) -> int:
        return len(self._payloads)

    def message(self, number: int, seq: int, start_ns: int) -> bytes:
        """A serialised EventPacket. Its header's stamp is the time of its first event.

        Args:
            number: of the message since the start of the scene.
            seq: its sequence number.
            start_ns: when the scene started (ns on the ROS clock): a multiple of `TIME_HIGH_NS`.
        """
        loop, index = divmod(number, len(self._payloads))
        payload = self._payloads[index]
        loop_start_ns = start_ns + loop * self._loop_us * NS_PER_US
        words, time_base_ns = payload.words, loop_start_ns + payload.start_us * NS_PER_US
        if self._encoding.is_sensor_time:
            words, time_base_ns = self._shifted(payload, loop_start_ns), 0
        writer = Writer()
        write_header(writer, Header(loop_start_ns + payload.first_us * NS_PER_US, FRAME_ID))
        writer.u32(self._height)
        writer.u32(self._width)
        writer.u64(seq)
        writer.u64(time_base_ns)
        writer.string(self._encoding.name)
        writer.u8(0)
        writer.byte_sequence(words)
        return writer.finish()

    def _payload(self, events: Events, start_us: int) -> Payload:
        us = events.t // NS_PER_US
        told_us = us if self._encoding.is_sensor_time else us - start_us
        line, along = (events.y, events.x) if self._encoding.lines_are_rows else (events.x, events.y)
        codes = (self._encoding.time_high, self._encoding.time_low, self._encoding.line, self._encoding.event)
        words, time_highs = _encode(told_us, line, along, events.p, *codes)
        return Payload(words, time_highs, start_us, int(us[0]))

    def _shifted(self, payload: Payload, loop_start_ns: int) -> WordArray:
        """The payload's words in a loop that starts then, on a sensor whose clock is as the ROS clock, but wraps."""
        words = payload.words.copy()
        highs = (words[payload.time_highs] + (loop_start_ns // TIME_HIGH_NS & TIME_MASK)) & TIME_MASK
        words[payload.time_highs] = highs | self._encoding.time_high
        return words


@njit(cache=True, nogil=True)
def _encode(
    us: IntArray,
    line: WordArray,
    along: WordArray,
    polarity: npt.NDArray[np.uint8],
    high_code: int,
    low_code: int,
    line_code: int,
    event_code: int,
) -> tuple[WordArray, IntArray]:
    """The words of events in time order, and where the time highs stand; what stays as it was is not said again."""
    words = np.empty(WORDS_PER_EVENT_MAX * len(us), np.uint16)
    highs = np.empty(len(us), np.int64)
    n = n_highs = 0
    last_high = last_us = last_line = np.int64(-1)
    for i in range(len(us)):
        high = us[i] >> TIME_BITS
        if high != last_high:
            words[n] = high_code | (high & TIME_MASK)
            highs[n_highs] = n
            n += 1
            n_highs += 1
        if us[i] != last_us:
            words[n] = low_code | (us[i] & TIME_MASK)
            n += 1
        if us[i] != last_us or line[i] != last_line:
            words[n] = line_code | line[i]
            n += 1
        words[n] = event_code | np.int64(polarity[i]) << 11 | along[i]
        n += 1
        last_high, last_us, last_line = high, us[i], np.int64(line[i])
    return words[:n].copy(), highs[:n_highs].copy()
