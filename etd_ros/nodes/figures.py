"""What a node measures of itself: rates and latencies."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Mapping

import numpy as np

from etd_ros.conversion import Frame, FrameEnd

LATENCY_WINDOW_S = 10.0
LATENCIES_MAX = 20_000
PERCENTILES = (50, 95, 99)


class Latencies:
    """How long it took from a message to what came of it, over the last ten seconds. Any thread may ask."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._noted: deque[tuple[float, float]] = deque(maxlen=LATENCIES_MAX)

    def note(self, received_s: float) -> None:
        """What came of a message received at `received_s` (s, monotonic) is published now."""
        now_s = time.monotonic()
        with self._lock:
            self._noted.append((now_s, now_s - received_s))

    def diagnostics(self) -> dict[str, object]:
        """Percentiles for /diagnostics (ms); nan while there is nothing to measure, which plots leave out."""
        latest_s = time.monotonic() - LATENCY_WINDOW_S
        with self._lock:
            while self._noted and self._noted[0][0] < latest_s:
                self._noted.popleft()
            latencies_ms = [1e3 * latency_s for _, latency_s in self._noted]
        values = np.percentile(latencies_ms, PERCENTILES) if latencies_ms else ()
        texts = [f"{value:.2f}" for value in values] or ["nan"] * len(PERCENTILES)
        return {f"latency p{percent} ms": text for percent, text in zip(PERCENTILES, texts, strict=True)}


class Rates:
    """Counts to counts per second, from one report to the next."""

    def __init__(self) -> None:
        self._last_s = time.monotonic()
        self._last: dict[str, int] = {}

    def per_s(self, counts: Mapping[str, int]) -> dict[str, object]:
        """The rates since the last call, for /diagnostics. A count that has started anew counts from 0."""
        now_s = time.monotonic()
        passed_s = max(now_s - self._last_s, 1e-3)
        rates: dict[str, object] = {}
        for name, count in counts.items():
            last = self._last.get(name, 0)
            rates[f"{name} per s"] = f"{(count - last if count >= last else count) / passed_s:.1f}"
        self._last_s, self._last = now_s, dict(counts)
        return rates


class FrameFigures:
    """How the frames of a node ended.

    Args:
        interval: [alpha, beta], in which a frame's NZGE is to lie.
    """

    def __init__(self, interval: tuple[float, float]) -> None:
        self.interval = interval
        self._ends = dict.fromkeys(FrameEnd, 0)
        self._outside = 0
        self._last_nzge = 0.0

    @property
    def frames(self) -> int:
        """How many there were."""
        return sum(self._ends.values())

    def note(self, frame: Frame) -> None:
        """A frame is finished."""
        alpha, beta = self.interval
        self._ends[frame.end] += 1
        self._outside += not alpha <= frame.nzge <= beta
        self._last_nzge = frame.nzge

    def diagnostics(self) -> dict[str, object]:
        """Counters for /diagnostics."""
        by_time = self._ends[FrameEnd.TIME_LIMIT]
        return {
            "frames": self.frames,
            "frames ended by NZGE": self._ends[FrameEnd.NZGE],
            "frames ended by time": by_time,
            "frames ended by window or count": self.frames - self._ends[FrameEnd.NZGE] - by_time,
            "frames outside the NZGE interval": self._outside,
            "last NZGE": f"{self._last_nzge:.4f}",
        }
