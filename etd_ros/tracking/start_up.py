"""A target's first motion: that for which its events agree with one another, before there is a model to fit."""

from __future__ import annotations

import copy
import math

import numpy as np

from etd_ros.tracking.body import Standing, pair
from etd_ros.tracking.camera_slide import Slide
from etd_ros.tracking.coherent_motions import GRID_MARGIN, STEPS_PX, Apart, CoherentMotions
from etd_ros.tracking.contour_drawing import splat
from etd_ros.tracking.contour_kernels import Float32Array, Float64Array
from etd_ros.tracking.contours import Contours
from etd_ros.tracking.edge_flow import EdgeFlow, EdgeFlows
from etd_ros.tracking.growth import FLOW_MARGIN_PX, START_SPAN_S, arm_px, growth_trust, stands_alone
from etd_ros.tracking.slid_past import ALONG_MIN_PX_S
from etd_ros.tracking.start_events import Reading, StartEvents, as_looks_see, some_of
from etd_ros.tracking.surface import TimeSurface, Window
from etd_ros.tracking.surroundings import LATE_S, Surroundings
from etd_ros.tracking.turning import Turned, turning_at_start

LOOKS = 10
"""Looks that the start lasts, or more, until the target has moved by MOTION_MIN_PX."""
MOTION_MIN_PX, MOTION_MAX_PX = 2.0, 8.0
TIME_MAX_S = 0.5
SILENT_S, REST_S = 0.05, 0.05
"""Where for so long nothing moved on the sensor, or nothing but noise came round its box, a target that was not seen to
move has rested."""
STANDS_PX = 1.0
LOOK_S, LOOK_EVENTS = 0.005, 2.0
"""A look of the start waits for this time, or for so many events for each pixel of the box's width and height. Frames
may be shorter, as the rest of the scene ends them, and a velocity that is fitted often to little strays."""
FAST_LOOKS = 3
"""The first so many looks also try motions farther off: what is thrown may have moved by several pixels within the
shortest frame."""
FAST_TRUST = ((0.5, 1.5), (0.7, 1.1))
"""What lets a motion that is found so be believed (`Motion.is_clearly_better`)."""
EVENTS_MIN = 20
ALIKE_ENOUGH = 0.5
"""Where parts of the time are less alike than this at the best velocity, that is believed by as much less: some
velocity is the best also where none is right, as for a lamp that is brighter in one part and darker in the next."""
LEFT_TRUST = ((0.3, 1.5), (0.7, 1.1))
"""The same as FAST_TRUST for the motion of what has left its box: that is faint at first."""
SHARED_AGREES, SHARED_APART_PX = 0.85, 2.5
"""Events in the box of another target count as well where its own agree so many times as well at the velocity of all as
at their own, if that is so far from each other's (at the end of the motion)."""
LOOKS_KNOWN = 10
GROWTH_SHARES = 0.25, 0.5, 0.75, 1.0
"""So much is tried of the growth that a flow is believed to have."""
TURNING_AGREES = 0.9
"""With turning its events have to agree so many times as well as with the best motion along."""
SHAPE_AROUND_MAX = 0.04
"""Where more is round a box, for each pixel, the events in its corners may be of that, too."""
APART_PX = 3.0
"""After so much motion, events that move like the ring can be told from the target's."""
SLIDES_AGREES = 0.995
"""It goes the way of all that a sliding camera sees if its events agree so many times as well in that direction: those
of what moves by itself do not, once it has gone a pixel across."""
DRAWN_MIN_PX = 1.0
"""What lies behind has drawn the velocity along where both differ by so much at the end; by less they stray anyway."""
NEXT_STEPS = np.array([(right, down) for down in (-1, 0, 1) for right in (-1, 0, 1)])
"""To a velocity itself and to those round it."""


