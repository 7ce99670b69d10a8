"""Whether a target stands still in what a camera slides past: it moves as all of that does then, and keeps its size.

Things with few edges, many of them slanted, hardly tell whether they move in that direction or across it, or grow:
where they are not held to it, the box goes astray bit by bit.
"""

from __future__ import annotations

import math

from etd_ros.tracking.body import Body, Velocity, nearer
from etd_ros.tracking.camera_slide import Direction

SHARE = 0.1
"""Of what looks say across the direction, and of growing, so much is believed."""
AVERAGE_S = 0.2
"""How looks move is averaged over so long."""
STRAYS_FROM, STRAYS_UNTIL = math.tan(math.radians(6)), math.tan(math.radians(4))
"""What goes across by more than this share of its way along moves by itself, until it is less than that."""
STRAYS_NOW = 0.2
"""What is not held to the direction yet has to go along now as well, to this share: looks of so long say too late that
it turns."""
ACROSS_PX_S, ALONG_MIN_PX_S = 1.5, 5.0
"""So fast looks go across by chance; what is slower along has no direction."""
FAR_PX = 1.5
"""What looks find so far across from where it is held has set off by itself, and is believed in full."""


class SlidPast:
    """Follows where looks find one target, and whether that goes the way of all that the camera sees.

    Attributes:
        direction: in which the target goes with all; None if it is not known to, or moves by itself.
    """

    def __init__(self) -> None:
        self.direction: Direction | None = None
        self._last: tuple[float, float, int] | None = None
        self._velocity: Velocity | None = None
        self._across_share = SHARE

    def begin(self, velocity: Velocity, all_go: Direction) -> None:
        """The target's start says that it goes the way of all, at this velocity, x and y (pixels/s)."""
        self._last, self._velocity, self.direction = None, velocity, all_go

    def take(self, x: float, y: float, stamp_ns: int, body: Body, all_go: Direction | None) -> None:
        """Take where a look finds the target.

        Args:
            x: the column of its middle (pixels).
            y: the row of it (pixels).
            stamp_ns: when (ns).
            body: the target's, which has not gone there yet.
            all_go: the direction in which all moves that the camera sees; None where that is not known.
        """
        last, self._last = self._last, (x, y, stamp_ns)
        if last is not None and stamp_ns > last[2]:
            elapsed_s = (stamp_ns - last[2]) * 1e-9
            way = (x - last[0]) / elapsed_s, (y - last[1]) / elapsed_s
            self._velocity = nearer(self._velocity or body.velocity, way, elapsed_s / (elapsed_s + AVERAGE_S))
        if all_go is None or self._velocity is None:
            self.direction = None
            return
        if self.direction is None:
            goes_along = _goes_along(self._velocity, all_go, STRAYS_UNTIL)
            goes_along = goes_along and _goes_along(body.velocity, all_go, STRAYS_NOW)
        else:
            goes_along = _goes_along(self._velocity, all_go, STRAYS_FROM)
        self.direction = all_go if goes_along else None
        here_x, here_y, _, _ = body.pose
        _, off_px = parts_of((x - here_x, y - here_y), all_go)
        self._across_share = SHARE + (1 - SHARE) * min(1.0, (off_px / FAR_PX) ** 2)

    def held(self, vector: tuple[float, float]) -> tuple[float, float]:
        """A step or a velocity, x and y, as far as it is believed: of what goes across a little, and more the farther
        the last look was off."""
        if self.direction is None:
            return vector
        x, y = self.direction
        along, across = parts_of(vector, self.direction)
        across *= self._across_share
        return along * x - across * y, along * y + across * x


def _goes_along(velocity: Velocity, direction: Direction, strays: float) -> bool:
    """Whether a velocity has a direction, but for such a share."""
    along, across = parts_of(velocity, direction)
    return along > ALONG_MIN_PX_S and abs(across) < ACROSS_PX_S + strays * along


def parts_of(vector: tuple[float, float], direction: Direction) -> tuple[float, float]:
    """What of a vector goes along a direction, and what across it, to the right of who looks along it."""
    (x, y), (right, down) = vector, direction
    return right * x + down * y, right * y - down * x
