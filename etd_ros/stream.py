"""Decoded batches to streams: what a camera, a network or a looping bag does to time is met once, here."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from etd_ros.borrowing_kernel import borrowing_kernel
from etd_ros.events import Events
from etd_ros.parameters import Parameters, parameter

NS_PER_S = 1_000_000_000
LOST_MESSAGES_MAX = 1_000_000
"""A sequence number that leaps farther says nothing about how many messages there were."""
RESTARTS_MAX = 8
"""A batch in which time goes back too far more often is not of recordings that follow one another but damaged: to start
a stream again costs milliseconds, and each event may ask for it."""


@dataclass(frozen=True, slots=True)
class StreamConfig(Parameters):
    """What a stream survives."""

    step_back_max_s: float = parameter(
        0.1,
        "longest step back in time (s) that is survived by holding the latest time; a longer one starts a new stream",
        low=0.0,
        high=3600.0,
    )


class Restart(str, Enum):
    """Why a stream ended and the next one begins."""

    TIME_STEP_BACK = "time went back"
    """By more than `step_back_max_s`: a bag loops, a camera was restarted."""
    SIZE = "the sensor size changed"
    ENCODING = "the encoding changed"
    GAP = "messages were lost"
    """The publisher's sequence number did not go up by one (where it went back with the time, a bag loops)."""
    DROPPED = "this node did not keep up and dropped messages: give it less to do, or a longer queue (queue_s)"
    PAUSE = "nobody read for a while"
    """A node reads no events while nobody wants what it makes, or while it is not active."""


@dataclass(frozen=True, slots=True)
class StreamBatch:
    """Events of one stream.

    Attributes:
        events: one or more events; their times never decrease within a stream, over all its batches.
        restart: why a new stream starts with this batch; None where the stream goes on, and for the first stream.
    """

    events: Events
    restart: Restart | None


@dataclass(slots=True)
class StreamCounters:
    """What happened since the guard was made.

    Attributes:
        gaps: times that the sequence number did not go up by one.
        lost_messages: messages missing in those gaps, where the number went forward, by a million at most.
        restarts: streams started after the first.
        steps_back: streams started because time went back.
        clamped_events: events whose time was raised to the latest one seen.
    """

    gaps: int = 0
    lost_messages: int = 0
    restarts: int = 0
    steps_back: int = 0
    clamped_events: int = 0


class StreamGuard:
    """Splits batches into streams, in each of which time never decreases.

    The offline engine and the live nodes use the same guard, so both restart at the same events.

    Args:
        config: what a stream survives.
        counters: to count in, where an earlier guard's are to go on.
    """

    def __init__(self, config: StreamConfig | None = None, counters: StreamCounters | None = None) -> None:
        self.counters = counters or StreamCounters()
        self.use(config or StreamConfig())
        self._latest_ns: int | None = None
        self._size: tuple[int, int] | None = None
        self._encoding: str | None = None
        self._seq: int | None = None
        self._restart: Restart | None = None

    def use(self, config: StreamConfig) -> None:
        """Have another configuration hold from the next batch on."""
        self._step_back_max_ns = round(config.step_back_max_s * NS_PER_S)

    def feed(
        self, events: Events, seq: int | None = None, encoding: str | None = None, dropped: int = 0
    ) -> Iterator[StreamBatch]:
        """Take the next batch; yield it as one or more batches of streams, without a copy where nothing is wrong.

        After RESTARTS_MAX long steps back in one batch the latest time is held over all others.

        Args:
            events: decoded events, which may step back in time; an empty batch yields nothing.
            seq: the message's sequence number, where its type has one.
            encoding: the message's encoding, where known.
            dropped: messages before it that came and were not to be fed: these are not lost.
        """
        self._note_changes(events, seq, encoding, dropped)
        restarts_left = RESTARTS_MAX
        while len(events):
            latest_ns = int(events.t[0]) if self._latest_ns is None else self._latest_ns
            part = self._in_order(events, latest_ns, may_restart=restarts_left > 0)
            if len(part):
                yield self._started(part)
            events = events[len(part) :]
            if len(events):
                self._end_stream(Restart.TIME_STEP_BACK)
                restarts_left -= 1

    def _note_changes(self, events: Events, seq: int | None, encoding: str | None, dropped: int) -> None:
        missing = 0 if self._seq is None or seq is None else seq - self._seq - 1
        if 0 < missing <= dropped:
            self._end_stream(Restart.DROPPED)
        elif missing != 0:
            self.counters.gaps += 1
            lost = missing - dropped if missing > 0 else missing
            self.counters.lost_messages += lost if 0 < lost <= LOST_MESSAGES_MAX else 0
            starts_again = lost < 0 and self._steps_back(events)
            self._end_stream(Restart.TIME_STEP_BACK if starts_again else Restart.GAP)
        if self._encoding is not None and encoding is not None and encoding != self._encoding:
            self._end_stream(Restart.ENCODING)
        size = (events.width, events.height)
        if self._size is not None and size != self._size:
            self._end_stream(Restart.SIZE)
        self._size = size
        self._seq = self._seq if seq is None else seq
        self._encoding = self._encoding if encoding is None else encoding

    def _steps_back(self, events: Events) -> bool:
        """Whether a batch starts too long before the stream's latest event, as where a bag loops."""
        if self._latest_ns is None or not len(events):
            return False
        return int(events.t[0]) < self._latest_ns - self._step_back_max_ns

    def _end_stream(self, reason: Restart) -> None:
        # Before the first event there is no stream to end. A size outranks what came before it: it changes the most.
        if self._latest_ns is not None or (self._restart is not None and reason is Restart.SIZE):
            self._restart = reason
        self._latest_ns = None

    def _started(self, part: Events) -> StreamBatch:
        restart, self._restart = self._restart, None
        self.counters.restarts += restart is not None
        self.counters.steps_back += restart is Restart.TIME_STEP_BACK
        self._latest_ns = int(part.t[-1])
        return StreamBatch(part, restart)

    def _in_order(self, events: Events, latest_ns: int, *, may_restart: bool) -> Events:
        """The leading events of the same stream, with times that do not decrease; all of them unless another stream may
        begin."""
        ordered = _ordered_length(events.t, latest_ns)
        if ordered == len(events):
            return events
        t = events.t.copy()
        length, clamped = _clamp(t, latest_ns, self._step_back_max_ns, may_restart)
        self.counters.clamped_events += clamped
        return dataclasses.replace(events, t=t)[:length]


@borrowing_kernel
def _ordered_length(t: npt.NDArray[np.int64], latest_ns: int) -> int:
    """Number of leading times that do not decrease, from `latest_ns` on."""
    for i in range(len(t)):
        if t[i] < latest_ns:
            return i
        latest_ns = t[i]
    return len(t)


@borrowing_kernel
def _clamp(t: npt.NDArray[np.int64], latest_ns: int, step_back_max_ns: int, may_stop: bool) -> tuple[int, int]:
    """Raise times to the latest before them, in place; up to the first step back that is too long, if it may stop.

    Returns:
        (index of that step back, or the length; number of times raised).
    """
    clamped = 0
    for i in range(len(t)):
        if t[i] >= latest_ns:
            latest_ns = t[i]
        elif may_stop and t[i] < latest_ns - step_back_max_ns:
            return i, clamped
        else:
            t[i] = latest_ns
            clamped += 1
    return len(t), clamped
