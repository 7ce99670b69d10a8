"""Puts a target's box right while it is followed: a network that was trained on simulated targets sees by how much the
box has come off what it was at the start, and says how surely.

Contours are followed where they agree with what was learnt; what was learnt may be of a part, or of what lies behind.
How events move, and what the target looked like in its box at first, tells that apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from etd_ros.tracking.box_network import BoxMisfit
from etd_ros.tracking.box_view import CELLS, FIRST_CELLS, FIRST_SPAN, USUAL_SPAN, BoxView
from etd_ros.tracking.contour_kernels import Float32Array
from etd_ros.tracking.contours import Contours
from etd_ros.tracking.surface import TimeSurface

FIRST_LOOKS = 8
"""After so many looks the model shows what the target looked like at first."""
MOTION_PX, TIME_S = 3.0, 0.02
"""A box is put right after so much motion or time."""
SLOW_MARGIN_PX = 10.0
"""A slow target's box that is closer to the sensor's border is left alone: one that was put right there told late that
its target left."""
SPEED_MIN_PX_S = 5.0
"""Of what is slower, events do not tell."""
ANSWERS_NS = 20_000_000
"""What was seen longer ago may be of another place."""
EVENTS_MIN = 25
SPAN_PX, SPAN_SHARE, SPAN_S = 6.0, 0.25, (0.004, 0.06)
"""Events of so much motion are looked at, or of this share of the box's size, if that is more; within these times."""
VIEW_MARGIN = 2.8
"""Width and height of what is looked at in those of the box: twice as wide and high, and where that was before."""
MISFIT_USUAL = 0.08
"""How far boxes are off usually, in parts of their size: what is told less surely than that counts less."""
MODEL_TIMES = 2.0
"""What a fast target's size is surely off by is taken on by its model, too, at so many times the gain: looks have not
seen it grow."""


Corrector = Callable[[BoxView], BoxMisfit]
"""What says how far a box is off: a network's `misfit_of`."""


class BoxRefinement:
    """What puts one target's box right.

    Args:
        target: its name.
        corrector: says how far the box is off.
        gain: the share of that which is taken on at once where it is told surely, 0 to 1.
        start_stamp_ns: when the target started (ns).
    """

    def __init__(self, target: str, corrector: Corrector, gain: float, start_stamp_ns: int) -> None:
        self._target, self._corrector, self._gain, self._start_ns = target, corrector, gain, start_stamp_ns
        self._first: Float32Array | None = None
        self._looks = 0
        self._waiting: BoxView | None = None
        self._stamp_ns = start_stamp_ns

    @property
    def is_waiting(self) -> bool:
        """Whether there is something for `answer`."""
        return self._waiting is not None

    def keep(self, contours: Contours, surface: TimeSurface) -> None:
        """Keep the surface up to date as far round a fast target as the network will look. Of others it sees what their
        own looks have kept: more would bring old events into those."""
        if not _takes_all_on(contours):
            return
        body = contours.body
        around = body.box_at(*body.predicted(surface.stamp_ns)).scaled(VIEW_MARGIN)
        surface.keep(surface.window(around, 0.0))

    def take(self, contours: Contours, surface: TimeSurface, patience: float) -> None:
        """Put a fast target's box right, where it is time, or keep what is seen of a slow one's for `answer`, which
        waits `patience` times as long; the target has just been followed, surely."""
        self._looks += 1
        if self._first is None:
            if self._looks < FIRST_LOOKS:
                return
            self._first = contours.usual_maps()
        elapsed_s = (surface.stamp_ns - self._stamp_ns) * 1e-9
        speed_px_s = contours.body.speed_px_s
        takes_all_on = _takes_all_on(contours)
        times = 1.0 if takes_all_on else patience
        is_soon = speed_px_s * elapsed_s < times * MOTION_PX and elapsed_s < times * TIME_S
        if speed_px_s <= SPEED_MIN_PX_S or is_soon:
            return
        # Beyond the border nothing is seen.
        if surface.inside_px(contours.body.box) < (0.0 if takes_all_on else SLOW_MARGIN_PX):
            return
        self._stamp_ns = surface.stamp_ns
        view = self._view(contours, surface, self._first)
        if len(view.points) < EVENTS_MIN:
            return
        if takes_all_on:
            self._put_right(contours, view, takes_all_on=True)
        else:
            # The next look may write over these.
            self._waiting = replace(view, points=view.points.copy())

    def answer(self, contours: Contours, stamp_ns: int) -> None:
        """Put a slow target's box right by what was seen at an earlier frame than that of this time (ns): a look and
        the network together would take twice as long as either."""
        view, self._waiting = self._waiting, None
        if view is not None and stamp_ns - view.stamp_ns <= ANSWERS_NS:
            self._put_right(contours, view, takes_all_on=False)

    def _put_right(self, contours: Contours, view: BoxView, *, takes_all_on: bool) -> None:
        misfit = self._corrector(view)
        # Of what is covered in part the rest is seen, and would become the box.
        seen, beyond = 1 - contours.covered, _beyond_spreads(misfit)
        sureness = seen / (1 + 2 * (misfit.spreads / MISFIT_USUAL) ** 2)
        offsets = misfit.offsets if takes_all_on else beyond
        contours.correct(np.asarray(self._gain * sureness * offsets, np.float64))
        if takes_all_on:
            contours.grow_on(min(1.0, MODEL_TIMES * self._gain) * seen * float(beyond[2:].mean()))

    def time_went_back(self, stamp_ns: int) -> None:
        """The stream goes on at an earlier time (ns)."""
        self._start_ns = self._stamp_ns = stamp_ns
        self._waiting = None

    def _view(self, contours: Contours, surface: TimeSurface, first: Float32Array) -> BoxView:
        body, box = contours.body, contours.body.box
        motion_px = max(SPAN_PX, SPAN_SHARE * math.sqrt(box.w * box.h))
        shortest_s, longest_s = SPAN_S
        span_s = min(max(motion_px / body.speed_px_s, shortest_s), longest_s)
        points, count = surface.points(surface.window(box.scaled(VIEW_MARGIN), 0), span_s)
        usual = np.empty((3, CELLS, CELLS), np.float32)
        contours.draw_usual(usual, USUAL_SPAN)
        was = np.empty((3, FIRST_CELLS, FIRST_CELLS), np.float32)
        contours.draw_first(first, was, FIRST_SPAN)
        return BoxView(
            target=self._target,
            stamp_ns=surface.stamp_ns,
            points=points[:count],
            span_s=span_s,
            box=box,
            velocity=np.array(body.velocity),
            usual=usual,
            first=was,
            sensor=(surface.width, surface.height),
            age_s=(surface.stamp_ns - self._start_ns) * 1e-9,
            growing_per_s=body.growing.per_s,
        )


def _takes_all_on(contours: Contours) -> bool:
    """Whether a target is so fast that all that the network says of its box is taken on."""
    body = contours.body
    return body.speed_px_s > SPEED_MIN_PX_S and body.sizes_per_s > contours.config.refine_sizes_per_s


def _beyond_spreads(misfit: BoxMisfit) -> Float32Array:
    """What a box is off by beyond what the network is usually wrong by itself: contours keep slow boxes to less than
    that, and it is wrong by the same from look to look."""
    return np.sign(misfit.offsets) * np.maximum(np.abs(misfit.offsets) - misfit.spreads, np.float32(0))
