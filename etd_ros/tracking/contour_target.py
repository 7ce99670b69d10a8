"""One target of `etd-plus`: contours that are followed, and what happens when they cannot be.

The states are those of `target`. A target that stands still makes no events and goes on TRACKING where it is: nothing
says that it is gone. It is RECOVERING when the events where it should be are not its own for a while, or when they end
while it was leaving the sensor. Then its contours are looked for in a region that grows round where its motion would
have brought it, and the recovery tracker searches the images.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from etd_ros.boxes import Box
from etd_ros.recovery.interface import Found, RecoveryTracker
from etd_ros.tracking.contour_kernels import Float64Array
from etd_ros.tracking.contours import ContourConfig, Contours, Look
from etd_ros.tracking.start_up import StartUp
from etd_ros.tracking.surface import TimeSurface
from etd_ros.tracking.target import FrameData, RecoveryFactory, TargetReport, TargetState, TrackerConfig

SEARCH_MARGIN = 1.5
"""Width and height of the region that drives the frames, in those of the box (the paper's tau)."""
EVENTS_MIN = 15.0
"""Fewer events under the model say nothing about the target."""
CONFIDENCE_OK, CONFIDENCE_MIN, CONFIDENCE_FOUND = 0.55, 0.3, 0.75
"""From where on a look is believed in full, not at all, and is the target found again (docs/tracking.md)."""
CONFIDENCE_USUAL = 0.7
"""Below this, what the target looked like lately is tried."""
CHANGING_PX, TRUST_MIN = 1.0, 0.1
"""A look that is doubted still teaches, by what trust is left, if it finds the target this near to where it should be:
then it changes, rather than something else being in its place."""
CONFIDENCE_FOUND_HERE = 0.6
"""The same where its motion would have brought it."""
KNOWN_MIN = 0.3
USUAL_RATE = 0.08
FAILING_S, LEAVING_S = 0.3, 0.12
"""So long looks may fail before the target counts as lost; the second at the border of the sensor."""
FORGIVING = 2.0
"""How much faster good looks make up for failing ones."""
VANISHING_PX_S, VANISHING_SHARE = 20.0, 0.75
"""A target that is faster than this, and than this share of its usual speed, does not come to a halt at once."""
SPEED_OUT_PX_S = 10.0
SPEED_S = 0.1
"""The usual speed is an average over this time."""
STILL_S = 0.03
"""The velocity of a target without events decays with this time constant."""
COAST_S = 0.5
"""The motion of a target that is not seen is believed for so long."""
FOUND_LOOKS = 2
FOUND_DISTANCE_PX = 6.0
SETTLING_LOOKS = 4
"""After it was found its motion is not known for so many looks."""
SEARCH_STEP_PX = 3.0
SEARCH_RADIUS_PX, SEARCH_GROWTH_PX_S, SEARCH_RADIUS_MAX_PX = 9.0, 60.0, 36.0
REMEMBER_NS = 50_000_000
IMAGE_SEARCH_NS = {TargetState.RECOVERING: 50_000_000, TargetState.LOST: 200_000_000}
"""How often images are searched. An answer counts from the next time on, however long it took."""
CONTOUR_SEARCH_NS, CONFIRM_NS = 15_000_000, 6_000_000
"""How often contours are, and how soon again once they were found: a search takes as long as ten looks, and many
targets may be lost at once."""
_SEARCHES = ThreadPoolExecutor(max_workers=1, thread_name_prefix="recovery")


class ContourTarget:
    """One tracked target; the arguments are those of `Target`, with the surface that all targets share."""

    def __init__(
        self,
        name: str,
        box: Box,
        stamp_ns: int,
        config: TrackerConfig,
        contours: ContourConfig,
        surface: TimeSurface,
        recovery_factory: RecoveryFactory | None,
    ) -> None:
        self.name = name
        self.start_box = box
        self.start_stamp_ns = stamp_ns
        self._config = config
        self._contour_config = contours
        self._surface = surface
        self._recovery_factory = recovery_factory
        self._state: TargetState
        self._contours: Contours
        self._start_up: StartUp | None
        self._recovery: RecoveryTracker | None
        self._usual: Float64Array | None
        self._confidence: float
        self._answer: Future[Found | None] | None
        self._candidate: Look | None
        self._held: Box | None
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

    def update(self, stamp_ns: int, _frame_data: FrameData, image: FrameData | None) -> TargetReport:
        """Take the next frame, which the surface holds already, and the intensity image of the same stamp if there is
        one; the arguments are those of `Target.update`."""
        if self._state is TargetState.IDLE:
            if stamp_ns < self.start_stamp_ns:
                return TargetReport(self.name, self._state, None, 0.0)
            self._state = TargetState.TRACKING
            self._contours.stamp_ns = self.start_stamp_ns or stamp_ns
            self._start_up = StartUp(self._contours)
        due = self._contours.take(self._surface)
        if self._state is not TargetState.TRACKING:
            self._look_for_it(stamp_ns, image)
        elif due and self._start_up is not None:
            if self._start_up.look(self._surface):
                self._start_up = None
        elif due:
            self._follow(stamp_ns)
        if self._state is not TargetState.TRACKING:
            return TargetReport(self.name, self.state, self._held, 0.0)
        self._remember(stamp_ns, image)
        box = self._contours.box_at(*self._contours.predicted(stamp_ns))
        return TargetReport(self.name, self._state, box, min(1.0, self._confidence))

    def time_went_back(self, stamp_ns: int) -> None:
        """The stream starts again at `stamp_ns` (ns): wait for the start again, or go on if that was "now"."""
        if self.start_stamp_ns > 0:
            self._wait_for_start()
            return
        self._contours.stamp_ns = stamp_ns
        self._contours.velocity[:] = 0
        self._failed_at_ns = self._searched_at_ns = self._looked_for_at_ns = self._remembered_at_ns = stamp_ns

    def _wait_for_start(self) -> None:
        self._state = TargetState.IDLE
        self._contours = Contours(self.start_box, self.start_stamp_ns, self._contour_config)
        self._start_up = StartUp(self._contours)
        self._recovery = self._recovery_factory() if self._recovery_factory else None
        self._usual = None
        self._confidence = 1.0
        self._failing_s = self._quiet_s = self._usual_speed_px_s = 0.0
        self._failed_at_ns = self._searched_at_ns = self._looked_for_at_ns = 0
        self._remembered_at_ns = -REMEMBER_NS
        self._answer = None
        self._before = 0, self._contours.pose.copy(), self._contours.velocity.copy()
        self._leaving_velocity = self._contours.velocity.copy()
        self._settling = 0
        self._is_at_failure = False
        self._held = None
        self._candidate = None
        self._candidates = 0

    def _follow(self, stamp_ns: int) -> None:
        """Look for the target round where it should be, and go there as far as the look can be believed."""
        contours = self._contours
        contours.is_changing = False
        elapsed_s = (stamp_ns - contours.stamp_ns) * 1e-9
        look = contours.look(self._surface, any_motion=self._settling > 0)
        x, y = contours.predicted(stamp_ns)
        if look.events < EVENTS_MIN:
            self._go_without_events(stamp_ns, elapsed_s)
            return
        self._quiet_s = 0.0
        self._leaving_velocity = contours.velocity.copy()
        self._usual_speed_px_s += (1 - np.exp(-elapsed_s / SPEED_S)) * (contours.speed_px_s - self._usual_speed_px_s)
        self._confidence = self._confidence_of(look)
        if self._failing_s == 0:
            # A new direction of motion shows edges that the model cannot know.
            self._confidence /= max(contours.known, KNOWN_MIN)
        if self._confidence < CONFIDENCE_USUAL:
            look = self._look_for_change(look)
        if self._confidence < CONFIDENCE_OK:
            turned = contours.look(self._surface, any_motion=True)
            if self._confidence_of(turned) > self._confidence:
                look, self._confidence = turned, self._confidence_of(turned)
                contours.turn(look.direction)
        doubt = float(np.clip((CONFIDENCE_OK - self._confidence) / (CONFIDENCE_OK - CONFIDENCE_MIN), 0, 1))
        if doubt > 0:
            self._doubt(elapsed_s * doubt)
        trust = 1.0 - doubt
        contours.follow(self._surface, x + trust * (look.x - x), y + trust * (look.y - y), trust)
        if doubt == 0:
            self._failing_s = max(0.0, self._failing_s - FORGIVING * elapsed_s)
            evidence = _evidence(look)
            self._usual = evidence if self._usual is None else self._usual + USUAL_RATE * (evidence - self._usual)
            self._settling = max(0, self._settling - 1)
        is_near = np.hypot(look.x - x, look.y - y) < CHANGING_PX
        if not self._settling and (doubt == 0 or (trust > TRUST_MIN and is_near)):
            contours.adapt(self._surface, elapsed_s, trust)
        if self._has_failed() or self._is_off(*contours.pose[:2]):
            self._fail(stamp_ns)

    def _look_for_change(self, look: Look) -> Look:
        """A look at what the target was like lately, if that fits better: it, or what is behind it, has changed."""
        self._contours.is_changing = True
        recent = self._contours.look(self._surface, any_motion=self._settling > 0)
        confidence = self._confidence_of(recent)
        if confidence > self._confidence:
            self._confidence = confidence
            return recent
        self._contours.is_changing = False
        return look

    def _confidence_of(self, look: Look) -> float:
        """A look in parts of the usual ones: its score or the number of its events, whichever is less. Things in front
        bring events elsewhere, or none."""
        return 1.0 if self._usual is None else float((_evidence(look) / self._usual).min())

    def _go_without_events(self, stamp_ns: int, elapsed_s: float) -> None:
        """A target that was slowing down stands still now; one that was not may have vanished behind something, or have
        stopped: it keeps its box, and is looked for there and where its motion would bring it."""
        contours = self._contours
        if self._is_leaving():
            self._quiet_s += elapsed_s
        elif contours.speed_px_s > max(VANISHING_PX_S, VANISHING_SHARE * self._usual_speed_px_s):
            self._failing_s = 0.0
            self._fail(stamp_ns)
            self._held = contours.box
            return
        contours.velocity *= np.exp(-elapsed_s / STILL_S)
        contours.stamp_ns = stamp_ns
        if self._quiet_s > LEAVING_S or self._has_failed():
            self._fail(stamp_ns)

    def _doubt(self, elapsed_s: float) -> None:
        """Count a look that failed, and note where things stood before the first."""
        if self._failing_s == 0:
            self._before = self._contours.stamp_ns, self._contours.pose.copy(), self._contours.velocity.copy()
        self._failing_s += elapsed_s

    def _has_failed(self) -> bool:
        return self._failing_s > (LEAVING_S if self._is_leaving() else FAILING_S)

    def _is_off(self, x: float, y: float) -> bool:
        """Whether the middle of a target there (pixels) lies beyond the sensor."""
        return not (0 <= x < self._surface.width and 0 <= y < self._surface.height)

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

    def _fail(self, stamp_ns: int) -> None:
        """Go on from before the looks that failed, as they may have followed something else."""
        self._state = TargetState.LOST if self._is_off(*self._contours.pose[:2]) else TargetState.RECOVERING
        self._contours.is_changing = False
        self._doubt(0.0)
        self._contours.stamp_ns, self._contours.pose[:], self._contours.velocity[:] = self._before
        self._failed_at_ns = self._searched_at_ns = stamp_ns
        self._candidate, self._candidates = None, 0

    def _look_for_it(self, stamp_ns: int, image: FrameData | None) -> None:
        """Search for the contours in a growing region, and the images now and then."""
        since_s = (stamp_ns - self._failed_at_ns) * 1e-9
        if self._state is TargetState.RECOVERING and since_s > self._config.recovering_max_s and self._held is None:
            self._state = TargetState.LOST
        self._coast(stamp_ns, since_s)
        answer = self._answer_from_images(stamp_ns, image)
        if answer is not None:
            self._contours.pose[:2] = answer.box.center
            self._contours.velocity[:] = 0
            self._settling = SETTLING_LOOKS
        elif not self._contours_found(since_s):
            return
        self._state = TargetState.TRACKING
        self._held = None
        self._failing_s = self._quiet_s = 0.0
        self._confidence = CONFIDENCE_FOUND if answer is None else answer.score

    def _coast(self, stamp_ns: int, since_s: float) -> None:
        """Move on with the last velocity, for a while and not beyond the sensor."""
        contours, surface = self._contours, self._surface
        if since_s < COAST_S:
            x, y = contours.predicted(stamp_ns)
            contours.pose[:2] = np.clip(x, 0, surface.width - 1), np.clip(y, 0, surface.height - 1)
        contours.stamp_ns = stamp_ns

    def _contours_found(self, since_s: float) -> bool:
        """Whether looks that follow one another find the target's contours at about the same place; go there then."""
        contours = self._contours
        stamp_ns = self._surface.stamp_ns
        if stamp_ns - self._looked_for_at_ns < (CONTOUR_SEARCH_NS if self._candidate is None else CONFIRM_NS):
            return False
        since_look_s, self._looked_for_at_ns = (stamp_ns - self._looked_for_at_ns) * 1e-9, stamp_ns
        reach = min(SEARCH_RADIUS_PX + SEARCH_GROWTH_PX_S * since_s, SEARCH_RADIUS_MAX_PX)
        side = 2 * int(reach / SEARCH_STEP_PX) + 1
        has_left = self._is_off(*self._before[1][:2])
        if self._candidate is None:
            # It may have stopped instead.
            self._is_at_failure = not self._is_at_failure and not has_left
        x, y = (float(value) for value in (self._before[1] if self._is_at_failure else contours.pose)[:2])
        coarse = contours.look_at(self._surface, x, y, np.zeros((side, side, 4)), SEARCH_STEP_PX)
        look = contours.look_at(self._surface, coarse.x, coarse.y, np.zeros((7, 7, 4)), 1.0)
        is_here = np.hypot(look.x - x, look.y - y) < FOUND_DISTANCE_PX
        wanted = CONFIDENCE_FOUND_HERE if is_here or has_left else CONFIDENCE_FOUND
        is_there = look.events >= EVENTS_MIN and not self._is_off(look.x, look.y)
        is_like_it = is_there and self._confidence_of(look) >= wanted
        before, self._candidate = self._candidate, look if is_like_it else None
        if not is_like_it:
            self._candidates = 0
            return False
        moved = np.array([look.x, look.y]) - ((before.x, before.y) if before is not None else np.inf)
        is_near = np.hypot(*moved) < FOUND_DISTANCE_PX + self._usual_speed_px_s * since_look_s
        self._candidates = self._candidates + 1 if is_near else 1
        if self._candidates < FOUND_LOOKS:
            return False
        contours.pose[:2] = look.x, look.y
        if self._is_at_failure or not is_here:
            # Small moves say nothing of the velocity.
            contours.velocity[:] = moved / since_look_s * (moved @ moved) / (moved @ moved + FOUND_DISTANCE_PX)
            self._settling = SETTLING_LOOKS
        return True

    def _answer_from_images(self, stamp_ns: int, image: FrameData | None) -> Found | None:
        """Have the recovery tracker search this image beside the frames to come; its answer to the last one."""
        due = stamp_ns - self._searched_at_ns >= IMAGE_SEARCH_NS[self._state]
        if self._recovery is None or image is None or not due or self._held is not None:
            return None
        answer = self._answer.result() if self._answer is not None else None
        self._searched_at_ns = stamp_ns
        self._answer = None if answer else _SEARCHES.submit(self._recovery.search, image.copy(), self.last_box)
        return answer

    def _remember(self, stamp_ns: int, image: FrameData | None) -> None:
        if self._answer is not None:
            self._answer.result()
            self._answer = None
        sure = self._start_up is None and self._failing_s == 0
        if self._recovery is None or image is None or stamp_ns - self._remembered_at_ns < REMEMBER_NS:
            return
        if sure or self._remembered_at_ns < 0:
            self._remembered_at_ns = stamp_ns
            self._recovery.remember(image, self._contours.box)


def _evidence(look: Look) -> Float64Array:
    """What a look is measured by: its score and its events, as if all of its window were motion. A slow target has
    fewer events, whose score grows with the root of their number."""
    return np.maximum([look.score / np.sqrt(look.motion), look.events / look.motion], 1e-6)
