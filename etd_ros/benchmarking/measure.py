"""Times of our code and of a peer, taken by turns in one process."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt


def _nothing() -> None:
    """No preparation."""


@dataclass(frozen=True)
class Subject:
    """Something to time.

    Attributes:
        name: what it is.
        run: the work that is timed.
        units: how much work one run does (events, or 1 for a call).
        prepare: makes the next run start like the first; not timed.
    """

    name: str
    run: Callable[[], object]
    units: int = 1
    prepare: Callable[[], object] = _nothing


def spread_of(values: npt.ArrayLike) -> float:
    """Interquartile range over median of some values, shape (n,)."""
    low, middle, high = np.percentile(np.asarray(values, np.float64), (25, 50, 75))
    return float((high - low) / middle)


@dataclass(frozen=True)
class Comparison:
    """Seconds that a unit of work took, ours and the peer's, a pair per round: float64, shape (rounds,)."""

    ours_s: npt.NDArray[np.float64]
    peer_s: npt.NDArray[np.float64] | None = None

    @property
    def ratio(self) -> float | None:
        """How many times as fast as the peer we are: the median over the rounds; None without a peer."""
        return None if self.peer_s is None else float(np.median(self.peer_s / self.ours_s))

    @property
    def spread(self) -> float:
        """Interquartile range over median of our times."""
        return spread_of(self.ours_s)


def compare(ours: Subject, peer: Subject | None, rounds: int) -> Comparison:
    """Run both `rounds` times after a run to warm up, by turns and each first in every other round.

    Times are of the process's CPU, over all its threads: neither other programs on the machine nor threads of a peer
    change the comparison.
    """
    subjects = [ours] if peer is None else [ours, peer]
    order = range(len(subjects))
    seconds = np.empty((len(subjects), rounds))
    with _alone():
        for subject in subjects:
            _seconds_per_unit(subject)
        for number in range(rounds):
            for which in order if number % 2 == 0 else reversed(order):
                seconds[which, number] = _seconds_per_unit(subjects[which])
    return Comparison(seconds[0], None if peer is None else seconds[1])


def _seconds_per_unit(subject: Subject) -> float:
    subject.prepare()
    start_s = time.process_time()
    subject.run()
    return max(time.process_time() - start_s, time.get_clock_info("process_time").resolution) / subject.units


@contextmanager
def _alone() -> Iterator[None]:
    """No garbage collection, and OpenCV on one thread."""
    was_enabled, threads = gc.isenabled(), cv2.getNumThreads()
    gc.collect()
    gc.disable()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
        if was_enabled:
            gc.enable()
