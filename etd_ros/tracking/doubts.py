"""Whether what is followed is the target still: for how long its looks have failed, and where it stood before that."""

from __future__ import annotations

import math

from etd_ros.tracking.body import Body, Standing, nearer
from etd_ros.tracking.surface import TimeSurface

SURE_S, SURE_AGE_NS = 0.03, 500_000_000
"""What hides a target draws its box along before looks fail. So it is looked for from where it was last seen surely,
unless that was long ago or it is fast and flies on, at its velocity averaged over this time."""
FAILING_S, LEAVING_S = 0.3, 0.12
"""So long looks may fail before the target counts as lost; the second at the border of the sensor."""
FORGIVING = 2.0
"""How much faster good looks make up for failing ones."""
GONE_BEHIND_SURE, GONE_BEHIND_USUAL = 0.24, 0.1
"""What goes behind something does so edge by edge: it has moved on by these shares of its size since it was last seen
surely, and as usual. What stops at once has lost its events within less."""
SPEED_OUT_PX_S = 10.0
OVERSHOT_MAX_PX = 3.0


class Doubts:
    """Those about one target.

    Args:
        body: the target's.
        surface: what the sensor sees.

    Attributes:
        failing_s: for how long its looks have failed (s); 0 while they are believed.
        before: where it stood before they did.
        sure: where it was seen surely last; None where that says nothing any more.
    """

    def __init__(self, body: Body, surface: TimeSurface) -> None:
        self._body, self._surface = body, surface
        self.failing_s = 0.0
        self.before = Standing.of(body)
        self.sure: Standing | None = None
        self._leaving_velocity = body.velocity
        self._usual_place = body.pose[:2]

    @property
    def seen_surely(self) -> Standing:
        """Where it was seen surely last, or where it stood before looks failed if that was long before."""
        sure = self.sure
        return self.before if sure is None or self.before.stamp_ns - sure.stamp_ns >= SURE_AGE_NS else sure

    @property
    def is_lost(self) -> bool:
        """Whether looks have failed for too long, or have led off the sensor."""
        failing_max_s = LEAVING_S if self.is_leaving else FAILING_S
        return self.failing_s > failing_max_s or not self._surface.holds(*self._body.pose[:2])

    @property
    def is_leaving(self) -> bool:
        """Whether the target is at a border of the sensor and was moving over it."""
        (x, y, w, h), (right, down) = self._body.box, self._leaving_velocity
        return (
            (x <= 1 and -right > SPEED_OUT_PX_S)
            or (x + w >= self._surface.width - 1 and right > SPEED_OUT_PX_S)
            or (y <= 1 and -down > SPEED_OUT_PX_S)
            or (y + h >= self._surface.height - 1 and down > SPEED_OUT_PX_S)
        )

    @property
    def has_gone_behind(self) -> bool:
        """Whether a target that has no events any more has lost them edge by edge while it moved on: one that is fast
        may have stopped within as much motion."""
        body = self._body
        if body.is_fast or self.sure is None:
            return False
        size_px = math.sqrt(body.box.w * body.box.h)
        place = body.pose[:2]
        since_sure_px, since_usual_px = math.dist(place, self.sure.pose[:2]), math.dist(place, self._usual_place)
        return since_sure_px > GONE_BEHIND_SURE * size_px and since_usual_px > GONE_BEHIND_USUAL * size_px

    def note_velocity(self) -> None:
        """A look has the target's events: it may leave at the velocity so far."""
        self._leaving_velocity = self._body.velocity

    def note_usual(self) -> None:
        """A look sees it as usual, as it stood so far."""
        self._usual_place = self._body.pose[:2]

    def note_sure(self, elapsed_s: float) -> None:
        """A look sees it surely, as it stood so far, so long after the last one (s)."""
        body, velocity = self._body, self._body.velocity
        if self.sure is not None:
            velocity = nearer(self.sure.velocity, velocity, 1 - math.exp(-elapsed_s / SURE_S))
        self.sure = Standing(body.stamp_ns, body.pose, velocity)

    def doubt(self, elapsed_s: float) -> None:
        """Count a look that failed, for so long (s), and note where the target stood before the first."""
        if self.failing_s == 0:
            self.stand_here()
            surely = self.seen_surely
            if not self._body.flies_on_from(surely):
                self.before = surely
        self.failing_s += elapsed_s

    def fail_from(self, standing: Standing) -> None:
        """Looks have failed for too long, since the target stood there."""
        self.before, self.failing_s = standing, FAILING_S

    def stand_here(self) -> None:
        """Looks that fail do so from here on."""
        self.before = Standing.of(self._body)

    def believe(self, elapsed_s: float) -> None:
        """Count a look that is believed, so long after the last one (s)."""
        self.failing_s = max(0.0, self.failing_s - FORGIVING * elapsed_s)

    def begin_anew(self) -> None:
        """The target is followed from where it is now: where it stood before says nothing of it any more."""
        self.failing_s, self.sure = 0.0, None

    def come_less_far(self) -> None:
        """What slowed down while it was doubted went on at its old speed: it is half way between there and where it was
        before, unless that is so far that something else has drawn its box along."""
        body = self._body
        x, y, scale, angle = ((now + then) / 2 for now, then in zip(body.pose, self.before.pose, strict=True))
        if math.dist((x, y), body.pose[:2]) <= OVERSHOT_MAX_PX:
            body.pose = x, y, scale, angle
            self.failing_s = 0.0

    def come_back(self) -> None:
        """The camera has come to a halt, and shook what it sees: nothing has drawn the box along, nor gone far."""
        self._body.pose = self.before.pose
        self.failing_s = 0.0

    def go_back(self) -> None:
        """Be where the target stood before looks failed, and move as then."""
        body = self._body
        body.stamp_ns = self.before.stamp_ns
        body.pose, body.velocity = self.before.pose, self.before.velocity
        self._leaving_velocity = self.before.velocity
