"""Follows the contours of one target: looks at it, judges what looks say, and goes where they find it as far as they
can be believed."""

from __future__ import annotations

import copy
import math
from enum import Enum, auto

from etd_ros.tracking.body import nearer
from etd_ros.tracking.contours import Contours, Impression
from etd_ros.tracking.doubts import Doubts
from etd_ros.tracking.look import Look
from etd_ros.tracking.surface import TimeSurface
from etd_ros.tracking.usual_looks import EVENTS_MIN, UsualLooks
from etd_ros.tracking.usual_motion import UsualMotion

CONFIDENCE_OK, CONFIDENCE_MIN = 0.55, 0.3
"""From where on a look is believed in full, and at all (docs/tracking.md)."""
CONFIDENCE_SURE = 0.9
"""From where on nothing stands before the target."""
CONFIDENCE_USUAL = 0.7
"""Below this, what the target looked like lately is tried."""
CHANGING_PX, TRUST_MIN = 1.0, 0.1
"""A look that is doubted still teaches, by what trust is left, if it finds the target this near to where it should be:
then it changes, rather than something else being in its place."""
KNOWN_MIN = 0.3
HERE_PX = 3.0
"""A target that is where it is taken to be is no farther off."""
CONFIDENCE_STEADY = 0.9
"""From where on a look says how the target usually moves; below, one that strays from that is doubted."""
COVERED_AFTER_S = 0.5
"""A target that was followed surely for so long is known well enough to tell what covers it from how it changes."""
STEADYING_S = 0.1
"""A target that is drawn along gets its usual motion back in this time."""
VANISHING_PX_S, VANISHING_SHARE = 20.0, 0.75
"""A target that is faster than this, and than this share of its usual speed, does not come to a halt at once."""
EVENTS_FEW = 4.0
"""With so many events a target is not without: of more of its motion there may be enough for a look."""
NOISE_S = 0.03
"""Looks at noise alone for longer are those at a target without events; a single one may be at few of its own."""
STILL_S = 0.03
"""The velocity of a target without events decays with this time constant."""
SETTLING_LOOKS = 4
"""After it was found its motion is not known for so many looks."""


class Outcome(Enum):
    """What has become of a target by a look: it is seen, or has no events and slows down; it can no longer be followed;
    or its events have ended though it was moving."""

    SEEN = auto()
    STILL = auto()
    LOST = auto()
    VANISHED = auto()


