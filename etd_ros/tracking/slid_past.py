"""Whether a target stands still in what a camera slides past: it moves as all of that does then, and keeps its size.

Things with few edges, many of them slanted, hardly tell whether they move in that direction or across it, or grow:
where they are not held to it, the box goes astray bit by bit.
"""

from __future__ import annotations

import math

from etd_ros.tracking.body import Body, Standing, Velocity, nearer
from etd_ros.tracking.camera_slide import Direction, Slide

SHARE = 0.05
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
OFF_PX = 1.0
"""A box that has come off its way from its start by this and by STRAYS_FROM of that has gone another one."""
GROWS_PER_S = 0.1
"""What is known to grow or shrink by more (the logarithm of its scale, 1/s) does not keep its size."""
BEFORE_S = 0.2
"""What started so long before the direction is known to have been that has gone that way, too."""


class SlidPast:
    """Follows where looks find one target, and whether that goes the way of all that the camera sees.

    Attributes:
        direction: in which the target goes with all; None if it is not known to, or moves by itself.
    """

    def __init__(self) -> None:
        self.direction: Direction | None = None
        self._start: Standing | None = None
        self._last: tuple[float, float, int] | None = None
        self._velocity: Velocity | None = None
        self._across_share = SHARE

    def begin(self, start: Standing, slide: Slide | None) -> None:
        """Take where the target stood at its start, and its velocity then; what all do, if it is known to go along."""
        self._last, self._across_share = None, SHARE
        if slide is None:
            self._start, self._velocity, self.direction = start, None, None
        else:
            self._start, self._velocity, self.direction = None, start.velocity, slide.direction

    def take(self, x: float, y: float, stamp_ns: int, body: Body, slide: Slide | None) -> None:
        """Take where a look finds the target. Where it is known to go with all for the first time since its start, its
        box is put right: it has kept its size, and gone straight.

        Args:
            x: the column of its middle (pixels).
            y: the row of it (pixels).
            stamp_ns: when (ns).
            body: the target's, which has not gone there yet.
            slide: what all do that the camera sees; None where that is not known.
        """
        last, self._last = self._last, (x, y, stamp_ns)
        if last is not None and stamp_ns > last[2]:
            elapsed_s = (stamp_ns - last[2]) * 1e-9
            way = (x - last[0]) / elapsed_s, (y - last[1]) / elapsed_s
            self._velocity = nearer(self._velocity or body.velocity, way, elapsed_s / (elapsed_s + AVERAGE_S))
        if slide is None or self._velocity is None:
            self.direction = None
            return
        all_go = slide.direction
        if self.direction is None:
            goes_along = _goes_along(self._velocity, all_go, STRAYS_UNTIL)
            goes_along = goes_along and _goes_along(body.velocity, all_go, STRAYS_NOW)
        else:
            goes_along = _goes_along(self._velocity, all_go, STRAYS_FROM)
        self.direction = all_go if goes_along else None
        here_x, here_y, _, _ = body.pose
        _, off_px = parts_of((x - here_x, y - here_y), all_go)
        self._across_share = SHARE + (1 - SHARE) * min(1.0, (off_px / FAR_PX) ** 2)
        if goes_along and self._start is not None:
            _put_right(body, self._start, slide)
            self._start = None

    def held(self, vector: tuple[float, float]) -> tuple[float, float]:
        """A step or a velocity, x and y, as far as it is believed: of what goes across a little, and more the farther
        the last look was off."""
        if self.direction is None:
            return vector
        x, y = self.direction
        along, across = parts_of(vector, self.direction)
        across *= self._across_share
        return along * x - across * y, along * y + across * x


def _put_right(body: Body, start: Standing, slide: Slide) -> None:
    """Have a target's box where it has come to in the direction of all from its start, and as large as then, if it can
    have gone that way all the time."""
    box, (right, down) = body.box, slide.direction
    x, y = box.center
    along, off_px = parts_of((x - start.pose[0], y - start.pose[1]), slide.direction)
    is_of_then = start.stamp_ns >= slide.since_ns - BEFORE_S * 1e9
    if is_of_then and along > 0 and abs(off_px) < OFF_PX + STRAYS_FROM * along:
        width, height = body.size_px if abs(body.growing.per_s) < GROWS_PER_S else (box.w, box.h)
        body.correct_box(off_px * down, -off_px * right, math.log(width / box.w), math.log(height / box.h))


def _goes_along(velocity: Velocity, direction: Direction, strays: float) -> bool:
    """Whether a velocity has a direction, but for such a share."""
    along, across = parts_of(velocity, direction)
    return along > ALONG_MIN_PX_S and abs(across) < ACROSS_PX_S + strays * along


def parts_of(vector: tuple[float, float], direction: Direction) -> tuple[float, float]:
    """What of a vector goes along a direction, and what across it, to the right of who looks along it."""
    (x, y), (right, down) = vector, direction
    return right * x + down * y, right * y - down * x
