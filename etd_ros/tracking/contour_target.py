"""One target of `etd-plus`: contours that are followed, and what happens when they cannot be.

The states are those of `target`. A target that stands still makes no events and goes on TRACKING where it is: nothing
says that it is gone. It is RECOVERING when the events where it should be are not its own for a while, or when they
ended edge by edge while it moved on, as behind something. Then its contours are looked for in a region that grows round
where its motion would have brought it, and the recovery tracker searches the images. What is followed is looked for on
images now and then, too: it may have drifted.
"""

from __future__ import annotations

import copy
import math
from dataclasses import replace

from etd_ros.boxes import Box
from etd_ros.tracking.box_refinement import BoxRefinement, Corrector
from etd_ros.tracking.contour_config import ContourConfig
from etd_ros.tracking.contour_search import CONFIDENCE_FOUND, ContourSearch, Standing
from etd_ros.tracking.contours import Contours, Impression, Look
from etd_ros.tracking.drift_watch import Turns
from etd_ros.tracking.held import Held, moving_on
from etd_ros.tracking.image_search import ImageSearch
from etd_ros.tracking.look_pace import FAST_SIZES_PER_S, WAIT_MIN_S
from etd_ros.tracking.start_up import StartUp
from etd_ros.tracking.surface import TimeSurface
from etd_ros.tracking.target import (
    FrameData,
    RecoveryFactory,
    TargetReport,
    TargetState,
    TrackerConfig,
    starts_again,
)
from etd_ros.tracking.usual_looks import EVENTS_MIN, UsualLooks
from etd_ros.tracking.usual_motion import UsualMotion

SEARCH_MARGIN = 1.5
"""Width and height of the region that drives the frames, in those of the box (the paper's tau)."""
CONFIDENCE_OK, CONFIDENCE_MIN = 0.55, 0.3
"""From where on a look is believed in full, and at all (docs/tracking.md)."""
CONFIDENCE_SURE, SURE_S, SURE_AGE_NS = 0.9, 0.03, 500_000_000
"""From where on nothing stands before the target. What hides it draws its box along before looks fail, so that it is
looked for from where it was last seen surely, unless that was long ago, at its velocity averaged over this time."""
CONFIDENCE_USUAL = 0.7
"""Below this, what the target looked like lately is tried."""
CHANGING_PX, TRUST_MIN = 1.0, 0.1
"""A look that is doubted still teaches, by what trust is left, if it finds the target this near to where it should be:
then it changes, rather than something else being in its place."""
KNOWN_MIN = 0.3
CONFIDENCE_STEADY = 0.9
"""From where on a look says how the target usually moves; below, one that strays from that is doubted."""
COVERED_AFTER_S = 0.5
"""A target that was followed surely for so long is known well enough to tell what covers it from how it changes."""
STEADYING_S = 0.1
"""A target that is drawn along gets its usual motion back in this time."""
FAILING_S, LEAVING_S = 0.3, 0.12
"""So long looks may fail before the target counts as lost; the second at the border of the sensor."""
FORGIVING = 2.0
"""How much faster good looks make up for failing ones."""
VANISHING_PX_S, VANISHING_SHARE = 20.0, 0.75
"""A target that is faster than this, and than this share of its usual speed, does not come to a halt at once."""
GONE_BEHIND_SURE, GONE_BEHIND_USUAL = 0.24, 0.1
"""What goes behind something does so edge by edge: it has moved on by these shares of its size since it was last seen
surely, and as usual. What stops at once has lost its events within less."""
SPEED_OUT_PX_S = 10.0
EVENTS_FEW = 4.0
"""With so many events a target is not without: of more of its motion there may be enough for a look."""
NOISE_S = 0.03
"""Looks at noise alone for longer are those at a target without events; a single one may be at few of its own."""
OVERSHOT_MAX_PX = 3.0
STILL_S = 0.03
"""The velocity of a target without events decays with this time constant."""
UNSEEN_S, UNSEEN_SHORT_S, UNSEEN_RADII = 0.1, 0.02, 4
"""No frame for so long is a gap, over which motion by more than so many search radii is not believed; after a short one
the look is a wide one."""
FRAME_MIN_S = 0.0003
"""Frames are not asked to be shorter than this, however fast the target."""
SETTLING_LOOKS = 4
"""After it was found its motion is not known for so many looks."""