class Following:
    """How one target is followed.

    Args:
        contours: the target's; they are moved and learn.
        surface: the events.
        doubts: about the target; looks feed them.

    Attributes:
        usual: what looks at the target usually say.
        motion: how it usually moves.
        confidence: of the last look, or of what else has found the target.
        settling: for so many looks more its motion is not known.
        unseen_s: for how long it has had no events.
    """

    def __init__(self, contours: Contours, surface: TimeSurface, doubts: Doubts) -> None:
        self._contours, self._surface, self._doubts = contours, surface, doubts
        self.usual = UsualLooks()
        self.motion = UsualMotion()
        self.confidence = 1.0
        self.settling = 0
        self.unseen_s = 0.0
        self._noise_s = 0.0

    @property
    def sees_as_usual(self) -> bool:
        """Whether the last looks are believed, and the last one is one of the usual ones."""
        return self._doubts.failing_s == 0 and not self.settling and self.confidence > CONFIDENCE_USUAL

    def take(self, stamp_ns: int) -> Outcome:
        """Look for the target round where it should be at the time of the newest frame (ns), and go there as far as the
        look can be believed."""
        contours, body, doubts = self._contours, self._contours.body, self._doubts
        contours.is_changing = contours.own.takes_backdrop = False
        # Half-believed looks at what turned round at once take it to stand; the events of more time would be blurred.
        contours.least_speed_px_s = self.motion.speed_px_s if doubts.failing_s > 0 else 0.0
        elapsed_s = body.since_s(stamp_ns)
        contours.take_turning_of_flow(self._surface)
        look = self._look_here()
        if EVENTS_FEW <= look.events < EVENTS_MIN and contours.look_longer(look.events, stamp_ns):
            look = self._look_here()
        confidence = self._confidence(look)
        is_noise = confidence < CONFIDENCE_OK and contours.sees_noise(self._surface)
        self._noise_s = self._noise_s + elapsed_s if is_noise else 0.0
        if look.events < EVENTS_MIN or self._noise_s > NOISE_S:
            self.unseen_s += elapsed_s
            return self._go_without_events(stamp_ns, elapsed_s)
        self.unseen_s = 0.0
        doubts.note_velocity()
        self.motion.learn_speed(body.speed_px_s, elapsed_s)
        if doubts.failing_s == 0:
            # A new direction of motion shows edges that the model cannot know.
            confidence /= max(contours.known, KNOWN_MIN)
        self.confidence = min(1.0, confidence) * self._plausible(look, stamp_ns)
        look = self._best_of_others(look, stamp_ns)
        strays = self._doubt_if_it_strays(look, stamp_ns, elapsed_s)
        if self.confidence >= CONFIDENCE_SURE and doubts.failing_s == 0:
            doubts.note_sure(elapsed_s)
            contours.keep_memories()
        if self.confidence >= CONFIDENCE_USUAL:
            doubts.note_usual()
        self._go(look, stamp_ns, elapsed_s, strays=strays)
        return Outcome.LOST if doubts.is_lost else Outcome.SEEN

    def go_on(self, confidence: float, *, is_unsettled: bool) -> None:
        """The target was found, so surely; its motion may not be known."""
        self.confidence, self.unseen_s = confidence, 0.0
        self.motion.steady.forget()
        if is_unsettled:
            self.settling = SETTLING_LOOKS

    def begin_anew(self, usual: UsualLooks, confidence: float) -> None:
        """The target was somewhere else, so surely; looks at it usually say what they once did."""
        self.usual = copy.copy(usual)
        self.motion = UsualMotion()
        self.settling = SETTLING_LOOKS
        self.confidence, self.unseen_s = confidence, 0.0

    def confidence_as(self, impression: Impression, x: float, y: float) -> float:
        """How sure a look is that the target is at a place (pixels), as it looked once, whichever way it moves."""
        return self.usual.confidence(self._contours.look_at(self._surface, x, y, HERE_PX, impression=impression))

    def _look_here(self) -> Look:
        return self._contours.look(self._surface, any_motion=self.settling > 0)

    def _confidence(self, look: Look) -> float:
        """How sure a look is, of the part of the target's box into which no other one reaches."""
        return self.usual.confidence(self._as_if_free(look))

    def _as_if_free(self, look: Look) -> Look:
        """A look with as many events as if no other target reached into the box, so that what is usual stays that of
        all of it. The score is of what is seen: it hardly depends on how much that is."""
        free = self._contours.own.others.free
        return look if free == 1 else look._replace(events=look.events / free)

    def _go_without_events(self, stamp_ns: int, elapsed_s: float) -> Outcome:
        """A target that was slowing down stands still now, as does what is seen by a camera that comes to a halt; one
        that was not has vanished."""
        body, doubts = self._contours.body, self._doubts
        if self._surface.has_just_halted:
            if doubts.failing_s > 0:
                doubts.come_back()
            body.stop()
            body.stamp_ns = stamp_ns
            return Outcome.STILL
        if body.speed_px_s > max(VANISHING_PX_S, VANISHING_SHARE * self.motion.speed_px_s):
            return Outcome.VANISHED
        if doubts.failing_s > 0:
            doubts.come_less_far()
        body.velocity = nearer((0.0, 0.0), body.velocity, math.exp(-elapsed_s / STILL_S))
        body.stamp_ns = stamp_ns
        return Outcome.LOST if doubts.is_lost else Outcome.STILL

    def _plausible(self, look: Look, stamp_ns: int) -> float:
        """How far a target with this motion could be from where it should be, in parts of how far the look finds it; at
        most 1."""
        if self.settling:
            return 1.0
        body = self._contours.body
        x, y = body.predicted(stamp_ns)
        unsure_s = body.since_s(stamp_ns) + self._doubts.failing_s
        return self.motion.plausible(math.hypot(look.x - x, look.y - y), body.speed_px_s, unsure_s)

    def _best_of_others(self, look: Look, stamp_ns: int) -> Look:
        """A look, or where that is not sure a better one: at the events of what is behind it as well, which may be its
        own; at what the target was like lately, as it, or what is behind it, may have changed; or at any motion, as it
        may have turned."""
        contours = self._contours
        if self.confidence < CONFIDENCE_USUAL and contours.own.may_lack_some(stamp_ns):
            contours.own.takes_backdrop = True
            all_events = self._look_here()
            contours.own.takes_backdrop = self._is_better(all_events, stamp_ns)
            look = all_events if contours.own.takes_backdrop else look
        if self.confidence < CONFIDENCE_USUAL:
            contours.is_changing = True
            recent = self._look_here()
            contours.is_changing = self._is_better(recent, stamp_ns)
            look = recent if contours.is_changing else look
        if self.confidence < CONFIDENCE_OK:
            turned = contours.look(self._surface, any_motion=True)
            if self._is_better(turned, stamp_ns):
                contours.turn(turned.direction)
                look = turned
        return look

    def _is_better(self, look: Look, stamp_ns: int) -> bool:
        """Whether a look is surer than the last one; then its confidence counts."""
        confidence = self._confidence(look) * self._plausible(look, stamp_ns)
        is_better = confidence > self.confidence
        if is_better:
            self.confidence = confidence
        return is_better

    def _doubt_if_it_strays(self, look: Look, stamp_ns: int, elapsed_s: float) -> bool:
        """Doubt a look that finds the target changed where following it would change how the target usually moves:
        what covers it draws its box along. Whether it is such a look."""
        steady = self.motion.steady
        if self.settling:
            steady.forget()
            return False
        velocity = self._contours.body.velocity_to(look.x, look.y, stamp_ns)
        if self.confidence >= CONFIDENCE_STEADY:
            steady.learn(velocity, elapsed_s)
            return False
        plausible = steady.plausible(velocity)
        self.confidence *= plausible
        return plausible < 1

    def _go(self, look: Look, stamp_ns: int, elapsed_s: float, *, strays: bool) -> None:
        """Follow a look, and learn from it, by what it can be believed."""
        contours, body = self._contours, self._contours.body
        doubt = min(max((CONFIDENCE_OK - self.confidence) / (CONFIDENCE_OK - CONFIDENCE_MIN), 0.0), 1.0)
        if doubt > 0:
            self._doubts.doubt(elapsed_s * doubt)
        trust = 1.0 - doubt
        x, y = body.predicted(stamp_ns)
        jump_px = math.hypot(look.x - x, look.y - y)
        if strays and doubt > 0:
            body.go_on_at(self.motion.steady.velocity, doubt * min(1.0, elapsed_s / STEADYING_S))
        self._go_to(x + trust * (look.x - x), y + trust * (look.y - y), stamp_ns, trust)
        if doubt == 0:
            self._doubts.believe(elapsed_s)
            self.usual.learn(self._as_if_free(look))
            self.motion.learn_jump(jump_px)
            self.settling = max(0, self.settling - 1)
        if not self.settling and (doubt == 0 or (trust > TRUST_MIN and jump_px < CHANGING_PX)):
            sees_covers = self.motion.steady.seen_s >= COVERED_AFTER_S
            contours.adapt(self._surface, elapsed_s, trust, sees_covers=sees_covers)

    def _go_to(self, x: float, y: float, stamp_ns: int, trust: float) -> None:
        """Be at a place (pixels) at a time (ns), as far as the target may go there in what a camera slides past."""
        body, slid_past = self._contours.body, self._contours.slid_past
        slid_past.take(x, y, stamp_ns, body, self._surface.slide)
        if slid_past.direction is not None:
            here_x, here_y, _, _ = body.pose
            body.velocity = slid_past.held(body.velocity)
            right, down = slid_past.held((x - here_x, y - here_y))
            x, y = here_x + right, here_y + down
        body.go_to(x, y, stamp_ns, trust)