class StartUp:
    """Collects a target's first events and moves its pose at the constant velocity with which they agree best.

    What lies behind it may move at nearly the same velocity, and draws the target's along. So each event counts by how
    much better it agrees with the others at the target's velocity than at that of the ring round the target.

    What hardly differs from what lies behind it makes no events at first, and may have left its box by the time that it
    does. Where little else moves round the box, what moves there is taken for it.

    The target is at its box at its start stamp, and the first frame may come a while later: so the model is drawn
    round where it was, and the pose is what the motion makes of it. As long as nothing but noise comes from round the
    box it rests there, and its start is put off.
    """

    def __init__(self, contours: Contours) -> None:
        self._contours = contours
        self._body = contours.body
        self._pose_at_first = self._body.pose
        self._pose = np.array(self._pose_at_first)
        self._arm_px = arm_px(*self._body.size_px)
        self._motions = CoherentMotions(self._pose, self._body.size_px, contours.cell_px)
        self._looked_at_ns: int | None = None
        self._events_waiting = 0
        self._rests = False
        self._late_s = 0.0
        self._begin(self._body.stamp_ns)

    def _begin(self, stamp_ns: int) -> None:
        """The target is in its start box at this time (ns)."""
        self._contours.stop()
        self._body.pose = self._pose_at_first
        self._growing_per_s = self._turning_rad_s = 0.0
        self._start_ns = self._body.stamp_ns = stamp_ns
        self._own = self._every = self._read = Reading(StartEvents(), np.zeros(2))
        self._fast_looks = 0
        self._seen_turning = 0.0
        self._surroundings = Surroundings(self._body.box, stamp_ns, self._late_s)

    def begin_again(self, stamp_ns: int) -> None:
        """The target is in its start box still (ns), and what has come so far is not its own."""
        self._looked_at_ns, self._events_waiting = stamp_ns, 0
        self._begin(stamp_ns)

    def take(self, surface: TimeSurface, new_events: int) -> bool:
        """Take the newest frame, which brought so many events, and look where it is time; whether the start is over and
        the model is known."""
        if self._looked_at_ns is None:
            self._looked_at_ns = surface.start_ns
            # In frames that were not looked at it may have moved.
            self._late_s = max(0.0, (surface.before_ns - self._start_ns) * 1e-9)
            self._begin(self._start_ns)
        if self.stands and (surface.start_ns - max(surface.before_ns, self._start_ns)) * 1e-9 > SILENT_S:
            # Nothing moved anywhere.
            self._begin(surface.start_ns)
        if not self._rests:
            self._surroundings.take(surface, self._contours.own.others)
        elapsed_s = (surface.stamp_ns - self._looked_at_ns) * 1e-9
        self._events_waiting += new_events
        if elapsed_s < LOOK_S and self._events_waiting < LOOK_EVENTS * sum(self._body.size_px):
            return False
        self._looked_at_ns = surface.stamp_ns
        self._events_waiting = 0
        if self.stands and self._sees_noise(surface):
            self._begin(surface.stamp_ns)
            return False
        return self._look(surface, elapsed_s)

    @property
    def is_new(self) -> bool:
        """Whether it has collected nothing yet."""
        return self._own.collected.looks == 0

    @property
    def stands(self) -> bool:
        """Whether the target is not known to have moved."""
        body = self._body
        moved_px = body.speed_px_s * (body.stamp_ns - self._start_ns) * 1e-9
        return moved_px <= STANDS_PX and self._late_s <= LATE_S

    def _sees_noise(self, surface: TimeSurface) -> bool:
        """Whether there was nothing but noise for REST_S: the target has rested, and starts later than was said."""
        if self._rests or (surface.stamp_ns - self._start_ns) * 1e-9 >= REST_S:
            window = surface.window(self._body.box.scaled(GRID_MARGIN), 0.0)
            self._rests = surface.shows_noise(window, REST_S)
        return self._rests

    def _look(self, surface: TimeSurface, elapsed_s: float) -> bool:
        """Take the events of this time (s); whether the start is over and the model is known."""
        contours, body = self._contours, self._body
        time_s = (surface.stamp_ns - self._start_ns) * 1e-9
        points, count = surface.points(self._window(surface, time_s), elapsed_s)
        self._collect(points[:count], time_s, surface.stamp_ns)
        fitted_s = max(time_s, elapsed_s, 1e-3)
        self._fit(fitted_s)
        has_left = self._follow_out(fitted_s)
        events = self._read.collected.events
        self._growing_per_s = self._turning_rad_s = 0.0
        along = self._read.velocity
        if not has_left:
            self._take_flow(surface, events, time_s)
        moved = math.hypot(*self._read.velocity.tolist(), *self._outline_px_s()) * time_s
        is_over = (
            (self._read.collected.looks >= LOOKS and moved >= MOTION_MIN_PX)
            or (moved >= MOTION_MAX_PX and len(events) >= sum(body.size_px) and not self._is_disputed(time_s))
            or time_s >= TIME_MAX_S
        )
        if is_over and self._turning_rad_s != 0 and self._is_before_what_moves_otherwise(events, along, time_s):
            self._read.velocity = along
            self._growing_per_s = self._turning_rad_s = 0.0
        if is_over and not any(self._outline_px_s()):
            apart = self._apart(events, time_s)
            if apart is not None:
                self._read.velocity, events = apart
                moved = math.hypot(*self._read.velocity.tolist()) * time_s
            elif moved > APART_PX:
                # The velocity has been believed for APART_PX.
                told = self._motions.told_apart(events, time_s, self._read.velocity)
                if math.dist(told.tolist(), self._read.velocity.tolist()) * time_s >= DRAWN_MIN_PX:
                    self._read.velocity = told
        goes_with_all = self._take_slide(surface.slide, events, time_s)
        body.velocity = pair(self._read.velocity)
        body.be_at(*pair(self._pose[:2] + self._read.velocity * time_s))
        contours.change_since(self._pose_at_first, self._growing_per_s, self._turning_rad_s, time_s)
        body.stamp_ns = surface.stamp_ns
        if has_left:
            # So far the surface was kept up to date where it was believed.
            contours.keep(surface)
        if is_over:
            at_first = Standing(self._start_ns, self._pose_at_first, body.velocity)
            contours.slid_past.begin(at_first, surface.slide if goes_with_all else None)
            self._finish(events, moved, surface)
        return is_over

    def _take_slide(self, slide: Slide | None, events: Float32Array, time_s: float) -> bool:
        """Whether the target goes the way of all that a sliding camera sees, as far as that is known: its velocity is
        the best in that direction then."""
        if slide is None or any(self._outline_px_s()) or time_s <= 0 or len(events) < EVENTS_MIN:
            return False
        direction, so_far = np.array(slide.direction), self._read.velocity
        along = self._motions.along(events, time_s, so_far, direction)
        free = self._motions.best_of(some_of(events), time_s, so_far[None])
        if along.velocity @ direction < ALONG_MIN_PX_S or along.agreement < SLIDES_AGREES * free.agreement:
            return False
        self._read.velocity = along.velocity
        return True

    def _is_before_what_moves_otherwise(self, events: Float32Array, velocity: Float64Array, time_s: float) -> bool:
        """Whether what is round the target moves as one, and otherwise than the target does if it does not turn
        (pixels/s): seen beside it, on one side more than on the other, that makes its edges seem to turn."""
        backdrop = self._contours.own.backdrop
        backdrop.see_start(events, self._pose, time_s)
        return backdrop.is_settled and not backdrop.is_with(pair(velocity), time_s)

    def _apart(self, events: Float32Array, time_s: float) -> Apart | None:
        """The target told from what moves as one round it, if that moves otherwise."""
        backdrop = self._contours.own.backdrop
        backdrop.see_start(events, self._pose, time_s)
        if not backdrop.is_settled or len(events) < EVENTS_MIN:
            return None
        return self._motions.apart_from(np.array(backdrop.velocity), events, time_s, self._read.velocity)

    def _outline_px_s(self) -> tuple[float, float]:
        """How fast its outline moves by turning and by growing (pixels/s)."""
        return self._turning_rad_s * self._arm_px, self._growing_per_s * self._arm_px

    def _take_flow(self, surface: TimeSurface, events: Float32Array, time_s: float) -> None:
        """Take how fast the target has turned and grown since its start from the flow of its edges; if it has, its
        velocity is that of the flow, too: some shift always agrees best with edges that go round or move apart."""
        config, body = self._contours.config, self._body
        if time_s <= 0 or self._late_s > LATE_S or self._contours.own.others.free < 1:
            return
        place = self._pose[:2] + self._read.velocity * time_s
        x, y = place.tolist()
        window, span_s = surface.window(body.box_at(x, y), FLOW_MARGIN_PX), min(time_s, START_SPAN_S)
        flows = surface.flows(window, span_s, x, y)
        if flows is None:
            return
        turned = self._turned(flows, place, events, time_s, span_s) if config.angle_gain > 0 else None
        if turned is not None:
            self._read.velocity, self._turning_rad_s, self._growing_per_s = turned
        elif config.scale_gain > 0:
            self._read.velocity, _, self._growing_per_s = self._grown(flows.along, place, events, time_s, span_s)

    def _grown(self, flow: EdgeFlow, place: Float64Array, events: Float32Array, time_s: float, span_s: float) -> Turned:
        """How the target has grown for this time (s) by the flow of its edges round a place (pixels) in the last
        `span_s`: as far as the flow is believed, and as far as its events agree the better."""
        velocity = self._read.velocity
        best, agreement = Turned(velocity, 0.0, 0.0), self._read.agreement
        believed = growth_trust(flow, self._arm_px, time_s)
        if believed == 0 or len(events) < EVENTS_MIN:
            return best
        for tried in GROWTH_SHARES:
            share = tried * believed
            part = flow._replace(velocity=velocity + share * (flow.velocity - velocity))
            grown = Turned.of_flow(part, share * flow.growing_per_s, self._pose[:2], place, time_s - span_s / 2)
            agrees = self._motions.agreement_if(grown, events, time_s)
            if agrees > agreement:
                best, agreement = grown, agrees
        return best

    def _turned(
        self, flows: EdgeFlows, place: Float64Array, events: Float32Array, time_s: float, span_s: float
    ) -> Turned | None:
        """How the target has turned for this time (s), if the flow of its edges round a place (pixels) in the last
        `span_s` says so for the second look in a row, and its events agree with that about as well as with a motion
        along."""
        before, self._seen_turning = self._seen_turning, 0.0
        rate = turning_at_start(flows, self._arm_px, time_s)
        if rate == 0 or len(events) < EVENTS_MIN:
            return None
        flow, grows = flows.turning, self._contours.config.scale_gain > 0
        growing_per_s = growth_trust(flow, self._arm_px, time_s) * flow.growing_per_s if grows else 0.0
        turned = Turned.of_flow(flow, growing_per_s, self._pose[:2], place, time_s - span_s / 2)
        if self._motions.agreement_if(turned, events, time_s) < TURNING_AGREES * self._read.agreement:
            return None
        self._seen_turning = rate
        return turned if before * rate > 0 else None

    @property
    def _readings(self) -> tuple[Reading, ...]:
        """Its own events, and all, once they differ."""
        return (self._own,) if self._every is self._own else (self._own, self._every)

    def _window(self, surface: TimeSurface, time_s: float) -> Window:
        """Where the target and what is round it may be so long after the start (s), by each reading."""
        windows = []
        for reading in self._readings:
            box = self._body.box_at(*pair(self._pose[:2] + reading.velocity * time_s)).scaled(GRID_MARGIN)
            windows.append(surface.window(box, self._contours.config.search_radius + 2))
        tops, bottoms, lefts, rights = zip(*windows, strict=True)
        return min(tops), max(bottoms), min(lefts), max(rights)

    def _collect(self, points: Float32Array, time_s: float, stamp_ns: int) -> None:
        """Collect the points of a look so long after the start (s); beside them, once some are in the boxes of other
        targets, those as well."""
        others = self._contours.own.others
        every = points if others.are_far else points.copy()
        own = points[: others.leave_out(points, len(points), stamp_ns)]
        if self._every is self._own and len(own) < len(every):
            self._every = copy.deepcopy(self._own)
        self._own.collected.take(own, time_s)
        if self._every is not self._own:
            self._every.collected.take(every, time_s)

    def _fit(self, time_s: float) -> None:
        """Fit the velocity, to what is in the boxes of other targets as well unless that moves otherwise."""
        tries_far = self._fast_looks < FAST_LOOKS
        fitted = [self._fit_reading(reading, time_s, tries_far=tries_far) for reading in self._readings]
        self._fast_looks += any(fitted)
        self._read = self._every if self._others_go_along(time_s) else self._own

    def _fit_reading(self, reading: Reading, time_s: float, *, tries_far: bool) -> bool:
        """The velocity with which events agree best, near the one believed so far or, if that is tried, farther off
        where that is clearly better; by how far it can be believed. Whether there are enough of them."""
        events, so_far = reading.collected.events, reading.velocity
        if len(events) < EVENTS_MIN:
            return False
        best = self._motions.near(events, time_s, so_far)
        if tries_far:
            far = self._motions.farther_off(events, time_s, so_far, best)
            best = far if far.is_clearly_better(best, FAST_TRUST) else best
        reading.velocity = min(1.0, max(0.0, best.alike) / ALIKE_ENOUGH) * best.velocity
        reading.agreement = best.agreement
        return True

    def _is_disputed(self, time_s: float) -> bool:
        """Whether its own events and all say otherwise how it moves: more of them tell who is right."""
        return math.dist(self._own.velocity.tolist(), self._every.velocity.tolist()) * time_s >= SHARED_APART_PX

    def _others_go_along(self, time_s: float) -> bool:
        """Whether what is in the boxes of other targets does not move otherwise than the target: its own events agree
        better at the velocity of all, or about as well at one that is none of the others'. Somebody's box may be round
        nothing but what lies behind; without the edges of the target that are in it, its own events may agree at any
        velocity."""
        own, velocity = self._own.collected.events, self._every.velocity
        if self._every is self._own or len(own) < EVENTS_MIN:
            return True
        shared = self._motions.best_of(own, time_s, velocity[None])
        from_others_px = np.hypot(*(self._contours.own.others.velocities - velocity).T) * time_s
        agrees = SHARED_AGREES if (from_others_px >= SHARED_APART_PX).all() else 1.0
        return shared.agreement >= agrees * self._own.agreement

    def _follow_out(self, time_s: float) -> bool:
        """Take the velocity of what has left the box, if something has; its events are those of the start then."""
        believed = self._read.velocity
        candidates = self._surroundings.velocities(believed, time_s)
        if len(candidates) == 0:
            return False
        events = self._surroundings.events
        some = some_of(events)
        velocity = self._motions.best_of(some, time_s, candidates).velocity
        # The larger the box, the farther apart they are.
        step_px = self._surroundings.step_px / 2
        while step_px > STEPS_PX[0][0]:
            nearer = velocity + NEXT_STEPS * (step_px / time_s)
            velocity = self._motions.best_of(some, time_s, nearer).velocity
            step_px /= 2
        left = self._motions.near(some, time_s, velocity)
        # What flickers beside the box agrees best at rest.
        here = self._motions.best_of(some, time_s, np.stack([believed, np.zeros(2)]))
        if not left.is_clearly_better(here, LEFT_TRUST):
            return False
        self._read.velocity = left.velocity
        # What was collected where it was believed is not of it.
        self._read.collected.replace(events)
        self._own = self._every = self._read
        return True

    def _finish(self, events: Float32Array, moved_px: float, surface: TimeSurface) -> None:
        contours, body = self._contours, self._body
        right, down = body.velocity
        around_px_s, outward_px_s = self._outline_px_s()
        speed_px_s = math.hypot(right, down, around_px_s, outward_px_s)
        window_s = contours.config.window_px / max(speed_px_s, 1e-3)
        seen = as_looks_see(events, window_s)
        motion = body.motion
        if around_px_s != 0:
            turned = Turned(self._read.velocity, self._turning_rad_s, self._growing_per_s)
            seen, motion = turned.undone(seen, self._pose[:2]), np.zeros(4)
            body.take_shape(seen[:, :2] - self._pose[:2])
        elif not body.is_fast and stands_alone(surface, body.box, window_s, SHAPE_AROUND_MAX):
            body.take_shape(Turned(self._read.velocity, 0.0, 0.0).from_middle(seen, self._pose[:2]))
        splat(seen, len(seen), self._pose, contours.cell_px, motion, contours.drawn)
        outline = np.array([right, down, around_px_s, outward_px_s])
        direction = outline / speed_px_s if speed_px_s > 1e-6 else np.zeros(4)
        contours.begin(direction, max(1.0, moved_px / contours.config.window_px), LOOKS_KNOWN)
