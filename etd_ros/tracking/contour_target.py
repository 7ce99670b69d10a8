"""One target of `etd-plus`: contours that are followed, and what happens when they cannot be.

The states are those of `target`. A target that stands still makes no events and goes on TRACKING where it is: nothing
says that it is gone, unless something moves through that place. It is RECOVERING when the events where it should be are
not its own for a while, or when they ended edge by edge while it moved on, as behind something. Then its contours are
looked for in a region that grows round where its motion would have brought it, and the recovery tracker searches the
images. What is followed is looked for on images now and then, too, and what is followed again after doubts is compared
with what it was before: it may have drifted, or something may have drawn it along.
"""

from __future__ import annotations

import copy
import math

from etd_ros.boxes import Box
from etd_ros.recovery.interface import Found
from etd_ros.tracking.arrivals import Side, side_of
from etd_ros.tracking.body import Body, Standing
from etd_ros.tracking.box_refinement import BoxRefinement, Corrector
from etd_ros.tracking.contour_config import ContourConfig
from etd_ros.tracking.contour_search import CONFIDENCE_FOUND, ContourSearch
from etd_ros.tracking.contours import Contours, Impression
from etd_ros.tracking.doubts import Doubts
from etd_ros.tracking.drift_watch import ELSEWHERE_IOU
from etd_ros.tracking.following import CONFIDENCE_USUAL, Following, Outcome
from etd_ros.tracking.held import Held, moving_on
from etd_ros.tracking.image_search import ImageSearch
from etd_ros.tracking.last_clear import LastClear
from etd_ros.tracking.lone_mover import LoneMover
from etd_ros.tracking.look_pace import FAST_SIZES_PER_S, VERY_FAST_SIZES_PER_S, WAIT_MIN_S
from etd_ros.tracking.other_targets import OtherBoxes, Place
from etd_ros.tracking.set_off import KNOWN_MAX, SetOff
from etd_ros.tracking.start_up import StartUp
from etd_ros.tracking.surface import NEVER_NS, TimeSurface
from etd_ros.tracking.swept import Swept
from etd_ros.tracking.target import (
    FrameData,
    RecoveryFactory,
    TargetReport,
    TargetState,
    TrackerConfig,
)
from etd_ros.tracking.turns import Turns
from etd_ros.tracking.usual_looks import UsualLooks

SEARCH_MARGIN = 1.5
"""Width and height of the region that drives the frames, in those of the box (the paper's tau)."""
UNSEEN_S, UNSEEN_SHORT_S, UNSEEN_RADII = 0.1, 0.02, 4
"""No frame for so long is a gap, over which motion by more than so many search radii is not believed; after a short one
the look is a wide one."""
RECENT_S, FADES_S, RECENCY_MIN = 0.1, 0.5, 0.01
"""A target that has had no events for longer than this is reported with a score that halves in this time, down to so
much of what it was."""
STOOD_S = 0.1
"""What was followed and has had no events for so long stands."""
SHAKEN_S = 0.3
"""A camera that comes to a halt shakes for so long at most."""
FRAME_MIN_S = 0.0003
"""Frames are not asked to be shorter than this, however fast the target."""


