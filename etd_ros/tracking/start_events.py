"""The events that a target's start is told from, no more of them than a node has time for."""

from __future__ import annotations

import numpy as np

from etd_ros.tracking.contour_kernels import AGE, Float32Array

EVENTS_MAX = 12_000
"""Where there are more, every second one is left out, again and again: what moves has fewer, what flickers has hundreds
of thousands before its start is over, and each look would go through all of them dozens of times."""


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
