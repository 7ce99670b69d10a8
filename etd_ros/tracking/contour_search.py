"""Looks for the contours of a target that is lost: where its motion would have brought it, where it was, and where
something like it was seen since."""

from __future__ import annotations

import math
from typing import NamedTuple

from etd_ros.boxes import Box
from etd_ros.tracking.arrivals import Arrivals, Side
from etd_ros.tracking.body import Standing, Velocity, moved_on
from etd_ros.tracking.contours import KEPT_MARGIN_PX, MARGIN, Contours
from etd_ros.tracking.expected_place import (
    AGREEING_LOOKS,
    AGREEING_NS,
    CONFIRM_NS,
    SEARCH_NS,
    ExpectedPlace,
    confidence_if_turned,
)
from etd_ros.tracking.look import Look
from etd_ros.tracking.slid_past import parts_of
from etd_ros.tracking.standing_out import share_elsewhere
from etd_ros.tracking.surface import NEVER_NS, TimeSurface
from etd_ros.tracking.usual_looks import EVENTS_MIN, UsualLooks

CONFIDENCE_CANDIDATE, CONFIDENCE_FOUND, CONFIDENCE_FOUND_HERE = 0.4, 0.75, 0.6
"""From where on a place is looked at again, and is the target's; the last near the middle of where it is looked
for, unless it has left."""
FOUND_LOOKS = 2
"""So many looks that follow one another have to be sure."""
HERE_PX = 6.0
COAST_S = 0.5
"""The motion of a target that is not seen is believed for so long."""
LATE_TIMES = 2.0
"""Later, one of many waits up to so many times as long for its next search, unless it has left: what comes in over a
border is farther inside by then."""
RADIUS_PX, GROWTH_PX_S, RADIUS_MAX_PX, GAP_RADIUS_MAX_PX = 9.0, 60.0, 36.0, 54.0
GROWTH_SHARE, GAP_GROWTH_SHARE = 0.5, 1.0
"""The region grows by at least so much of the target's usual speed: it may have turned. After a gap in the events it is
as large at once, whereas what hides a target is seldom larger than that."""
CANDIDATE_NS = 80_000_000
"""What is not sure after this time is something else, which must not keep the search from the target."""
PATH_LOOKS, PATH_S = 6, 0.01
"""The velocity of a candidate is that over its last looks, and after this time as sure as the one expected."""
NEAR_PX = 3.0
BETTER, ELSEWHERE_PX = 1.05, 4.0
"""A candidate that is not sure gives way to a look that is so many times as sure, this far away: of what is like itself
a part may agree with another part."""
ELSEWHERE_MAX, ELSEWHERE_LEFT_MAX, ELSEWHERE_EXPECTED_MAX = 0.75, 0.9, 1.1
"""Where places round it agree better than this, in parts of how well it agrees itself, what was found is not believed:
the second at the sensor's border, the third where the target was expected."""
BORDER_PX, BORDER_S = 2.0, 0.03
"""What comes back over the border is this near to it when it is seen first, or this time away."""
INWARD_PX = 3.0
"""It has come so far inwards since it was seen first: at its first looks it has the velocity that was expected."""
INWARD_SHARE, INWARD_S = 0.3, 0.01
"""So much of its motion is away from the border: a camera that turns brings things in along it, too."""


class _Seen(NamedTuple):
    """A look that may be of the target: its time (ns), place (pixels), the velocity there, how sure it is, and how sure
    if the target has turned."""

    stamp_ns: int
    x: float
    y: float
    velocity: Velocity
    confidence: float
    confidence_if_turned: float

    def predicted(self, stamp_ns: int) -> tuple[float, float]:
        return moved_on(self.x, self.y, self.velocity, stamp_ns - self.stamp_ns)


class _Place(NamedTuple):
    """Where a lost target may be: the middle (pixels), its velocity there (pixels/s), for how long it has not been seen
    there (s), and whether it would be there if it had moved on as it did."""

    x: float
    y: float
    velocity: Velocity
    unseen_s: float
    is_expected: bool = False


class _WideLook(NamedTuple):
    """The best look round a place; whether it is near its middle."""

    look: Look
    place: _Place
    is_here: bool