class ContourTarget:
    """One tracked target; the arguments are those of `Target`, with the surface that all targets share, and what says
    how far its box is off.

    Attributes:
        followed_since_ns: when it started, or started again from where it stood (ns): what it looked like before, and
            how it lay, is told in other coordinates.
    """

    def __init__(
        self,
        name: str,
        box: Box,
        stamp_ns: int,
        config: TrackerConfig,
        contours: ContourConfig,
        surface: TimeSurface,
        recovery_factory: RecoveryFactory | None,
        search_wait_s: float = math.inf,
        turns: Turns | None = None,
        corrector: Corrector | None = None,
    ) -> None:
        self.name = name
        self.start_box = box
        self.start_stamp_ns = stamp_ns
        self._config = config
        self._contour_config = contours
        self._surface = surface
        self._recovery_factory = recovery_factory
        self._search_wait_s = search_wait_s
        self._turns = turns or Turns()
        self._corrector = corrector
        self._state = TargetState.IDLE
        self._body: Body
        self._doubts: Doubts
        self._following: Following
        self._set_off: SetOff
        self._swept: Swept
        self._search: ContourSearch
        self._follow_contours(Contours(box, stamp_ns, contours))
        self._start_up: StartUp | None = StartUp(self._contours)
        self._refinement: BoxRefinement | None = None
        recovery = recovery_factory() if recovery_factory else None
        self._images = ImageSearch(recovery, search_wait_s, self._turns)
        self._first: tuple[Impression, UsualLooks] | None = None
        self._updated_ns = self.followed_since_ns = 0
        self._rests_until_ns = NEVER_NS
        self._held: Held | None = None

    @property
    def state(self) -> TargetState:
        """Where the target stands."""
        return self._state if self._stand is None else TargetState.TRACKING

    @property
    def _stand(self) -> Held | None:
        """Where it is said to stand, or to move on unseen; None where it is not, or something moves through there."""
        return None if self._held is None or self._swept.is_swept else self._held

    @property
    def last_box(self) -> Box:
        """Where the target was seen last, or where its motion has brought it since (pixels)."""
        return self._body.box

    @property
    def search_region(self) -> Box:
        """Where it is looked for on the next frame (pixels)."""
        return self._body.box_at(*self._body.predicted(self._surface.stamp_ns)).scaled(SEARCH_MARGIN)

    @property
    def longest_frame_s(self) -> float:
        """How long the next frames may last (s): until it has moved by `frame_motion` of its size; inf where its motion
        is not known."""
        sizes_per_s = self._body.sizes_per_s
        is_known = self.is_followed and self.is_sure
        if not (is_known or (sizes_per_s > VERY_FAST_SIZES_PER_S and self._goes_on)) or sizes_per_s == 0:
            return math.inf
        # What is not fast is looked at no more often.
        shortest_s = FRAME_MIN_S if sizes_per_s > FAST_SIZES_PER_S else WAIT_MIN_S
        return max(shortest_s, self._contour_config.frame_motion / sizes_per_s)

    @property
    def _goes_on(self) -> bool:
        """Whether its box goes on at its velocity although its looks fail, or have no events for a moment."""
        if self._held is not None:
            return self._held.moves_on(self._updated_ns)
        return self.is_followed and not self._doubts.is_leaving

    def update(self, stamp_ns: int, _frame_data: FrameData, image: FrameData | None) -> TargetReport:
        """Take the next frame, which the surface holds already, and the intensity image of the same stamp if there is
        one; the arguments are those of `Target.update`."""
        if self._state is TargetState.IDLE:
            if stamp_ns < self.start_stamp_ns:
                return TargetReport(self.name, self._state, None, 0.0)
            self._state = TargetState.TRACKING
            self._body.stamp_ns = self.start_stamp_ns or stamp_ns
            self._start_up = StartUp(self._contours)
            self._begin_refinement(stamp_ns)
            self._updated_ns = self.followed_since_ns = stamp_ns
        if image is None and self._rests(stamp_ns):
            self._updated_ns = stamp_ns
            if self._state is not TargetState.TRACKING:
                self._search.coast()
            return self._report(stamp_ns)
        self._check_sight(stamp_ns)
        if not self._surface.is_flash:
            self._look(stamp_ns, image)
        was_held = self._held is not None
        if was_held:
            self._watch_for_drift(stamp_ns, image)
        if self._state is TargetState.TRACKING:
            is_sure = self._start_up is None and self._doubts.failing_s == 0
            self._images.remember(stamp_ns, image, self._body.box, is_sure=is_sure)
            if is_sure and not was_held:
                self._watch_for_drift(stamp_ns, image)
        self._rests_until_ns = self._next_look_ns()
        return self._report(stamp_ns)

    def _rests(self, stamp_ns: int) -> bool:
        """Whether the newest frame (ns), if it has no image, is none to look at: of many targets each rests between its
        looks, as its events are kept without it."""
        surface = self._surface
        has_gap = (surface.start_ns - self._updated_ns) * 1e-9 > UNSEEN_SHORT_S
        return stamp_ns < self._rests_until_ns and surface.keeps_all and not (surface.has_just_halted or has_gap)

    def _next_look_ns(self) -> int:
        """Until when (ns) it may rest; NEVER_NS where it may not."""
        patience = self._turns.patience
        if not self._surface.keeps_all or self._lone_mover.is_looking:
            return NEVER_NS
        if self._held is not None or self._start_up is not None:
            return NEVER_NS
        if self._state is not TargetState.TRACKING:
            lost_s = self._config.recovering_max_s - self._search.since_s
            next_ns = self._search.next_ns(patience)
            return next_ns if lost_s < 0 else min(next_ns, self._surface.stamp_ns + round(lost_s * 1e9))
        is_waiting = self._refinement is not None and self._refinement.is_waiting
        if is_waiting or not self.is_sure or self._last_clear.has_strayed:
            return NEVER_NS
        return self._contours.next_look_ns(patience)

    def _report(self, stamp_ns: int) -> TargetReport:
        """What is said of it at a time (ns)."""
        if self._state is not TargetState.TRACKING:
            box = self._stand.box_at(stamp_ns) if self._stand else None
            return TargetReport(self.name, self.state, box, 0.0)
        box = self._body.box_at(*self._body.predicted(stamp_ns))
        return TargetReport(self.name, self._state, box, min(1.0, self._following.confidence) * self._recency(stamp_ns))

    def _recency(self, stamp_ns: int) -> float:
        """How far what was seen last still tells where it is, 1 to RECENCY_MIN."""
        unseen_s = self._following.unseen_s
        if self._start_up is not None:
            unseen_s = (stamp_ns - self.followed_since_ns) * 1e-9 if self._start_up.stands else 0.0
        return max(RECENCY_MIN, math.exp2(-max(0.0, unseen_s - RECENT_S) / FADES_S))

    def begins(self, stamp_ns: int) -> bool:
        """Whether it starts with the frame of this time (ns)."""
        return self._state is TargetState.IDLE and self.start_stamp_ns <= stamp_ns

    @property
    def others(self) -> OtherBoxes:
        """The boxes of other targets near it, whose events are not its own."""
        return self._contours.own.others

    def place(self, stamp_ns: int) -> Place | None:
        """Where it is at a time (ns), if that is known, or believed so far."""
        body = self._body
        if self.begins(stamp_ns):
            return Place(self.start_box, (0.0, 0.0), has_events=True)
        if self._stand is not None:
            return Place(self._stand.box, (0.0, 0.0), has_events=False)
        if self._state is not TargetState.TRACKING or not (self._start_up is not None or self.is_sure):
            return None
        return Place(body.box_at(*body.predicted(stamp_ns)), body.velocity, has_events=True)

    @property
    def is_followed(self) -> bool:
        """Whether its contours are followed now."""
        return self._state is TargetState.TRACKING and self._start_up is None

    @property
    def is_sure(self) -> bool:
        """Whether its last looks were sure."""
        return self._doubts.failing_s == 0 and self._following.settling == 0

    @property
    def standing(self) -> Standing:
        """Where it stands, and how it moves, now."""
        return Standing.of(self._body)

    @property
    def impression(self) -> Impression:
        """What it looks like now."""
        return self._contours.impression()

    def confidence_as(self, impression: Impression, place: Standing) -> float:
        """How surely it is seen at a place, as it looked once."""
        return self._following.confidence_as(impression, *place.predicted(self._surface.stamp_ns))

    def go_back(self, stamp_ns: int, standing: Standing, impression: Impression) -> None:
        """Something else has drawn it along since it stood there and looked so: look for it from there on."""
        self._rests_until_ns = NEVER_NS
        self._last_clear.doubt(stamp_ns)
        self._doubts.fail_from(standing)
        self._following.motion.steady.forget()
        self._fail(stamp_ns)
        self._contours.recall(impression)
        # That was the other one.
        self._doubts.sure = None

    def _look(self, stamp_ns: int, image: FrameData | None) -> None:
        """Take what the newest frame shows of the target."""
        if self._refinement and self._state is TargetState.TRACKING:
            self._refinement.answer(self._contours, stamp_ns)
            self._refinement.keep(self._contours, self._surface)
        new_events = self._contours.keep(self._surface)
        if self._state is not TargetState.TRACKING:
            self._look_for_it(stamp_ns, image)
        elif self._start_up is not None:
            if self._start_up.take(self._surface, new_events):
                self._start_up = None
        elif self._contours.is_due(stamp_ns, is_sure=self.is_sure, patience=self._turns.patience):
            self._follow(stamp_ns)
        if self.is_followed:
            self._go_where_it_is_as_it_was(stamp_ns)
        self._watch_for_turn(stamp_ns)

    def _watch_for_turn(self, stamp_ns: int) -> None:
        """What was fast may have bounced off something where looks begin to fail."""
        if self._start_up is not None:
            self._lone_mover.stop()
            return
        found = self._lone_mover.found(is_doubted=not self.is_followed or self._doubts.failing_s > 0)
        if found is None:
            return
        if self._contours.known_along(found.velocity) <= KNOWN_MAX:
            self._start_again(self._contours.anew(found.box, stamp_ns), stamp_ns)
            self._start_up = StartUp(self._contours)
            return
        self._lone_mover.stop()
        self._contours.stop()
        self._contours.turn(found.velocity)
        self._body.be_at(*found.box.center)
        self._body.velocity, self._body.stamp_ns = found.velocity, stamp_ns
        self._go_on(CONFIDENCE_FOUND, is_unsettled=False)

    def waiting(self) -> ContourTarget:
        """Another that waits for the same start."""
        return ContourTarget(
            self.name,
            self.start_box,
            self.start_stamp_ns,
            self._config,
            self._contour_config,
            self._surface,
            self._recovery_factory,
            self._search_wait_s,
            self._turns,
            self._corrector,
        )

    def time_went_back(self, stamp_ns: int) -> None:
        """The stream starts again with a frame of this stamp (ns): go on."""
        self._body.stamp_ns = self._updated_ns = stamp_ns
        self._rests_until_ns = NEVER_NS
        self._contours.stop()
        self._contours.own.backdrop.forget()
        if self._start_up is not None:
            # What it has collected is of other times.
            self._start_up = StartUp(self._contours)
        self._contours.uncover()
        if self._held is not None:
            self._hold(stamp_ns, None)
        self._images.time_went_back(stamp_ns)
        if self._refinement:
            self._refinement.time_went_back(stamp_ns)
        self._doubts.begin_anew()
        self._lone_mover.stop()
        self._last_clear = LastClear(self._contours, self._surface, self._following)
        self._following.motion.steady.forget()
        if self._state in (TargetState.RECOVERING, TargetState.LOST):
            self._doubts.stand_here()
            self._search_from(stamp_ns, None)

    def _check_sight(self, stamp_ns: int) -> None:
        """Frames may have been missing, or the clock have stepped: where a target that moves is by now is not known."""
        before_ns, self._updated_ns = self._updated_ns, stamp_ns
        unseen_s = (stamp_ns - before_ns) * 1e-9
        gap_s = (self._surface.start_ns - before_ns) * 1e-9
        if self._state in (TargetState.RECOVERING, TargetState.LOST) and gap_s > UNSEEN_SHORT_S:
            self._search.wait()
        if unseen_s <= UNSEEN_SHORT_S or not self.is_followed:
            return
        moved_px = self._body.speed_px_s * unseen_s
        radius_px = self._contour_config.search_radius
        if moved_px <= radius_px:
            return
        self._following.settling = max(self._following.settling, 1)
        if unseen_s > UNSEEN_S and moved_px > UNSEEN_RADII * radius_px:
            if self._doubts.failing_s == 0:
                self._doubts.stand_here()
            self._fail(stamp_ns, before_ns)

    def _follow(self, stamp_ns: int) -> None:
        """Look for the target where it should be, and put its box right where it is seen as usual."""
        outcome = self._following.take(stamp_ns)
        if outcome in (Outcome.LOST, Outcome.VANISHED) and self._goes_on_standing(stamp_ns):
            return
        if outcome is Outcome.LOST:
            self._fail(stamp_ns)
        elif outcome is Outcome.VANISHED:
            self._vanish(stamp_ns)
        elif outcome is Outcome.SEEN:
            if self._refinement and self._following.sees_as_usual:
                self._refinement.take(self._contours, self._surface, self._turns.patience)
            self._last_clear.take(stamp_ns, is_sure=self.is_sure)
        elif self._following.unseen_s > STOOD_S:
            self._last_clear.stand()

    def _goes_on_standing(self, stamp_ns: int) -> bool:
        """What cannot be followed any more may be something that came to pass before the target while it stood: then
        it stands there still. Whether that is so."""
        stood, sighting = self._last_clear.stood, self._last_clear.sighting
        if stood is None or sighting is None:
            return False
        self.go_back(stamp_ns, stood, sighting.impression)
        if self._state is TargetState.RECOVERING:
            self._hold(stamp_ns, None)
        return True

    def _go_where_it_is_as_it_was(self, stamp_ns: int) -> None:
        """What is followed may be something else: where the target is seen as it was when it was clear, it is."""
        clear = self._last_clear
        found, sighting = clear.found_elsewhere(self._turns.patience), clear.sighting
        if found is None or sighting is None:
            return
        self._be_as_it_was(found.box, sighting.impression, sighting.usual, CONFIDENCE_FOUND, stamp_ns)
        self._body.velocity = found.velocity

    def _look_for_it_as_it_was(self, stamp_ns: int) -> None:
        """What was followed was something else, and can no longer be followed either."""
        sighting = self._last_clear.sighting
        if sighting is not None:
            # What it was may have left the sensor: that says nothing of the target.
            self._doubts.fail_from(sighting.standing)
            self._doubts.go_back()
            self._images.forget_lately()
            self.go_back(stamp_ns, sighting.standing, sighting.impression)

    def _watch_for_drift(self, stamp_ns: int, image: FrameData | None) -> None:
        """A box that was drawn along by something learns what it is on, and its looks are sure again, or it has no
        events there. So the target is looked for on images as it looked at first; where it is seen elsewhere, it is
        there, and looks like that."""
        if self._first is None:
            if self._images.watch.knows_first:
                self._first = self._contours.impression(), copy.copy(self._following.usual)
            return
        found = self._images.watch.elsewhere(stamp_ns, image, self._body.box)
        # What passes before a target hides it on images, too; something else may look like it.
        is_unseen = self._held is not None or self._following.unseen_s > RECENT_S
        if found is None or (self._following.confidence < CONFIDENCE_USUAL and not is_unseen):
            return
        if self._last_clear.believe(*found.box.center):
            self._be_as_it_was(found.box, *self._first, found.score, stamp_ns)

    def _be_as_it_was(
        self, box: Box, impression: Impression, usual: UsualLooks, confidence: float, stamp_ns: int
    ) -> None:
        """Follow it where it was found so surely, elsewhere than it was followed or held, and as it looked once."""
        self._images.forget_lately()
        self._contours.appear(impression, box, stamp_ns)
        self._state, self._held = TargetState.TRACKING, None
        self._last_clear.doubt(stamp_ns)
        self._doubts.begin_anew()
        self._following.begin_anew(usual, confidence)

    def _vanish(self, stamp_ns: int) -> None:
        """A target that was moving has no events any more. It has gone behind something, or has stopped: then it keeps
        its box, after a moment if it is fast, and is looked for there and where its motion would bring it."""
        if self._last_clear.has_strayed:
            self._look_for_it_as_it_was(stamp_ns)
            return
        moving = moving_on(self._body, stamp_ns)
        has_gone_behind = self._doubts.has_gone_behind
        self._doubts.failing_s = 0.0
        self._fail(stamp_ns, may_have_left=has_gone_behind)
        if self._state is TargetState.RECOVERING and not has_gone_behind:
            self._hold(stamp_ns, moving)

    def _hold(self, stamp_ns: int, moving: tuple[Box, float, float] | None) -> None:
        """It keeps its box from now on (ns), which may move on first as for `Held`, until it is seen or sets off."""
        box = self._body.box if self._held is None else self._held.box
        self._held = Held(box, moving, stamp_ns, self._surface)
        self._set_off = SetOff(self._contours, box, stamp_ns)
        self._last_clear.stand()
        self._swept = Swept(box, stamp_ns, self.others)

    def _fail(self, stamp_ns: int, since_ns: int | None = None, *, may_have_left: bool = True) -> None:
        """Go on from before the looks that failed, as they may have followed something else; the target has not been
        seen since `since_ns` (ns), by default until now."""
        if self._last_clear.has_strayed:
            self._look_for_it_as_it_was(stamp_ns)
            return
        self._last_clear.doubt(stamp_ns)
        contours, body, doubts = self._contours, self._body, self._doubts
        is_off = not self._surface.holds(*body.pose[:2])
        side = side_of(body.box, self._surface.width, self._surface.height)
        if since_ns is None:
            doubts.doubt(0.0)
        contours.is_changing, contours.least_speed_px_s = False, 0.0
        doubts.go_back()
        if since_ns is None and self._surface.inside_px(body.box_at(*body.predicted(stamp_ns))) >= 0:
            # What drew its box over the border was something else: the target's own motion does not.
            is_off = False
        self._state = TargetState.LOST if is_off else TargetState.RECOVERING
        has_left = is_off or (may_have_left and doubts.is_leaving)
        if doubts.before is doubts.sure and not has_left:
            contours.restore_memories()
        contours.uncover()
        self._images.begin(stamp_ns)
        left_over = side if has_left else None
        if since_ns is None:
            self._search_from(stamp_ns, left_over)
        else:
            self._search_from(since_ns, left_over, has_gap=True)

    def _stood_still(self, stamp_ns: int) -> bool:
        """Whether a target that was just lost stands where it was, as the camera has come to a halt; then it does.
        What moved on while events were missing, or has left, is elsewhere."""
        search = self._search
        is_new = search.since_s < SHAKEN_S and not (search.has_left or search.has_gap)
        if not (is_new and self._surface.has_just_halted and self._state is TargetState.RECOVERING):
            return False
        self._doubts.come_back()
        self._body.stamp_ns = stamp_ns
        self._contours.stop()
        return True

    def _search_from(self, stamp_ns: int, left_over: Side | None, *, has_gap: bool = False) -> None:
        self._search = ContourSearch(
            self._contours,
            self._surface,
            self._following.usual,
            self._doubts.before,
            self._following.motion.speed_px_s,
            stamp_ns,
            left_over=left_over,
            has_gap=has_gap,
        )

    def _look_for_it(self, stamp_ns: int, image: FrameData | None) -> None:
        """Search for the contours in a growing region, and the images now and then."""
        search = self._search
        if self._stood_still(stamp_ns):
            self._go_on(CONFIDENCE_FOUND, is_unsettled=True)
            return
        if self._state is TargetState.RECOVERING and search.since_s > self._config.recovering_max_s and not self._held:
            self._state = TargetState.LOST
        if self._held is not None and self._set_off.take(self._surface):
            self._start_again(self._set_off.contours, stamp_ns)
            return
        if self._held is not None and self._swept.take(self._surface):
            self._held = None
            self._last_clear.forget_where_it_stood()
        search.coast()
        search.keep()
        answer = self._found_on_image(stamp_ns, image)
        if answer is not None:
            self._body.be_at(*answer.box.center)
            self._contours.stop()
        elif not search.found(self._turns.patience):
            return
        if self.others.has(self._body.box, stamp_ns):
            search.give_up()
            return
        is_expected = answer is None and not search.is_unsettled
        if not self._last_clear.believe(*self._body.pose[:2], is_expected=is_expected):
            return
        if answer is not None:
            self._go_on(answer.score, is_unsettled=True)
        else:
            self._go_on(CONFIDENCE_FOUND, is_unsettled=search.is_unsettled)

    def _found_on_image(self, stamp_ns: int, image: FrameData | None) -> Found | None:
        """Where the images show it. What is held is looked for once something has moved there: that may have been it,
        if it is seen elsewhere now."""
        stand = self._stand
        if stand is None:
            return self._images.found(stamp_ns, image, self._state, self.last_box)
        if not self._set_off.is_disturbed:
            return None
        answer = self._images.found(stamp_ns, image, self._state, stand.box)
        if answer is not None and answer.box.iou(stand.box) >= ELSEWHERE_IOU:
            self._set_off.is_disturbed = False
            return None
        return answer

    def _start_again(self, contours: Contours, stamp_ns: int) -> None:
        """It has set off from where it stood, and looks as it does on its way now."""
        self._follow_contours(contours)
        self._begin_refinement(stamp_ns)
        self._first = None
        self.followed_since_ns = stamp_ns
        self._state = TargetState.TRACKING
        self._held = None

    def _begin_refinement(self, stamp_ns: int) -> None:
        if self._corrector is not None:
            gain = self._contour_config.refine_gain
            self._refinement = BoxRefinement(self.name, self._corrector, gain, stamp_ns)

    def _follow_contours(self, contours: Contours) -> None:
        """Nothing is known of these contours yet but what they are."""
        self._contours = contours
        self._body = contours.body
        self._doubts = Doubts(self._body, self._surface)
        self._following = Following(contours, self._surface, self._doubts)
        self._lone_mover = LoneMover(contours, self._surface, self._doubts)
        self._last_clear = LastClear(contours, self._surface, self._following)

    def _go_on(self, confidence: float, *, is_unsettled: bool) -> None:
        """Follow it again from where it is now."""
        self._state = TargetState.TRACKING
        self._held = None
        self._doubts.begin_anew()
        self._following.go_on(confidence, is_unsettled=is_unsettled)
