"""A target's first motion: that for which its events agree with one another, before there is a model to fit."""

from __future__ import annotations

import math

import numpy as np

from etd_ros.tracking.contour_kernels import AGE, Float32Array, coherence, splat
from etd_ros.tracking.contours import BORDER_CELLS, MARGIN, Contours, oval
from etd_ros.tracking.surface import TimeSurface

LOOKS = 10
"""Looks that the start lasts, or more, until the target has moved by MOTION_MIN_PX."""
MOTION_MIN_PX, MOTION_MAX_PX = 2.0, 8.0
TIME_MAX_S = 0.5
STEPS_PX = ((0.5, 2), (0.25, 1))
"""(distance of the candidates (pixels at the end of the motion), how many of them to each side), coarse to fine."""
EVENTS_MIN = 20
CHANGE_WEIGHT = 0.001
"""How much coherence a pixel of change (squared) has to bring."""
LOOKS_KNOWN = 10
PARTS = 4
"""The time so far is taken in so many parts, whose events have to agree."""
CELL = 1.5
"""Cells of the start-up in those of the model: coarser ones are faster, and find the same motion."""
GRID_MARGIN = 1.5
"""Width and height of the start-up's grid in those of the box: what lies round the target must not agree as well."""


class StartUp:
    """Collects a target's first events and moves its pose at the constant velocity with which they agree best.

    The target is at its box at its start stamp, and the first frame may come a while later: so the model is drawn
    round where it was, and the pose is what the motion makes of it.
    """

    def __init__(self, contours: Contours) -> None:
        self._contours = contours
        self._pose = contours.pose.copy()
        self._start_ns = contours.stamp_ns
        self._cell_px = CELL * contours.cell_px
        width, height = (side / self._cell_px for side in contours.size_px)
        columns, rows = (math.ceil(side * GRID_MARGIN) + BORDER_CELLS for side in (width, height))
        self._weight = oval(rows, columns, width, height)
        self._parts = np.zeros((PARTS, 2, rows, columns), np.float32)
        self._room = np.zeros((2, rows, columns), np.float32)
        self._collected: list[Float32Array] = []

    def look(self, surface: TimeSurface) -> bool:
        """Take the newest events; whether the start is over and the model is known."""
        contours = self._contours
        since_ns = contours.stamp_ns if self._collected else surface.start_ns
        elapsed_s = (surface.stamp_ns - since_ns) * 1e-9
        x, y = contours.predicted(surface.stamp_ns)
        window = surface.window(contours.box_at(x, y).scaled(MARGIN), contours.config.search_radius + 2)
        points, count = surface.points(window, elapsed_s)
        self._collect(points[:count], surface.stamp_ns)
        time_s = (surface.stamp_ns - self._start_ns) * 1e-9
        events = np.ascontiguousarray(np.concatenate(self._collected))
        if len(events) >= EVENTS_MIN:
            self._fit(events, max(time_s, elapsed_s, 1e-3))
        contours.pose[:2] = self._pose[:2] + contours.velocity * time_s
        contours.stamp_ns = surface.stamp_ns
        moved = contours.speed_px_s * time_s
        if (len(self._collected) < LOOKS or moved < MOTION_MIN_PX) and moved < MOTION_MAX_PX and time_s < TIME_MAX_S:
            return False
        self._finish(events, moved)
        return True

    def _collect(self, points: Float32Array, stamp_ns: int) -> None:
        """Keep points with ages that count backwards from the start."""
        kept = points.copy()
        kept[:, AGE] -= np.float32((stamp_ns - self._start_ns) * 1e-9)
        self._collected.append(kept)

    def _fit(self, events: Float32Array, time_s: float) -> None:
        """The velocity with which the events agree best, coarse to fine, near the one so far."""
        contours = self._contours
        so_far = contours.velocity.copy()
        best = so_far.copy()
        for step_px, reach in STEPS_PX:
            middle, top = best.copy(), -np.inf
            for j in range(-reach, reach + 1):
                for i in range(-reach, reach + 1):
                    velocity = middle + np.array([i, j]) * (step_px / time_s)
                    change_px = float(((velocity - so_far) ** 2).sum()) * time_s**2
                    agreement = coherence(
                        events, len(events), self._weight, self._pose, self._cell_px, velocity, time_s, self._parts,
                        self._room,
                    ) * np.exp(-CHANGE_WEIGHT * change_px)  # fmt: skip
                    if agreement > top:
                        best, top = velocity, agreement
        contours.velocity = best

    def _finish(self, events: Float32Array, moved_px: float) -> None:
        contours = self._contours
        speed = contours.speed_px_s
        splat(events, len(events), self._pose, contours.cell_px, contours.velocity, contours.drawn)
        direction = contours.velocity / speed if speed > 1e-6 else np.zeros(2)
        contours.begin(direction, max(1.0, moved_px / contours.config.window_px), LOOKS_KNOWN)
