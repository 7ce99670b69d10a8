"""Where a target is said to be that has no events for a moment: it has stopped, or moves on unseen."""

from __future__ import annotations

from dataclasses import dataclass

from etd_ros.boxes import Box
from etd_ros.tracking.body import Body
from etd_ros.tracking.surface import TimeSurface

MOVES_ON_S = 0.1
"""The box of what is fast moves on for so long."""


@dataclass(frozen=True, slots=True)
class Held:
    """What is said of a target without events.

    Attributes:
        box: where it is if it has stopped (pixels).
        moving: where it would be at `stamp_ns` (ns) if it moved on (pixels), and its velocity, x and y (pixels/s); None
            where that is not believed.
        surface: what the sensor sees.
    """

    box: Box
    moving: tuple[Box, float, float] | None
    stamp_ns: int
    surface: TimeSurface

    def moves_on(self, stamp_ns: int) -> bool:
        """Whether it is said to move on still (ns)."""
        return self.moving is not None and stamp_ns - self.stamp_ns <= MOVES_ON_S * 1e9

    def box_at(self, stamp_ns: int) -> Box:
        """Where it is said to be at a time (pixels)."""
        if self.moving is None or not self.moves_on(stamp_ns):
            return self.box
        since_s = (stamp_ns - self.stamp_ns) * 1e-9
        (x, y, w, h), right_px_s, down_px_s = self.moving
        moved = Box(x + right_px_s * since_s, y + down_px_s * since_s, w, h)
        # Beyond the border it would be gone; what turns back there has not left.
        return moved if self.surface.holds(*moved.center) else self.box


def moving_on(body: Body, stamp_ns: int) -> tuple[Box, float, float] | None:
    """`Held.moving` of a target that has no events from now on, by the motion that its last looks saw, sure or not."""
    if not body.is_fast:
        return None
    right_px_s, down_px_s = body.velocity
    return body.box_at(*body.predicted(stamp_ns)), right_px_s, down_px_s
