"""What bounds the targets that messages may ask for: how many, how far ahead, and what is said of those refused."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from etd_ros.nodes.base import EtdNode
from etd_ros.nodes.remarks import REMARKS_PERIOD_S, Throttle
from etd_ros.tracking import TargetReport, TargetState

START_AHEAD_MAX_S = 10.0
"""A message's box is of what was seen, so its stamp is that of events that have come. A start that is farther ahead (s)
is on another clock and may never come; by less, clocks of machines differ that are only roughly set."""
START_LATE_MAX_S = 0.15
"""What moves has left a box that is older (s) when tracking begins there."""
KNOWN_S = 10.0
"""So long after a frame (s) it is known what time the events' clock has."""
LOST_MIN_S = 3.0
"""A target that is lost for so long (s) makes room for a new one: what is found again mostly is found before."""
NAMES_SAID_MAX = 3
REASONS_MAX = 16
"""More than there are: none hides another."""


class EventClock:
    """What time it is on the events' clock: the newest frame's, and what has gone by since it came."""

    def __init__(self) -> None:
        self._stamp_ns: int | None = None
        self._noted_ns = 0

    def note(self, stamp_ns: int) -> None:
        """A frame has come (ns)."""
        self._stamp_ns = stamp_ns
        self._noted_ns = time.monotonic_ns()

    def ahead_s(self, stamp_ns: int) -> float:
        """How long a time (ns) is still to come (s); 0 where it is past, or not known as no frame has come, or none for
        long: the next one may be of another recording."""
        quiet_ns = time.monotonic_ns() - self._noted_ns
        if self._stamp_ns is None or quiet_ns > KNOWN_S * 1e9:
            return 0.0
        # Before a quiet scene no frames come, and whoever looks at it goes on sending boxes.
        return max(0.0, (stamp_ns - self._stamp_ns - quiet_ns) * 1e-9)


class LostTimes:
    """For how long each target has been lost. Stamps that go back, as those of a looping bag, take nothing from it."""

    def __init__(self) -> None:
        self._stamp_ns: int | None = None
        self._lost_ns: dict[str, int] = {}

    def note(self, stamp_ns: int, reports: Iterable[TargetReport]) -> None:
        """Take the targets' states after a frame (ns)."""
        elapsed_ns = 0 if self._stamp_ns is None else max(0, stamp_ns - self._stamp_ns)
        self._stamp_ns = stamp_ns
        lost = [report.name for report in reports if report.state is TargetState.LOST]
        self._lost_ns = {name: self._lost_ns[name] + elapsed_ns if name in self._lost_ns else 0 for name in lost}

    def long_lost(self) -> list[str]:
        """The targets that are lost for LOST_MIN_S or more, the longest first."""
        names = [name for name, lost_ns in self._lost_ns.items() if lost_ns >= LOST_MIN_S * 1e9]
        return sorted(names, key=lambda name: -self._lost_ns[name])


class _Unsaid(NamedTuple):
    """How many errors were not told since a time (s), and what there is to say of the last one."""

    since_s: float
    number: int
    text: str


class Refusals:
    """Counts the targets that a node refuses as its errors, and says why.

    Each reason is said at most every few seconds, so that no sender floods the log, and none hides another. What is
    not said is told together afterwards: whoever asks for a target shall not wait for it in vain.

    Args:
        node: whose errors they are.
        now_s: a clock that only goes forth (s).
    """

    def __init__(self, node: EtdNode, now_s: Callable[[], float] = time.monotonic) -> None:
        self._node = node
        self._now_s = now_s
        self._throttle = Throttle(REMARKS_PERIOD_S, REASONS_MAX)
        self._lock = threading.Lock()
        self._unsaid: _Unsaid | None = None

    def note(self, reason: str, text: str, count: int = 1) -> None:
        """So many targets were refused for a reason; `text` says what, why, and what to do."""
        if self._throttle.lets(reason, self._now_s()):
            self.say(text, count)
            return
        self._node.errors += count
        with self._lock:
            before = self._unsaid or _Unsaid(self._now_s(), 0, "")
            self._unsaid = _Unsaid(before.since_s, before.number + count, text)

    def say(self, text: str, count: int = 1) -> None:
        """The same for what does not come again and again."""
        self._node.errors += count
        self._warn(text)

    def say_rest(self) -> None:
        """Say how many were not told, and what the last one was, once the time is over in which they were not to be.
        Any thread may call this, often."""
        with self._lock:
            rest = self._unsaid
            if rest is None or self._now_s() - rest.since_s < REMARKS_PERIOD_S:
                return
            self._unsaid = None
        self._warn(f"{rest.number} more such remarks in the last {REMARKS_PERIOD_S:g} s, the last one: {rest.text}")

    def _warn(self, text: str) -> None:
        self._node.get_logger().warning(f"{' '.join(text.split())} ({self._node.errors} so far)")


def named(names: Sequence[str]) -> str:
    """Names in words, a few of them."""
    words = ", ".join(f"{name[:80]!r}" if name else "one without a name" for name in names[:NAMES_SAID_MAX])
    more = len(names) - NAMES_SAID_MAX
    return f"{words} and {more} more" if more > 0 else words