class ContourTarget:
    """One tracked target; the arguments are those of `Target`, with the surface that all targets share, and what says
    how far its box is off."""

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
        self._turns = turns
        self._corrector = corrector
        self._state: TargetState
        self._contours: Contours
        self._start_up: StartUp | None
        self._refinement: BoxRefinement | None
        self._images: ImageSearch
        self._usual: UsualLooks
        self._motion: UsualMotion
        self._confidence: float
        self._held: Held | None
        self._sure: Standing | None
        self._search: ContourSearch
        self._updated_ns: int
        self._wait_for_start()

    @property
    def state(self) -> TargetState:
        """Where the target stands."""
        return self._state if self._held is None else TargetState.TRACKING

    @property
    def last_box(self) -> Box:
        """Where the target was seen last, or where its motion has brought it since (pixels)."""
        return self._contours.box

    @property
    def search_region(self) -> Box:
        """Where it is looked for on the next frame (pixels)."""
        return self._contours.box_at(*self._contours.predicted(self._surface.stamp_ns)).scaled(SEARCH_MARGIN)

    @property
    def longest_frame_s(self) -> float:
        """How long the next frames may last (s): until it has moved by `frame_motion` of its size; inf where its motion
        is not known."""
        sizes_per_s = self._contours.sizes_per_s
        if not (self.is_followed and self.is_sure) or sizes_per_s == 0:
            return math.inf
        # What is not fast is looked at no more often.
        shortest_s = FRAME_MIN_S if sizes_per_s > FAST_SIZES_PER_S else WAIT_MIN_S
        return max(shortest_s, self._contour_config.frame_motion / sizes_per_s)

    def update(self, stamp_ns: int, _frame_data: FrameData, image: FrameData | None) -> TargetReport:
        """Take the next frame, which the surface holds already, and the intensity image of the same stamp if there is
        one; the arguments are those of `Target.update`."""
        if self._state is TargetState.IDLE:
            if stamp_ns < self.start_stamp_ns:
                return TargetReport(self.name, self._state, None, 0.0)
            self._state = TargetState.TRACKING
            self._contours.stamp_ns = self.start_stamp_ns or stamp_ns
            self._start_up = StartUp(self._contours)
            if self._corrector is not None:
                gain = self._contour_config.refine_gain
                self._refinement = BoxRefinement(self.name, self._corrector, gain, stamp_ns)
            self._updated_ns = stamp_ns
        self._check_sight(stamp_ns)
        if not self._surface.is_flash:
            self._look(stamp_ns, image)
        if self._state is not TargetState.TRACKING:
            held_box = self._held.box_at(stamp_ns) if self._held else None
            return TargetReport(self.name, self.state, held_box, 0.0)
        is_sure = self._start_up is None and self._failing_s == 0
        self._images.remember(stamp_ns, image, self._contours.box, is_sure=is_sure)
        if is_sure:
            self._watch_for_drift(stamp_ns, image)
        box = self._contours.box_at(*self._contours.predicted(stamp_ns))
        return TargetReport(self.name, self._state, box, min(1.0, self._confidence))

    @property
    def is_followed(self) -> bool:
        """Whether its contours are followed now."""
        return self._state is TargetState.TRACKING and self._start_up is None

    @property
    def is_sure(self) -> bool:
        """Whether its last looks were sure."""
        return self._failing_s == 0 and self._settling == 0

    @property
    def standing(self) -> Standing:
        """Where it stands, and how it moves, now."""
        return Standing.of(self._contours)

    @property
    def impression(self) -> Impression:
        """What it looks like now."""
        return self._contours.impression()

    def go_back(self, stamp_ns: int, standing: Standing, impression: Impression) -> None:
        """Something else has drawn it along since it stood there and looked so: look for it from there on."""
        self._before = standing
        self._failing_s = FAILING_S
        self._motion.steady.forget()
        self._fail(stamp_ns)
        self._contours.recall(impression)
        # That was the other one.
        self._sure = None

    def _look(self, stamp_ns: int, image: FrameData | None) -> None:
        """Take what the newest frame shows of the target."""
        if self._refinement and self._state is TargetState.TRACKING:
            self._refinement.keep(self._contours, self._surface)
        new_events = self._contours.keep(self._surface)
        if self._state is not TargetState.TRACKING:
            self._look_for_it(stamp_ns, image)
        elif self._start_up is not None:
            if self._start_up.take(self._surface, new_events):
                self._start_up = None
        elif self._contours.is_due(stamp_ns):
            self._follow(stamp_ns)

    def time_went_back(self, stamp_ns: int) -> None:
        """The stream starts again with a frame of this stamp (ns): wait for the start again if it is still to come, or
        go on."""
        if starts_again(self.start_stamp_ns, stamp_ns):
            self._wait_for_start()
            return
        self._contours.stamp_ns = self._updated_ns = stamp_ns
        self._contours.stop()
        if self._start_up is not None:
            # What it has collected is of other times.
            self._start_up = StartUp(self._contours)
        self._contours.uncover()
        self._held = replace(self._held, moving=None) if self._held else None
        self._images.time_went_back(stamp_ns)
        if self._refinement:
            self._refinement.time_went_back(stamp_ns)
        self._sure = None
        self._failing_s = 0.0
        self._motion.steady.forget()
        if self._state in (TargetState.RECOVERING, TargetState.LOST):
            self._before = Standing.of(self._contours)
            self._search_from(stamp_ns, has_left=False)

    def _wait_for_start(self) -> None:
        self._state = TargetState.IDLE
        self._contours = Contours(self.start_box, self.start_stamp_ns, self._contour_config)
        self._start_up = StartUp(self._contours)
        self._refinement = None
        recovery = self._recovery_factory() if self._recovery_factory else None
        self._images = ImageSearch(recovery, self._search_wait_s, self._turns)
        self._usual = UsualLooks()
        self._first: tuple[Impression, UsualLooks] | None = None
        self._motion = UsualMotion()
        self._confidence = 1.0
        self._failing_s = self._noise_s = 0.0
        self._updated_ns = 0
        self._before = Standing.of(self._contours)
        self._leaving_velocity = self._contours.velocity.copy()
        self._settling = 0
        self._held = None
        self._sure = None
        self._usual_place = self._contours.pose[:2].copy()

    def _check_sight(self, stamp_ns: int) -> None:
        """Frames may have been missing, or the clock have stepped: where a target that moves is by now is not known."""
        before_ns, self._updated_ns = self._updated_ns, stamp_ns
        unseen_s = (stamp_ns - before_ns) * 1e-9
        gap_s = (self._surface.start_ns - before_ns) * 1e-9
        if self._state in (TargetState.RECOVERING, TargetState.LOST) and gap_s > UNSEEN_SHORT_S:
            self._search.wait()
        moved_px = self._contours.speed_px_s * unseen_s
        radius_px = self._contour_config.search_radius
        if not self.is_followed or moved_px <= radius_px or unseen_s <= UNSEEN_SHORT_S:
            return
        self._settling = max(self._settling, 1)
        if unseen_s > UNSEEN_S and moved_px > UNSEEN_RADII * radius_px:
            if self._failing_s == 0:
                self._before = Standing.of(self._contours)
            self._fail(stamp_ns, before_ns)

    def _follow(self, stamp_ns: int) -> None:
        """Look for the target round where it should be, and go there as far as the look can be believed."""
        contours = self._contours
        contours.is_changing = False
        # Half-believed looks at what turned round at once take it to stand; the events of more time would be blurred.
        contours.least_speed_px_s = self._motion.speed_px_s if self._failing_s > 0 else 0.0
        elapsed_s = (stamp_ns - contours.stamp_ns) * 1e-9
        contours.take_turning_of_flow(self._surface)
        look = self._look_here()
        if EVENTS_FEW <= look.events < EVENTS_MIN and contours.look_longer(look.events, stamp_ns):
            look = self._look_here()
        x, y = contours.predicted(stamp_ns)
        confidence = self._usual.confidence(look)
        is_noise = confidence < CONFIDENCE_OK and contours.sees_noise(self._surface)
        self._noise_s = self._noise_s + elapsed_s if is_noise else 0.0
        if look.events < EVENTS_MIN or self._noise_s > NOISE_S:
            self._go_without_events(stamp_ns, elapsed_s)
            return
        self._leaving_velocity = contours.velocity.copy()
        self._motion.learn_speed(contours.speed_px_s, elapsed_s)
        if self._failing_s == 0:
            # A new direction of motion shows edges that the model cannot know.
            confidence /= max(contours.known, KNOWN_MIN)
        self._confidence = min(1.0, confidence) * self._plausible(look, stamp_ns)
        if self._confidence < CONFIDENCE_USUAL:
            look = self._look_for_change(look, stamp_ns)
        if self._confidence < CONFIDENCE_OK:
            turned = contours.look(self._surface, any_motion=True)
            confidence = self._usual.confidence(turned) * self._plausible(turned, stamp_ns)
            if confidence > self._confidence:
                look, self._confidence = turned, confidence
                contours.turn(look.direction)
        strays = self._doubt_if_it_strays(look, stamp_ns, elapsed_s)
        self._note_if_sure(elapsed_s)
        if self._confidence >= CONFIDENCE_USUAL:
            self._usual_place = contours.pose[:2].copy()
        doubt = min(max((CONFIDENCE_OK - self._confidence) / (CONFIDENCE_OK - CONFIDENCE_MIN), 0.0), 1.0)
        if doubt > 0:
            self._doubt(elapsed_s * doubt)
        trust = 1.0 - doubt
        jump_px = math.hypot(look.x - x, look.y - y)
        if strays and doubt > 0:
            contours.go_on_at(self._motion.steady.velocity, doubt * min(1.0, elapsed_s / STEADYING_S))
        contours.follow(self._surface, x + trust * (look.x - x), y + trust * (look.y - y), trust)
        if doubt == 0:
            self._failing_s = max(0.0, self._failing_s - FORGIVING * elapsed_s)
            self._usual.learn(look)
            self._motion.learn_jump(jump_px)
            self._settling = max(0, self._settling - 1)
        if not self._settling and (doubt == 0 or (trust > TRUST_MIN and jump_px < CHANGING_PX)):
            sees_covers = self._motion.steady.seen_s >= COVERED_AFTER_S
            contours.adapt(self._surface, elapsed_s, trust, sees_covers=sees_covers)
        if self._has_failed() or not self._surface.holds(*contours.pose[:2]):
            self._fail(stamp_ns)
        elif self._refinement and self._failing_s == 0 and not self._settling and self._confidence > CONFIDENCE_USUAL:
            self._refinement.take(contours, self._surface)

    def _watch_for_drift(self, stamp_ns: int, image: FrameData | None) -> None:
        """A box that was drawn along by something learns what it is on, and its looks are sure again. So the target is
        looked for on images as it looked at first; where it is seen elsewhere, it is there, and looks like that."""
        if self._first is None:
            if self._images.watch.knows_first:
                self._first = self._contours.impression(), copy.copy(self._usual)
            return
        found = self._images.watch.elsewhere(stamp_ns, image, self._contours.box)
        # What passes before a target hides it on images, too; something else may look like it.
        if found is None or self._confidence < CONFIDENCE_USUAL:
            return
        impression, usual = self._first
        self._images.forget_lately()
        self._contours.appear(impression, found.box, stamp_ns)
        self._usual = copy.copy(usual)
        self._sure = None
        self._settling = SETTLING_LOOKS
        self._motion = UsualMotion()
        self._confidence = found.score

    def _look_here(self) -> Look:
        return self._contours.look(self._surface, any_motion=self._settling > 0)

    def _plausible(self, look: Look, stamp_ns: int) -> float:
        """How far a target with this motion could be from where it should be, in parts of how far the look finds it; at
        most 1."""
        if self._settling:
            return 1.0
        contours = self._contours
        x, y = contours.predicted(stamp_ns)
        unsure_s = (stamp_ns - contours.stamp_ns) * 1e-9 + self._failing_s
        return self._motion.plausible(math.hypot(look.x - x, look.y - y), contours.speed_px_s, unsure_s)

    def _doubt_if_it_strays(self, look: Look, stamp_ns: int, elapsed_s: float) -> bool:
        """Doubt a look that finds the target changed where following it would change how the target usually moves:
        what covers it draws its box along. Whether it is such a look."""
        if self._settling:
            self._motion.steady.forget()
            return False
        velocity = self._contours.velocity_to(look.x, look.y, stamp_ns)
        if self._confidence >= CONFIDENCE_STEADY:
            self._motion.steady.learn(velocity, elapsed_s)
            return False
        plausible = self._motion.steady.plausible(velocity)
        self._confidence *= plausible
        return plausible < 1

    def _look_for_change(self, look: Look, stamp_ns: int) -> Look:
        """A look at what the target was like lately, if that fits better: it, or what is behind it, has changed."""
        self._contours.is_changing = True
        recent = self._look_here()
        confidence = self._usual.confidence(recent) * self._plausible(recent, stamp_ns)
        if confidence > self._confidence:
            self._confidence = confidence
            return recent
        self._contours.is_changing = False
        return look

    def _note_if_sure(self, elapsed_s: float) -> None:
        if self._confidence < CONFIDENCE_SURE or self._failing_s > 0:
            return
        velocity = self._contours.velocity.copy()
        if self._sure is not None:
            velocity = self._sure.velocity + (1 - math.exp(-elapsed_s / SURE_S)) * (velocity - self._sure.velocity)
        self._sure = replace(Standing.of(self._contours), velocity=velocity)
        self._contours.keep_memories()

    def _go_without_events(self, stamp_ns: int, elapsed_s: float) -> None:
        """A target that was slowing down stands still now; one that was not has gone behind something, or has stopped:
        then it keeps its box, after a moment if it is fast, and is looked for there and where its motion would bring
        it."""
        contours = self._contours
        if contours.speed_px_s > max(VANISHING_PX_S, VANISHING_SHARE * self._motion.speed_px_s):
            moving = moving_on(contours, stamp_ns)
            has_gone_behind = self._has_gone_behind()
            self._failing_s = 0.0
            self._fail(stamp_ns, may_have_left=has_gone_behind)
            if self._state is TargetState.RECOVERING and not has_gone_behind:
                self._held = Held(contours.box, moving, stamp_ns, self._surface)
            return
        if self._failing_s > 0:
            self._come_less_far()
        contours.velocity *= math.exp(-elapsed_s / STILL_S)
        contours.stamp_ns = stamp_ns
        if self._has_failed() or not self._surface.holds(*contours.pose[:2]):
            self._fail(stamp_ns)

    def _has_gone_behind(self) -> bool:
        """Whether a target that has no events any more has lost them edge by edge while it moved on: one that is fast
        may have stopped within as much motion."""
        contours = self._contours
        if contours.is_fast or self._sure is None:
            return False
        size_px = math.sqrt(contours.box.w * contours.box.h)
        place = contours.pose[:2]
        since_sure_px, since_usual_px = math.dist(place, self._sure.pose[:2]), math.dist(place, self._usual_place)
        return since_sure_px > GONE_BEHIND_SURE * size_px and since_usual_px > GONE_BEHIND_USUAL * size_px

    def _come_less_far(self) -> None:
        """What slowed down while it was doubted went on at its old speed: it is half way between there and where it was
        before, unless that is so far that something else has drawn its box along."""
        contours = self._contours
        middle = (contours.pose + self._before.pose) / 2
        if math.hypot(*(middle - contours.pose)[:2].tolist()) <= OVERSHOT_MAX_PX:
            contours.pose[:] = middle
            self._failing_s = 0.0

    def _doubt(self, elapsed_s: float) -> None:
        """Count a look that failed, and note where things stood before the first."""
        if self._failing_s == 0:
            self._before = Standing.of(self._contours)
            if self._sure is not None and self._before.stamp_ns - self._sure.stamp_ns < SURE_AGE_NS:
                self._before = self._sure
        self._failing_s += elapsed_s

    def _has_failed(self) -> bool:
        return self._failing_s > (LEAVING_S if self._is_leaving() else FAILING_S)

    def _is_leaving(self) -> bool:
        """Whether the target is at a border of the sensor and was moving over it."""
        box, (right, down) = self._contours.box, self._leaving_velocity
        edges = (
            (box.x <= 1, -right),
            (box.x + box.w >= self._surface.width - 1, right),
            (box.y <= 1, -down),
            (box.y + box.h >= self._surface.height - 1, down),
        )
        return any(is_there and outward > SPEED_OUT_PX_S for is_there, outward in edges)

    def _fail(self, stamp_ns: int, since_ns: int | None = None, *, may_have_left: bool = True) -> None:
        """Go on from before the looks that failed, as they may have followed something else; the target has not been
        seen since `since_ns` (ns), by default until now."""
        contours = self._contours
        is_off = not self._surface.holds(*contours.pose[:2])
        if since_ns is None:
            self._doubt(0.0)
        contours.is_changing, contours.least_speed_px_s = False, 0.0
        contours.stamp_ns = self._before.stamp_ns
        contours.pose[:], contours.velocity[:] = self._before.pose, self._before.velocity
        if since_ns is None and self._surface.inside_px(contours.box_at(*contours.predicted(stamp_ns))) >= 0:
            # What drew its box over the border was something else: the target's own motion does not.
            is_off = False
        self._state = TargetState.LOST if is_off else TargetState.RECOVERING
        self._leaving_velocity = self._before.velocity
        has_left = is_off or (may_have_left and self._is_leaving())
        if self._before is self._sure and not has_left:
            contours.restore_memories()
        contours.uncover()
        self._images.begin(stamp_ns)
        if since_ns is None:
            self._search_from(stamp_ns, has_left=has_left)
        else:
            self._search_from(since_ns, has_left=has_left, has_gap=True)

    def _search_from(self, stamp_ns: int, *, has_left: bool, has_gap: bool = False) -> None:
        self._search = ContourSearch(
            self._contours,
            self._surface,
            self._usual,
            self._before,
            self._motion.speed_px_s,
            stamp_ns,
            has_left=has_left,
            has_gap=has_gap,
        )

    def _look_for_it(self, stamp_ns: int, image: FrameData | None) -> None:
        """Search for the contours in a growing region, and the images now and then."""
        search = self._search
        if self._state is TargetState.RECOVERING and search.since_s > self._config.recovering_max_s and not self._held:
            self._state = TargetState.LOST
        search.coast()
        search.keep()
        answer = None
        if self._held is None:
            answer = self._images.found(stamp_ns, image, self._state, self.last_box)
        if answer is not None:
            self._contours.pose[:2] = answer.box.center
            self._contours.stop()
            self._settling = SETTLING_LOOKS
        elif not search.found():
            return
        elif search.is_unsettled:
            self._settling = SETTLING_LOOKS
        self._state = TargetState.TRACKING
        self._motion.steady.forget()
        self._held = None
        self._failing_s = 0.0
        self._confidence = CONFIDENCE_FOUND if answer is None else answer.score
