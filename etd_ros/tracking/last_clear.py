"""Whether what is followed is still what it was when it was clear, and where that is else: what passes before a target
draws its box along, and the model learns it within a few looks, which are sure again then."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

from etd_ros.boxes import Box
from etd_ros.tracking.body import Body, Standing
from etd_ros.tracking.contour_search import ContourSearch
from etd_ros.tracking.contours import SPEED_MIN_PX_S, Contours, Impression
from etd_ros.tracking.following import CONFIDENCE_SURE, CONFIDENCE_USUAL, KNOWN_MIN, Following
from etd_ros.tracking.growth import stands_alone
from etd_ros.tracking.set_off import AROUND_S, CROWDED
from etd_ros.tracking.surface import TimeSurface
from etd_ros.tracking.usual_looks import UsualLooks

NOTE_NS = 50_000_000
"""What it looks like is noted, and what is followed compared with that, so often."""
CLEAR_NS, SEEN_MIN = 200_000_000, 0.7
"""What has been followed surely for so long since looks were doubted is the target if it is seen so surely as it looked
before."""
SETTLED_NS = 2_000_000_000
"""What has been followed surely for so long is the target in any case: it looks otherwise now."""
STRAYED_MAX, STRAYED_TIMES = 0.5, 2
"""What is seen less surely than this as the target looked, so many times in a row, may be something else."""
NEAR_SIZES = 0.25
"""What comes to a halt does so within this part of its size from where it was clear, or it was something else."""
SAME_IOU = 0.3
"""What is found is what is followed if both boxes overlap by more."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """A target when it was clear: where it stood, its box (pixels), what it looked like, and what looks at it said."""

    standing: Standing
    box: Box
    impression: Impression
    usual: UsualLooks


class LastClear:
    """One target as it was when no look doubted it.

    Args:
        contours: the target's.
        surface: the events.
        following: looks at it.

    Attributes:
        sighting: it when it was clear last; None where it has not been yet.
        stood: where it stood when something came to pass before it; None where it did not, or is clear again.
    """

    def __init__(self, contours: Contours, surface: TimeSurface, following: Following) -> None:
        self._contours, self._surface, self._following = contours, surface, following
        self.sighting: Sighting | None = None
        self.stood: Standing | None = None
        self._is_passed = False
        self._noted_ns = 0
        self.doubt(0)
        self._since_ns: int | None = None

    def doubt(self, stamp_ns: int) -> None:
        """From now on (ns) it is not known whether what is followed is the target."""
        self._since_ns = self._doubted_ns = stamp_ns
        self._strayed_times = 0
        self._search: tuple[Contours, ContourSearch] | None = None

    @property
    def has_strayed(self) -> bool:
        """Whether what is followed does not look like the target."""
        return self._strayed_times >= STRAYED_TIMES

    def stand(self) -> None:
        """It makes no events any more where it is: it stands there, if it is about where it was clear."""
        if self.stood is None and self.sighting is not None and self._is_near(self.sighting.standing):
            self.stood, self._is_passed = Standing.of(self._contours.body), False

    def forget_where_it_stood(self) -> None:
        """What moves there is no passer-by: a camera moves, or it is gone."""
        self.stood = None

    def _is_near(self, standing: Standing) -> bool:
        """Whether it is still about where it stood."""
        body = self._contours.body
        gone_px = math.dist(body.pose[:2], standing.pose[:2])
        return gone_px < NEAR_SIZES * math.sqrt(body.box.w * body.box.h)

    def _sets_off_from(self, stood: Standing) -> bool:
        """Whether what moves where it stood began to there: what passes before it comes from beside it."""
        if not self._is_near(stood):
            return False
        box = self._contours.body.box_at(*stood.pose[:2])
        return stands_alone(self._surface, box, AROUND_S, CROWDED, self._contours.own.others)

    def take(self, stamp_ns: int, *, is_sure: bool) -> None:
        """Take the last look (ns), by whether it and those before are sure."""
        if self.stood is not None and not self._is_passed:
            if self._sets_off_from(self.stood):
                self.stood = None
            else:
                self._is_passed = True
        confidence = self._following.confidence
        if not is_sure or confidence < CONFIDENCE_USUAL:
            self._doubted_ns = stamp_ns
            self._since_ns = stamp_ns if self._since_ns is None else self._since_ns
        if not is_sure or confidence < CONFIDENCE_SURE or stamp_ns - self._noted_ns < NOTE_NS:
            return
        self._noted_ns = stamp_ns
        if self._since_ns is None or self._is_it_again(stamp_ns):
            self._note()

    def _note(self) -> None:
        """It is clear."""
        self._since_ns, self._search, self._strayed_times, self.stood = None, None, 0, None
        body, usual = self._contours.body, copy.copy(self._following.usual)
        self.sighting = Sighting(Standing.of(body), body.box, self._contours.impression(), usual)

    def _is_it_again(self, stamp_ns: int) -> bool:
        """Whether what is followed surely after doubts is the target: it is seen as it was, or has been for long."""
        sure_ns = stamp_ns - self._doubted_ns
        if self.sighting is None:
            return sure_ns > CLEAR_NS
        x, y, *_ = self._contours.body.pose
        seen = self._seen_as(self.sighting.impression, x, y)
        strays = seen < STRAYED_MAX and not self._contours.body.flies_on_from(self.sighting.standing)
        self._strayed_times = self._strayed_times + 1 if strays else 0
        return sure_ns > SETTLED_NS or (sure_ns > CLEAR_NS and seen > SEEN_MIN)

    def _seen_as(self, impression: Impression, x: float, y: float) -> float:
        """How surely the target is seen at a place (pixels) as it once looked, by how much of what its motion shows, if
        it has one, was known then."""
        seen = self._following.confidence_as(impression, x, y)
        if self._contours.body.speed_px_s < SPEED_MIN_PX_S:
            return seen
        return seen / max(self._contours.known_as(impression), KNOWN_MIN)

    def believe(self, x: float, y: float, *, is_expected: bool = False) -> bool:
        """Believe, if that can be, that it is at a place (pixels) where something like it was found, perhaps where its
        motion would have brought it; whether it is. What passes before a target that stands is found, too: so it has to
        look as it did when it was clear, unless it did not stand, but moved on unseen."""
        if self.stood is None or self.sighting is None:
            return True
        if is_expected and math.hypot(*self.stood.velocity) > SPEED_MIN_PX_S:
            self.stood = None
            return True
        return self._seen_as(self.sighting.impression, x, y) > SEEN_MIN

    def found_elsewhere(self, patience: float = 1.0) -> Body | None:
        """The target where it is seen as it was when it was clear, if what is followed does not look like it, and is
        elsewhere; `patience` as for `ContourSearch.found`."""
        if not self.has_strayed or self.sighting is None or self._since_ns is None:
            return None
        if self._search is None:
            self._search = self._begin_search(self.sighting, self._since_ns)
        as_it_was, search = self._search
        search.coast()
        search.keep()
        if not search.found(patience):
            return None
        body = self._contours.body
        if as_it_was.body.box.iou(body.box_at(*body.predicted(self._surface.stamp_ns))) > SAME_IOU:
            self.doubt(self._surface.stamp_ns)
            return None
        return as_it_was.body

    def _begin_search(self, sighting: Sighting, since_ns: int) -> tuple[Contours, ContourSearch]:
        """Contours of the target as it was, and a search for them since a time (ns)."""
        width, height = self._contours.body.size_px
        standing = sighting.standing
        as_it_was = self._contours.anew(Box(0.0, 0.0, width, height), standing.stamp_ns)
        as_it_was.appear(sighting.impression, sighting.box, standing.stamp_ns)
        as_it_was.body.velocity = standing.velocity
        before, usual_px_s = Standing.of(as_it_was.body), self._following.motion.speed_px_s
        search = ContourSearch(
            as_it_was, self._surface, sighting.usual, before, usual_px_s, since_ns, left_over=None, has_gap=False
        )
        return as_it_was, search
