"""The newest events of the whole sensor, read back from frames: what discovery looks at."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from etd_ros.tracking.discovery_kernels import Float32Array, Int32Array, count_recent, enter, supported_points

NEVER_NS = -(2**62)
FRAME_MAX_NS = 100_000_000
"""A frame is taken to have lasted no longer than this (ns): after a quiet time the next one starts late."""
POINTS_MAX = 65_536
"""Where more pixels have fired, every second, third, ... of them is looked at."""
CELL_PX = 4
SUPPORT_NS = 10_000_000
"""A pixel counts if a neighbour fired within this time (ns) of it; noise stands alone."""


class RecentEvents:
    """When each pixel fired last, from the grey levels of frames and their stamps.

    Attributes:
        width, height: sensor size (pixels).
        stamp_ns: the end of the newest frame (ns).
        times_of_each: when each pixel had its last event of each polarity (ns), int64, shape (height, width, 2).
        counts: points in each cell of CELL_PX pixels' side at the last call of `points`, int32, shape (rows, columns).
    """

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self.stamp_ns = NEVER_NS
        self.counts: Int32Array = np.zeros((-(-height // CELL_PX), -(-width // CELL_PX)), np.int32)
        self.times_of_each = np.full((height, width, 2), NEVER_NS, np.int64)
        self._times = np.full((height, width), NEVER_NS, np.int64)
        self._points = np.empty((POINTS_MAX, 3), np.float32)

    def take(self, stamp_ns: int, data: npt.NDArray[np.uint8]) -> None:
        """Enter a frame: its end (ns) and its levels, uint8, shape (height, width, 2).

        A stamp below the last one starts the stream again.
        """
        if stamp_ns < self.stamp_ns:
            self.forget()
        start_ns = max(self.stamp_ns, stamp_ns - FRAME_MAX_NS)
        levels = np.ascontiguousarray(data).view(np.uint16).ravel()
        of_each = self.times_of_each.reshape(-1, 2)
        enter(self._times.ravel(), of_each, levels, start_ns, stamp_ns - start_ns)
        self.stamp_ns = stamp_ns

    def forget(self) -> None:
        """Start a new stream."""
        self._times.fill(NEVER_NS)
        self.times_of_each.fill(NEVER_NS)
        self.stamp_ns = NEVER_NS

    def points(self, window_s: float) -> Float32Array:
        """The pixels that fired within the last `window_s` seconds, noise left out; valid until the next call.

        Returns:
            x, y (pixels, at the middle of the pixel) and age (s), float32, shape (n, 3).
        """
        oldest_ns = self.stamp_ns - round(window_s * 1e9)
        stride = 1 + int(count_recent(self._times, oldest_ns)) // POINTS_MAX
        n = supported_points(
            self._times, self.stamp_ns, oldest_ns, SUPPORT_NS, stride, CELL_PX, self._points, self.counts
        )  # fmt: skip
        return self._points[:n]
