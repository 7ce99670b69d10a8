"""Any number of targets on the frames of one sensor."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from etd_ros.boxes import SIDE_MIN_PX, Box
from etd_ros.detection import EdgeBoxes, Proposals
from etd_ros.names import NAME_RULE, is_name
from etd_ros.tracking.box_network import shipped_network
from etd_ros.tracking.box_refinement import Corrector
from etd_ros.tracking.camera_rest import CameraRest
from etd_ros.tracking.camera_slide import CameraSlide
from etd_ros.tracking.clicks import Click
from etd_ros.tracking.contour_config import ContourConfig
from etd_ros.tracking.contour_target import ContourTarget
from etd_ros.tracking.drawn_along import DrawnAlong
from etd_ros.tracking.errors import TrackingError
from etd_ros.tracking.other_targets import OtherTargets
from etd_ros.tracking.starter import Changes, Starter
from etd_ros.tracking.surface import TimeSurface
from etd_ros.tracking.target import (
    FrameData,
    RecoveryFactory,
    Search,
    Target,
    TargetReport,
    TargetState,
    TrackerConfig,
    starts_again,
)
from etd_ros.tracking.turns import Turns

_THREADS = ThreadPoolExecutor(max_workers=os.cpu_count(), thread_name_prefix="targets")


@dataclass(frozen=True, slots=True)
class _SetAside:
    """A target that was followed when time went back to before its start, what waits for that start in its place, and
    the time until when it was followed (ns)."""

    target: Target | ContourTarget
    waiting: Target | ContourTarget
    stamp_ns: int


class MultiTracker:
    """Tracks targets that are started and stopped by name. Targets take turns in being looked for on images while they
    are followed; contours leave out the events in the boxes of others, and those that were drawn along by another
    target's go back. Otherwise they do not influence one another.

    Args:
        width: sensor width (pixels).
        height: sensor height (pixels).
        config: parameters of every target.
        detector: makes the proposals; by default one with the default parameters, if they are chosen from.
        recovery_factory: makes one recovery tracker a target; None: a failed target stays lost, unless its contours are
            found.
        contours: follow contours with these parameters (`etd-plus`) instead of choosing proposals.
        searches: whether reports say how each target was looked for, to be drawn.
        starter: starts targets without a box: at clicks, or by themselves.
        search_wait_s: how long after the search of an image began its answer is waited for (s); one that takes longer
            counts when it is there. inf: results do not depend on how fast the machine is.
        corrector: says how far boxes of `etd-plus` are off; by default the network that ships, unless
            `contours.refine_gain` is 0.

    Attributes:
        targets_max: where there are so many targets and clicks that wait, nothing starts by itself; None: no limit.
    """

    def __init__(
        self,
        width: int,
        height: int,
        config: TrackerConfig | None = None,
        detector: EdgeBoxes | None = None,
        recovery_factory: RecoveryFactory | None = None,
        contours: ContourConfig | None = None,
        *,
        searches: bool = False,
        starter: Starter | None = None,
        search_wait_s: float = math.inf,
        corrector: Corrector | None = None,
    ) -> None:
        self._width = width
        self._height = height
        self._config = config or TrackerConfig()
        self._detector = detector
        self._recovery_factory = recovery_factory
        self._contours = contours
        self._corrector = corrector
        if corrector is None and contours is not None and contours.refine_gain > 0:
            self._corrector = shipped_network().misfit_of
        self._searches = searches
        self._starter = starter
        self._search_wait_s = search_wait_s
        self.targets_max: int | None = None
        self._notices: list[str] = []
        self._surface = TimeSurface(width, height)
        self._camera_rest = CameraRest()
        self._camera_slide = CameraSlide(width, height)
        self._turns = Turns()
        self._drawn_along = DrawnAlong()
        self._other_targets = OtherTargets()
        self._targets: dict[str, Target | ContourTarget] = {}
        self._set_aside: dict[str, _SetAside] = {}
        self._last_stamp_ns: int | None = None

    @property
    def targets(self) -> Mapping[str, Target | ContourTarget]:
        """The targets by name, in the order of their start (read-only)."""
        return MappingProxyType(self._targets)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the sensor (pixels)."""
        return self._width, self._height

    def search_regions(self) -> list[Box] | None:
        """Where the targets that have started are looked for on the next frame (pixels); None if there are none."""
        started = (target for target in self._targets.values() if target.state is not TargetState.IDLE)
        return [target.search_region for target in started] or None

    def longest_frame_s(self) -> float:
        """How long the next frames may last (s), so that the fastest target is still where its box is when the next one
        comes; inf: no matter how long."""
        return min((target.longest_frame_s for target in self._targets.values()), default=math.inf)

    def start(self, name: str, box: Box, stamp_ns: int = 0, class_id: str = "") -> None:
        """Track a target that is at `box` at `stamp_ns`.

        Args:
            name: 1 to 64 printable characters without commas; unique.
            box: its box (pixels), which may reach over the sensor's border.
            stamp_ns: tracking starts on the first frame at or after this time (ns), 0: on the next frame.
            class_id: what it is, if that is known: `etd-plus` follows people otherwise (`ContourConfig.for_class`).

        Raises:
            TrackingError: the name is unusable, taken, or that of a click that waits, or the stamp is negative.
            BoxError: the box is not finite, has a side below SIDE_MIN_PX, lies off the sensor or covers all of it.
        """
        self._check_free(name)
        if name in self.waiting_clicks:
            msg = f"target {name!r} waits for what moves at a click: stop it first or choose another name"
            raise TrackingError(msg)
        self._targets[name] = self._made(name, self._checked(name, box, stamp_ns), stamp_ns, class_id)

    def start_again(self, name: str, box: Box, stamp_ns: int = 0, class_id: str = "") -> None:
        """Track a target from another box on, or a new one, by the arguments of `start`; where that is refused, what is
        tracked goes on.

        Raises:
            TrackingError, BoxError: as `start` does.
        """
        made = self._made(name, self._checked(name, box, stamp_ns), stamp_ns, class_id)
        if name in self._targets or name in self.waiting_clicks:
            self.stop(name)
        self._targets[name] = made

    def _checked(self, name: str, box: Box, stamp_ns: int) -> Box:
        box = Box(*map(float, box))
        check_target(name, box, stamp_ns)
        box.check(self._width, self._height, f"box of target {name!r}")
        box.check_not_all(self._width, self._height, f"box of target {name!r}")
        return box

    def _made(self, name: str, box: Box, stamp_ns: int, class_id: str = "") -> Target | ContourTarget:
        if self._contours is None:
            self._detector = self._detector or EdgeBoxes()
            return Target(name, box, stamp_ns, self._config, self._detector, self._recovery_factory)
        return ContourTarget(
            name,
            box,
            stamp_ns,
            self._config,
            self._contours.for_class(class_id),
            self._surface,
            self._recovery_factory,
            self._search_wait_s,
            self._turns,
            self._corrector,
        )

    def click(self, click: Click) -> None:
        """Track the object round a point, once events come there; `take_notices` says if it starts nothing.

        Raises:
            TrackingError: the name is unusable or taken, the point lies off the sensor, the stamp is negative, or this
                tracker has no starter.
        """
        self._check_free(click.name)
        if self._starter is None:
            msg = f"click {click}: this tracker starts no targets by clicks: give it a starter"
            raise TrackingError(msg)
        self._starter.click(click)

    @property
    def waiting_clicks(self) -> list[str]:
        """The names of the clicks that have started nothing yet."""
        return [click.name for click in self._starter.waiting_clicks] if self._starter is not None else []

    def take_notices(self) -> list[str]:
        """What there is to say of clicks that start nothing, since the last call."""
        notices, self._notices = self._notices, []
        return notices

    def _check_free(self, name: str) -> None:
        _check_name(name)
        if name in self._targets:
            msg = f"target {name!r} is being tracked already: stop it first or choose another name"
            raise TrackingError(msg)

    def stop(self, name: str) -> None:
        """Forget a target, or a click that waits.

        Raises:
            TrackingError: there is neither of this name.
        """
        if name not in self._targets and name not in self.waiting_clicks:
            msg = f"there is no target {name!r} to stop: tracked are {', '.join(self._targets) or 'none'}"
            raise TrackingError(msg)
        self._targets.pop(name, None)
        self._drawn_along.forget(name)
        if self._starter is not None:
            self._starter.forget(name)

    def update(
        self, stamp_ns: int, frame: FrameData, image: FrameData | None = None, start_ns: int | None = None
    ) -> tuple[TargetReport, ...]:
        """Take the next frame. A stamp below the last one starts the stream again: targets whose start stamp is
        still to come then wait for it anew at their first box (they go on once time is where it was, as after a single
        message with a wrong stamp), all others go on from their last box, and those started by themselves are
        forgotten. What the starter starts on a frame is reported from the next one on.

        Args:
            stamp_ns: T_i, the end of the frame (ns).
            frame: uint8, shape (height, width, 2).
            image: intensity image at the same stamp, uint8, shape (height, width); None where there is none.
            start_ns: T_{i-1}, where the frame starts (ns), which is long after the last one's end where events were
                missing; by default where the last one ended, at most 0.1 s before.

        Returns:
            One report a target, in the order of their start.

        Raises:
            TrackingError: frame or image are of another shape or dtype than the sensor's, or the frame starts after its
                end.
        """
        if start_ns is not None and start_ns > stamp_ns:
            msg = f"the frame starts at {start_ns} ns, after its end at {stamp_ns} ns"
            raise TrackingError(msg)
        self._check_pixels("frame", frame, (self._height, self._width, 2))
        if image is not None:
            self._check_pixels("image", image, (self._height, self._width))
        if self._last_stamp_ns is not None and stamp_ns < self._last_stamp_ns:
            self._go_back(stamp_ns)
        self._bring_back(stamp_ns)
        self._last_stamp_ns = stamp_ns
        if self._contours is not None:
            self._surface.keeps_all = self._turns.are_many
            self._surface.take(stamp_ns, frame, start_ns)
        contours = [target for target in self._targets.values() if isinstance(target, ContourTarget)]
        if contours:
            self._take_rest(frame, contours)
        self._other_targets.take(stamp_ns, contours)
        self._turns.share_among(sum(target.state is not TargetState.IDLE for target in contours))
        reports = self._reports(stamp_ns, frame, image)
        if len(contours) > 1:
            self._drawn_along.take(stamp_ns, contours)
        if self._starter is not None:
            self._change(self._starter.take(stamp_ns, frame, reports, self._room()))
        return reports

    def _take_rest(self, frame: FrameData, targets: Sequence[ContourTarget]) -> None:
        """See whether the camera moves, in which direction what it sees goes, or whether it has come to a halt."""
        surface = self._surface
        boxes = {target.name: target.last_box for target in targets if target.state is not TargetState.IDLE}
        self._camera_rest.take(surface.stamp_ns, frame, (surface.stamp_ns - surface.start_ns) * 1e-9, boxes)
        surface.has_just_halted = self._camera_rest.has_just_halted
        surface.sees_motion = self._camera_rest.sees_motion
        if surface.sees_motion:
            self._camera_slide.take(surface.stamp_ns, surface.start_ns, frame)
        else:
            self._camera_slide.forget()
        surface.slide = self._camera_slide.slide

    def _room(self) -> int | None:
        """How many more there may be; None where that has no limit."""
        if self.targets_max is None:
            return None
        return self.targets_max - len(self._targets) - len(self.waiting_clicks)

    def _go_back(self, stamp_ns: int) -> None:
        for name in self._starter.time_went_back() if self._starter is not None else ():
            self.stop(name)
        self._drawn_along.time_went_back(stamp_ns)
        self._camera_rest.forget()
        self._camera_slide.forget()
        for target in [*self._targets.values()]:
            if not starts_again(target.start_stamp_ns, stamp_ns):
                target.time_went_back(stamp_ns)
            elif target.state is not TargetState.IDLE:
                self._targets[target.name] = target.waiting()
                self._set_aside[target.name] = _SetAside(target, self._targets[target.name], self._last_stamp_ns or 0)

    def _bring_back(self, stamp_ns: int) -> None:
        """Have the targets that wait for their start again go on where time comes back to what it was: it did not go
        back then, but a message had a wrong stamp."""
        for name, aside in [*self._set_aside.items()]:
            still_waits = self._targets.get(name) is aside.waiting and aside.waiting.state is TargetState.IDLE
            if still_waits and stamp_ns < aside.stamp_ns:
                continue
            if still_waits:
                self._targets[name] = aside.target
            del self._set_aside[name]

    def _change(self, changes: Changes) -> None:
        """Stop and start what the starter says, from the next frame on."""
        for name in changes.stops:
            self.stop(name)
        stamp_ns = self._last_stamp_ns or 0
        for name, box in changes.again:
            # Not `start_again`: the starter goes on with it.
            self._targets[name] = self._made(name, self._checked(name, box.at_least(SIDE_MIN_PX), stamp_ns), stamp_ns)
            self._drawn_along.forget(name)
        for name, box in changes.starts:
            self.start(name, box.at_least(SIDE_MIN_PX), stamp_ns)
        self._notices += changes.notices

    def _reports(self, stamp_ns: int, frame: FrameData, image: FrameData | None) -> tuple[TargetReport, ...]:
        targets = self._targets.values()
        # Contours take less time than handing them to a thread would; they share the surface, too.
        if len(targets) < 2 or self._contours is not None:
            return tuple(self._updated(target, stamp_ns, frame, image) for target in targets)
        # These targets share nothing that changes, and nearly all of their time goes by in OpenCV without the GIL.
        return tuple(_THREADS.map(lambda target: self._updated(target, stamp_ns, frame, image), targets))

    def _updated(
        self, target: Target | ContourTarget, stamp_ns: int, frame: FrameData, image: FrameData | None
    ) -> TargetReport:
        if not self._searches:
            return target.update(stamp_ns, frame, image)
        region = target.search_region
        report = target.update(stamp_ns, frame, image)
        if report.state is TargetState.IDLE:
            return report
        candidates = target.candidates if isinstance(target, Target) else Proposals.none()
        return dataclasses.replace(report, search=Search(region, candidates))

    def _check_pixels(self, what: str, pixels: FrameData, shape: tuple[int, ...]) -> None:
        if pixels.shape != shape or pixels.dtype != np.uint8:
            msg = (
                f"{what} is {pixels.dtype} {pixels.shape}, the {self._width}x{self._height} sensor's are uint8 {shape}"
            )
            raise TrackingError(msg)


def check_target(name: str, box: Box, stamp_ns: int) -> None:
    """Refuse a target that cannot start on any sensor.

    Raises:
        TrackingError: the name is unusable, or the stamp is negative.
        BoxError: the box is not finite, or has a side below SIDE_MIN_PX.
    """
    _check_name(name)
    if stamp_ns < 0:
        msg = f"target {name!r} starts at {stamp_ns} ns: a stamp is 0 (the next frame) or above"
        raise TrackingError(msg)
    box.check_start(f"box of target {name!r}")


def _check_name(name: str) -> None:
    if not is_name(name):
        msg = f"target name {name[:80]!r} is unusable: give {NAME_RULE}"
        raise TrackingError(msg)
