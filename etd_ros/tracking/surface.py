"""The time surface that frames are read back into: when each pixel last fired, round the targets."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.tracking.camera_slide import Slide
from etd_ros.tracking.contour_kernels import Float32Array
from etd_ros.tracking.edge_flow import EdgeFlow, EdgeFlows, edge_flow, edge_flows
from etd_ros.tracking.flash import is_flash
from etd_ros.tracking.strewn import are_strewn
from etd_ros.tracking.surface_kernels import (
    fired_count,
    frame_points,
    keep_more_times,
    keep_times,
    kept_count,
    kept_points,
)

FRAME_MAX_NS = 100_000_000
"""A frame that does not tell its start is taken to have lasted no longer than this (ns): after a quiet time it starts
late."""
POINTS_MAX = 16_384
NEVER_NS = -(2**62)

Window = tuple[int, int, int, int]
"""Rows top .. bottom - 1, columns left .. right - 1."""


class TimeSurface:
    """The last event time of each pixel and polarity, from the grey levels of ATSLTD frames (their linear decay is what
    tells the time) and the frames' stamps. A frame starts where it says, or else where the one before it ended.

    Only windows that somebody asks for are kept up to date, unless all is: for many targets, which need not ask then.

    Attributes:
        keeps_all: whether all is kept up to date, from the next frame on.
        start_ns, stamp_ns: start and end of the newest frame (ns).
        before_ns: end of the one before it (ns).
        is_flash: whether it is of light that changed everywhere, so that there is nothing in it to keep.
        has_just_halted: whether the camera has come to a halt just now, so that what stands has no events.
        sees_motion: whether pixels fire all over the sensor, as before a camera that moves.
        slide: what all do that a sliding camera sees; None where that is not known.
        width, height: sensor size (pixels).
    """

    def __init__(self, width: int, height: int) -> None:
        self.width = width
        self.height = height
        self.stamp_ns = NEVER_NS
        self.start_ns = NEVER_NS
        self.before_ns = NEVER_NS
        self.keeps_all = self.is_flash = self.has_just_halted = self.sees_motion = False
        self.slide: Slide | None = None
        self._times = np.full((height, width, 2), NEVER_NS, np.int64)
        self._points = np.empty((POINTS_MAX, 4), np.float32)
        self._times_of_rows = self._times.reshape(height, 2 * width)
        self._data: npt.NDArray[np.uint8] = np.zeros((0, 0, 2), np.uint8)
        self._levels_of_rows: npt.NDArray[np.uint8] = np.zeros((0, 0), np.uint8)
        self._kept = np.zeros((height, 2), np.int64)

    def take(self, stamp_ns: int, data: npt.NDArray[np.uint8], start_ns: int | None = None) -> None:
        """Go on to the next frame: its end (ns), its levels, uint8, shape (height, width, 2), and its start (ns), by
        default where the last one ended.

        A stamp below the last one starts the stream again.
        """
        if stamp_ns < self.stamp_ns:
            self._times.fill(NEVER_NS)
            self.stamp_ns = NEVER_NS
        if start_ns is None:
            start_ns = max(self.stamp_ns, stamp_ns - FRAME_MAX_NS)
        self.start_ns = start_ns
        self.before_ns, self.stamp_ns = self.stamp_ns, stamp_ns
        self.is_flash = is_flash(data)
        self._data = data
        self._levels_of_rows = np.ascontiguousarray(data).reshape(self.height, 2 * self.width)
        self._kept.fill(0)
        if self.keeps_all and not self.is_flash:
            self._enter((0, self.height, 0, self.width))

    def holds(self, x: float, y: float) -> bool:
        """Whether a place (pixels) lies on the sensor."""
        return 0 <= x < self.width and 0 <= y < self.height

    def inside_px(self, box: Box) -> float:
        """How far a box is from the sensor's border, pixels; below 0 where a part of it lies beyond."""
        return min(box.x, box.y, self.width - box.x - box.w, self.height - box.y - box.h)

    def window(self, box: Box, margin: float) -> Window:
        """The pixels in a box and a margin (pixels) round it, as far as they lie on the sensor."""
        x, y, w, h = box
        left, top = math.floor(x - margin), math.floor(y - margin)
        right, bottom = math.ceil(x + w + margin), math.ceil(y + h + margin)
        # Asked for several times a target and frame: calls of `max` and `min` would take most of the time.
        left, top = left if left > 0 else 0, top if top > 0 else 0
        right, bottom = right if right < self.width else self.width, bottom if bottom < self.height else self.height
        return top, bottom if bottom > top else top, left, right if right > left else left

    def keep(self, window: Window) -> int:
        """Enter the newest frame's events of a window, unless all are entered; how many pixels they are."""
        return int(fired_count(self._levels_of_rows, *window)) if self.keeps_all else self._enter(window)

    def _enter(self, window: Window) -> int:
        duration_ns = self.stamp_ns - self.start_ns
        return int(keep_times(self._times_of_rows, self._levels_of_rows, self.start_ns, duration_ns, *window))

    def keep_too(self, window: Window) -> None:
        """The same of a window that overlaps with others that are kept so, as those of where a lost target may be."""
        if self.keeps_all:
            return
        duration_ns = self.stamp_ns - self.start_ns
        keep_more_times(self._times_of_rows, self._levels_of_rows, self.start_ns, duration_ns, *window, self._kept)

    def points(self, window: Window, duration_s: float) -> tuple[Float32Array, int]:
        """The events of a window that are at most so old, as points, and their number; valid until the next call."""
        oldest_ns = self.stamp_ns - int(duration_s * 1e9)
        return self._points, int(kept_points(self._times, self.stamp_ns, oldest_ns, *window, self._points))

    def shows_noise(self, window: Window, duration_s: float) -> bool:
        """Whether the events of a window that are at most so old are strewn, as those of no edge are."""
        return bool(are_strewn(self._times, self.stamp_ns, duration_s, *window))

    def flow(
        self, window: Window, duration_s: float, x: float, y: float, *, may_turn: bool = False, by_edge: bool = False
    ) -> EdgeFlow | None:
        """How the edges in a window move and grow, and turn if they may, round a place (pixels), by events that are at
        most so old; by_edge as for `edge_flow`."""
        return edge_flow(self._times, self.stamp_ns, duration_s, window, x, y, may_turn=may_turn, by_edge=by_edge)

    def flows(self, window: Window, duration_s: float, x: float, y: float) -> EdgeFlows | None:
        """The same without turning round the place and with it."""
        return edge_flows(self._times, self.stamp_ns, duration_s, window, x, y)

    def count(self, window: Window, duration_s: float) -> int:
        """How many events of a window are at most so old."""
        return int(kept_count(self._times_of_rows, self.stamp_ns, self.stamp_ns - int(duration_s * 1e9), *window))

    def newest(self, window: Window) -> tuple[Float32Array, int]:
        """The newest frame's events of a window, kept or not, as points, and their number; valid until the next
        call."""
        duration_s = (self.stamp_ns - self.start_ns) * 1e-9
        return self._points, int(frame_points(self._data, duration_s, *window, self._points))