class ContourSearch:
    """The search for one lost target.

    Attributes:
        has_left: whether it left over the sensor's border.
        has_gap: whether it is lost because events were missing.
        is_unsettled: whether the target was found elsewhere than where its motion would have brought it, so that its
            motion is not known.
    """

    def __init__(
        self,
        contours: Contours,
        surface: TimeSurface,
        usual: UsualLooks,
        before: Standing,
        usual_speed_px_s: float,
        stamp_ns: int,
        *,
        left_over: Side | None,
        has_gap: bool,
    ) -> None:
        """Begin a search.

        Args:
            contours: of the target; the search moves their body.
            surface: the events.
            usual: what looks at the target usually say.
            before: where it stood when it was seen last.
            usual_speed_px_s: how fast it usually moves.
            stamp_ns: now.
            left_over: the border of the sensor over which it left, if it did: it comes back over it.
            has_gap: whether it is lost because events were missing.
        """
        self._contours = contours
        self._surface = surface
        self._usual = usual
        self._before = before
        self._usual_speed_px_s = usual_speed_px_s
        self.has_left, self.has_gap = left_over is not None, has_gap
        self._goes_with_all = contours.slid_past.direction is not None
        self._arrivals = left_over and Arrivals(surface, left_over, contours.body, before, usual_speed_px_s)
        self._growth_px_s = max(GROWTH_PX_S, (GAP_GROWTH_SHARE if has_gap else GROWTH_SHARE) * usual_speed_px_s)
        self._radius_max_px = GAP_RADIUS_MAX_PX if has_gap else RADIUS_MAX_PX
        # What has left comes back.
        right, down = before.velocity
        self._expected_velocity = (-right, -down) if self.has_left else before.velocity
        self._begun_ns = self._searched_ns = self._looked_round_ns = stamp_ns
        self._turn = 0
        self._compared_ns = self._expected_compared_ns = NEVER_NS
        self._place: _Place
        self._glimpse: _Seen | None = None
        self._wanted = CONFIDENCE_FOUND
        self._path: list[_Seen] = []
        self._expected = ExpectedPlace(contours, surface, usual, stamp_ns)
        self.is_unsettled = False

    @property
    def since_s(self) -> float:
        """How long the search has lasted."""
        return (self._surface.stamp_ns - self._begun_ns) * 1e-9

    def wait(self) -> None:
        """Frames were missing: what has come since is too little for a look, and would end a candidate."""
        self._searched_ns = self._surface.stamp_ns
        self._expected.wait()

    def coast(self) -> None:
        """Move the pose on with the last velocity, for a while and not beyond the sensor."""
        body, surface = self._contours.body, self._surface
        until_ns = min(surface.stamp_ns, self._begun_ns + round(COAST_S * 1e9))
        x, y = self._before.predicted(until_ns)
        body.be_at(min(max(x, 0.0), surface.width - 1.0), min(max(y, 0.0), surface.height - 1.0))
        body.velocity = self._before.velocity
        body.stamp_ns = surface.stamp_ns

    def keep(self) -> None:
        """Keep the surface up to date where the next looks may be; what is found at a region's edge is compared with
        places beyond, of which fewer events are known then."""
        surface = self._surface
        left, top, width, height = self._contours.body.box_at(0.0, 0.0, MARGIN)
        for place in self._places():
            box = Box(place.x + left, place.y + top, width, height)
            surface.keep_too(surface.window(box, self._radius_px(place) + KEPT_MARGIN_PX))
        if self._arrivals is not None:
            self._arrivals.keep()

    def next_ns(self, patience: float) -> int:
        """When it is looked for next (ns); `patience` as for `found`."""
        searches_ns = self._searches_ns(patience)
        return min(searches_ns, self._expected.next_ns(patience)) if self._is_expected_on_sensor() else searches_ns

    def _searches_ns(self, patience: float) -> int:
        """When places round it are looked at next (ns)."""
        if self._path:
            return self._searched_ns + CONFIRM_NS
        is_late = self.since_s > COAST_S and not self.has_left
        times = patience * min(patience, LATE_TIMES) if is_late else patience
        return self._searched_ns + round(times * SEARCH_NS)

    def found(self, patience: float = 1.0) -> bool:
        """Whether looks that follow one another find the target's contours; the pose is there then. Where nothing that
        may be it is seen, the next look waits `patience` times as long."""
        stamp_ns, body = self._surface.stamp_ns, self._contours.body
        if self._is_expected_on_sensor():
            look = self._expected.found(patience)
            if look is not None and _may_compare(stamp_ns, self._expected_compared_ns, patience):
                self._expected_compared_ns = stamp_ns
                if self._is_alone(look, body.velocity, ELSEWHERE_EXPECTED_MAX):
                    body.be_at(look.x, look.y)
                    self.is_unsettled = False
                    return True
        if stamp_ns < self._searches_ns(patience):
            return False
        self._searched_ns = stamp_ns
        look = self._look_again() if self._path else self._begin(self._look_round())
        confidence = confidence_turned = self._usual.confidence_of_lost(look)
        if not self.has_left:
            # At the border, where a camera brings anything in, a known part of the target is not enough.
            confidence_turned = confidence_if_turned(confidence, self._contours, look)
        if confidence_turned < CONFIDENCE_CANDIDATE or not self._is_possible(look, is_first=not self._path):
            if len(self._path) >= FOUND_LOOKS and not self.has_left:
                self._glimpse = self._path[-1]
            self.give_up()
            return False
        self._path.append(_Seen(stamp_ns, look.x, look.y, self._velocity_to(look), confidence, confidence_turned))
        if not (self._is_sure() and self._is_it(look, patience)):
            if stamp_ns - self._path[0].stamp_ns > CANDIDATE_NS:
                self.give_up()
            return False
        body.be_at(look.x, look.y)
        body.velocity = self._path[-1].velocity
        return True

    def _is_it(self, look: Look, patience: float) -> bool:
        """Whether a candidate that looks are sure of is the target, as far as that is asked now."""
        velocity, stamp_ns = self._path[-1].velocity, self._surface.stamp_ns
        if (self.has_left and not self._comes_in()) or self._goes_against_all(velocity):
            return False
        if not _may_compare(stamp_ns, self._compared_ns, patience):
            return False
        self._compared_ns = stamp_ns
        return self._is_alone(look, velocity, ELSEWHERE_LEFT_MAX if self.has_left else ELSEWHERE_MAX)

    def _goes_against_all(self, velocity: Velocity) -> bool:
        """Whether something with this velocity (pixels/s) goes back while the camera slides on, as what stood still in
        what it slides past does not."""
        slide = self._surface.slide
        return self._goes_with_all and slide is not None and parts_of(velocity, slide.direction)[0] < 0

    def _comes_in(self) -> bool:
        """Whether the candidate moves inwards from the border, and has done so since it was seen first."""
        first, seen = self._path[0], self._path[-1]
        soon_ns = seen.stamp_ns + round(INWARD_S * 1e9)
        at_first, here, soon = (
            self._surface.inside_px(self._contours.body.box_at(x, y))
            for x, y in ((first.x, first.y), (seen.x, seen.y), seen.predicted(soon_ns))
        )
        return here - at_first > INWARD_PX and soon - here > INWARD_SHARE * math.hypot(*seen.velocity) * INWARD_S

    def _is_alone(self, look: Look, velocity: Velocity, elsewhere_max: float) -> bool:
        """Whether the target, moving with this velocity (pixels/s), stands out from what is round it."""
        body = self._contours.body
        pose, before = body.pose, body.velocity
        body.be_at(look.x, look.y)
        body.velocity = velocity
        elsewhere = share_elsewhere(self._contours, self._surface, self._usual, look.x, look.y, elsewhere_max)
        body.pose, body.velocity = pose, before
        return elsewhere <= elsewhere_max

    def _is_expected_on_sensor(self) -> bool:
        """Whether its motion, as long as it is believed, would have kept it there."""
        if self.has_left or self.since_s > COAST_S:
            return False
        return self._surface.holds(*self._before.predicted(self._surface.stamp_ns))

    def _is_sure(self) -> bool:
        """Whether the last looks at a candidate are, or those of a longer time if it has turned."""
        last = self._path[-FOUND_LOOKS:]
        if len(last) == FOUND_LOOKS and all(seen.confidence >= self._wanted for seen in last):
            return True
        since_ns = self._path[-1].stamp_ns - AGREEING_NS
        looks = max(AGREEING_LOOKS, sum(seen.stamp_ns >= since_ns for seen in self._path))
        agreeing = self._path[-looks:]
        is_long = len(agreeing) == looks and self._path[0].stamp_ns <= since_ns
        return is_long and all(seen.confidence_if_turned >= CONFIDENCE_FOUND for seen in agreeing)

    def give_up(self) -> None:
        """Give the candidate up; the next place has its turn."""
        self._path = []
        self._turn += 1

    def _places(self) -> list[_Place]:
        """Where it may be: moved on, or stopped, or where something like it was seen since."""
        since_s = self.since_s
        x, y, _, _ = self._contours.body.pose
        places = [_Place(x, y, self._expected_velocity, since_s, is_expected=True)]
        if not self.has_left:
            x, y, _, _ = self._before.pose
            places.append(_Place(x, y, (0.0, 0.0), since_s))
        seen = self._path[-1] if self._path else self._glimpse
        if seen is not None:
            stamp_ns = self._surface.stamp_ns
            unseen_s = (stamp_ns - seen.stamp_ns) * 1e-9
            x, y = seen.predicted(stamp_ns)
            if unseen_s < COAST_S:
                places.append(_Place(x, y, seen.velocity, unseen_s))
        return places

    def _radius_px(self, place: _Place) -> float:
        return min(RADIUS_PX + self._growth_px_s * place.unseen_s, self._radius_max_px)

    def _look_round(self) -> _WideLook:
        """The best place where something comes in over the border it left over, or else in a region that grows."""
        contours, places = self._contours, self._places()
        self._looked_round_ns = self._surface.stamp_ns
        arrival = self._arrivals.newest() if self._arrivals is not None else None
        place = places[self._turn % len(places)] if arrival is None else _Place(*arrival, self.since_s)
        look = contours.look_at(self._surface, place.x, place.y, self._radius_px(place))
        return _WideLook(look, place, math.hypot(look.x - place.x, look.y - place.y) < HERE_PX)

    def _begin(self, wide: _WideLook) -> Look:
        """Take what was seen for the candidate."""
        self._path = []
        self._place = wide.place
        # At the border a camera that turns brings much in.
        is_here = wide.is_here and not self.has_left
        self._wanted = CONFIDENCE_FOUND_HERE if is_here else CONFIDENCE_FOUND
        self.is_unsettled = not (wide.place.is_expected and wide.is_here)
        return wide.look

    def _look_again(self) -> Look:
        """The best place near where the candidate's motion would have brought it; or elsewhere, if that is better."""
        last, stamp_ns = self._path[-1], self._surface.stamp_ns
        self._contours.body.velocity = last.velocity
        x, y = last.predicted(stamp_ns)
        sure = 0.5 if len(self._path) > FOUND_LOOKS else 1.0
        radius_px = NEAR_PX + sure * self._usual_speed_px_s * (stamp_ns - last.stamp_ns) * 1e-9
        look = self._contours.look_at(self._surface, x, y, min(radius_px, RADIUS_MAX_PX))
        confidence = self._usual.confidence_of_lost(look)
        if confidence >= self._wanted or stamp_ns - self._looked_round_ns < SEARCH_NS:
            return look
        self._turn += 1
        self._contours.body.velocity = self._before.velocity
        wide = self._look_round()
        other = wide.look
        is_better = self._usual.confidence_of_lost(other) > BETTER * confidence
        is_elsewhere = math.hypot(other.x - look.x, other.y - look.y) > ELSEWHERE_PX
        if not (is_better and is_elsewhere and self._is_possible(other, is_first=True)):
            return look
        return self._begin(wide)

    def _velocity_to(self, look: Look) -> Velocity:
        if not self._path:
            return self._place.velocity
        first = self._path[-PATH_LOOKS:][0]
        time_s = (self._surface.stamp_ns - first.stamp_ns) * 1e-9
        right, down = self._path[-1].velocity
        over_s = time_s + PATH_S
        return (look.x - first.x + PATH_S * right) / over_s, (look.y - first.y + PATH_S * down) / over_s

    def _is_possible(self, look: Look, *, is_first: bool) -> bool:
        """Whether it may be the target: with events, on the sensor, and first at its border if it left there."""
        surface = self._surface
        if look.events < EVENTS_MIN or not surface.holds(look.x, look.y):
            return False
        if not (is_first and self.has_left):
            return True
        box = self._contours.body.box_at(look.x, look.y)
        return surface.inside_px(box) <= BORDER_PX + self._usual_speed_px_s * BORDER_S


def _may_compare(stamp_ns: int, last_ns: int, patience: float) -> bool:
    """Whether it is time (ns) to compare something with what is round it, after the last time: it takes as long as nine
    looks, so that of many targets each is asked less often."""
    return stamp_ns - last_ns >= (patience - 1) * CONFIRM_NS
