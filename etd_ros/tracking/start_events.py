"""The events that a target's start is told from, no more of them than a node has time for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from etd_ros.tracking.contour_kernels import AGE, POLARITY, Float32Array, Float64Array, X, Y

EVENTS_MAX = 12_000
"""Where there are more, every second one is left out, again and again: what moves has fewer, what flickers has hundreds
of thousands before its start is over, and each look would go through all of them dozens of times."""
SOME_EVENTS_MAX = 2000
"""Of more events every second, third, ... is enough to tell a target's from others, and to find what is fast."""
PIXELS_MAX = 65536
"""More than a sensor has along a side."""


class StartEvents:
    """Events of a start's looks.

    Attributes:
        looks: how many there were.
    """

    def __init__(self) -> None:
        self.looks = 0
        self._of_looks: list[Float32Array] = []
        self._stride = 1

    def take(self, points: Float32Array, since_s: float) -> None:
        """Take a look's points, shape (n, 4), so long after the start (s)."""
        kept = points[:: self._stride].copy()
        # Ages count backwards from the start.
        kept[:, AGE] -= np.float32(since_s)
        self._of_looks.append(kept)
        self.looks += 1
        self._thin()

    def replace(self, events: Float32Array) -> None:
        """Have these in place of all so far; their ages count backwards from the start. The looks still count."""
        self._of_looks, self._stride = [events], 1
        self._thin()

    @property
    def events(self) -> Float32Array:
        """Those of all looks, shape (n, 4)."""
        return np.concatenate([np.empty((0, 4), np.float32), *self._of_looks])

    def _thin(self) -> None:
        while sum(map(len, self._of_looks)) > EVENTS_MAX:
            self._of_looks = [of_look[::2] for of_look in self._of_looks]
            self._stride *= 2


@dataclass(slots=True)
class Reading:
    """Events of a start, and what they tell.

    Attributes:
        collected: the events.
        velocity: with which they agree best, as far as that is believed (pixels/s), float64, x and y.
        agreement: how well they do.
    """

    collected: StartEvents
    velocity: Float64Array
    agreement: float = 0.0


def some_of(values: Float32Array) -> Float32Array:
    """Values of every event, or of every second, third, ... where there are more than SOME_EVENTS_MAX."""
    return np.ascontiguousarray(values[:: 1 + len(values) // SOME_EVENTS_MAX])


def shares_of_pixels(events: Float32Array) -> Float32Array:
    """What each event counts, shape (n,), so that those of a pixel count as one together."""
    _, pixels, counts = np.unique(_pixel_numbers(events), return_inverse=True, return_counts=True)
    return np.asarray(1 / counts[pixels], np.float32)


def as_looks_see(events: Float32Array, window_s: float) -> Float32Array:
    """The newest event of each pixel and polarity in each window of time, counted back from the newest of all.

    That is what a look has of them: where an edge makes several events in a pixel the last, behind its middle. A model
    of all events would be found ahead of where it lies.
    """
    newest_first = events[np.argsort(events[:, AGE], kind="stable")]
    windows = ((newest_first[:, AGE] - newest_first[:1, AGE]) / window_s).astype(np.int64)
    key = (windows * PIXELS_MAX**2 + _pixel_numbers(newest_first)) * 2 + (newest_first[:, POLARITY] > 0)
    return np.ascontiguousarray(newest_first[np.unique(key, return_index=True)[1]])


def _pixel_numbers(events: Float32Array) -> npt.NDArray[np.int64]:
    """A number for each event's pixel, shape (n,)."""
    return events[:, Y].astype(np.int64) * PIXELS_MAX + events[:, X].astype(np.int64)
