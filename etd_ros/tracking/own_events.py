"""Which events at a target are its own: not those in the boxes of other targets, nor those of what lies behind it where
that moves otherwise."""

from __future__ import annotations

import numpy as np

from etd_ros.tracking.backdrop import Backdrop
from etd_ros.tracking.body import Body, Velocity
from etd_ros.tracking.contour_kernels import SCALE, Float32Array, Float64Array
from etd_ros.tracking.other_targets import OtherBoxes
from etd_ros.tracking.surface import NEVER_NS, TimeSurface

JOLT_NS = 50_000_000
"""What has moved as the target does within this time still belongs to the same scene: where it moves otherwise at once,
it is the camera that does, and the target with it."""


class OwnEvents:
    """Leaves out what is not the target's.

    Args:
        size_px: width and height of the target's box (pixels).
        cell_px: pixels of a model's cell.
        margin: width and height of the model in those of the box.
        margin_px: how far round the model events are known (pixels).

    Attributes:
        others: the boxes of other targets.
        backdrop: what lies behind the target.
        takes_backdrop: whether the events of what lies behind are kept as well.
    """

    def __init__(self, size_px: tuple[float, float], cell_px: float, margin: float, margin_px: float) -> None:
        self._margin, self._margin_px = margin, margin_px
        self.others = OtherBoxes()
        self.backdrop = Backdrop(size_px, cell_px, margin, margin_px)
        self.takes_backdrop = False
        self._left_out, self._together_ns = 0, NEVER_NS

    def see_backdrop(self, surface: TimeSurface, body: Body, span_s: float) -> None:
        """See how what lies behind moves, if it is time, for looks at the events of a time (s)."""
        if not self.backdrop.is_due(surface.stamp_ns, body.velocity, span_s):
            return
        x, y = body.predicted(surface.stamp_ns)
        window = surface.window(body.box_at(x, y, self._margin), self._margin_px)
        self.backdrop.look(surface, window, np.array([x, y, body.pose[SCALE], 0.0]))

    def keep(
        self, points: Float32Array, count: int, pose: Float64Array, velocity: Velocity, span_s: float, stamp_ns: int
    ) -> int:
        """Keep the points of a time (s) that ends at another (ns), in place, that are of a target with this pose and
        velocity (pixels/s); how many they are."""
        count = self.others.leave_out(points, count, stamp_ns)
        if self.backdrop.is_with(velocity, span_s):
            self._together_ns = stamp_ns
        if self.takes_backdrop:
            return count
        own = self.backdrop.keep_own(points, count, pose, velocity, span_s)
        self._left_out = count - own
        return own

    def may_lack_some(self, stamp_ns: int) -> bool:
        """Whether the events that were left out last, at a time (ns), may be the target's: what lies behind has just
        moved as it did, and at once does otherwise. So it is where the camera jolts, and with it all that it sees."""
        return self._left_out > 0 and 0 <= stamp_ns - self._together_ns < JOLT_NS
