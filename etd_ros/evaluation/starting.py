"""How well targets start without a box, by themselves and at clicks, on simulated sequences, whose truth is exact.

Not re-exported by `etd_ros.evaluation`: the engine, which this runs, reads truth files from there.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box, iou
from etd_ros.engine import track
from etd_ros.evaluation.scoring import SUCCESS_IOU
from etd_ros.evaluation.suite import NS_PER_S, START_NS, of_each
from etd_ros.events import concatenate
from etd_ros.settings import Settings
from etd_ros.simulation import Recipe, Scene, visible_shares
from etd_ros.simulation import Sequence as Simulated
from etd_ros.simulation.scene import box_of
from etd_ros.stream import StreamGuard
from etd_ros.tracking import DEFAULT_METHOD, Click, DiscoveryConfig, Starter, TargetReport
from etd_ros.tracking.discovery import shared
from etd_ros.warm_up import warm_up

STILL, MOVING, AT_REST = "still camera", "moving camera, moving things", "moving camera, things at rest"
KINDS = (STILL, MOVING, AT_REST)
"""What scenes are told apart by: things at rest before a moving camera move with the picture."""
SAMPLE_S = 0.01
HALF_SEEN, HARDLY_SEEN, WELL_SEEN = 0.5, 0.02, 0.7
MOVED_MIN_PX = 2.0
"""What never moves by this on the sensor is background."""
PART_SHARED = 0.6
"""A start of which more lies in a thing's box is on a part of that thing."""
CLICK_TIMES_S = (0.4, 0.8)
CLICK_PLACES = ((0.0, 0.0), (0.25, 0.25), (-0.3, 0.2))
"""Where targets are clicked: shares of width and height from the box's middle."""
CLICK_WAIT_S = 0.4
"""A click that is answered later is not answered."""
CLICK_MEMORY_S = 0.25
"""What clicks are answered from has seen the frames of this time before the click."""


@dataclass(frozen=True, slots=True)
class ClickAnswer:
    """What a click brought.

    Attributes:
        is_middle: whether the middle of the target was clicked.
        iou: of the box that was started with the truth at that time; None where there was none within 0.4 s.
    """

    is_middle: bool
    iou: float | None


@dataclass(frozen=True, slots=True)
class StartResult:
    """What started in one sequence.

    Attributes:
        sequence: its name.
        kind: one of KINDS.
        duration_s: how long it lasts.
        delays_s: for each target that can be half seen at some time: how long after that a target started by itself
            on it, with an IoU of at least 0.5; None where none ever did.
        parts: starts on parts of things that move (panels that come in, halves of what is hidden).
        false_starts: starts on nothing that moves.
        twice_share: share of the frames on which two targets were on one thing (IoU of at least 0.5 each).
        clicks: at 0.4 and 0.8 s, at three places of each target of which 70 % can be seen, each place on its own.
        frame_ms: processor time that looking for targets takes, a frame (ms).
    """

    sequence: str
    kind: str
    duration_s: float
    delays_s: tuple[float | None, ...]
    parts: int
    false_starts: int
    twice_share: float
    clicks: tuple[ClickAnswer, ...]
    frame_ms: float = field(compare=False)


def evaluate_starts(
    sequences: Iterable[Simulated], *, method: str = DEFAULT_METHOD, settings: Settings | None = None, jobs: int = 1
) -> Iterator[StartResult]:
    """The starts in each sequence, in order, as they come.

    Args:
        sequences: what to simulate.
        method: one of METHODS, on whose frames is looked, and which tracks what has started by itself.
        settings: of all stages.
        jobs: processes at work at once.
    """
    return of_each(partial(starts_in, method=method, settings=settings), sequences, jobs)


def starts_in(sequence: Simulated, *, method: str = DEFAULT_METHOD, settings: Settings | None = None) -> StartResult:
    """The starts in one sequence."""
    settings = settings or Settings()
    scene = sequence.scene()
    things = Things(scene)
    starts, cost = AutoStarts(things), _Cost(scene, settings.discovery)
    trials = [
        ClickTrial(things, time_s, place, settings.discovery)
        for time_s in CLICK_TIMES_S
        if round((time_s + CLICK_WAIT_S - scene.duration_s) * NS_PER_S) <= 0
        for place in CLICK_PLACES
    ]
    events = concatenate(list(sequence.events(scene, start_ns=START_NS)))
    for step in track(StreamGuard().feed(events), [], auto=True, method=method, settings=settings, threads=False):
        stamp_ns, frame = step.frame.stamp_ns, step.frame.data
        starts.take(stamp_ns, step.reports)
        cost.take(stamp_ns, frame, step.reports)
        for trial in trials:
            trial.take(stamp_ns, frame)
    return StartResult(
        sequence=sequence.name,
        kind=kind_of(sequence.recipe),
        duration_s=scene.duration_s,
        delays_s=starts.delays_s(),
        parts=starts.parts,
        false_starts=starts.false_starts,
        twice_share=starts.twice_share,
        clicks=tuple(answer for trial in trials for answer in trial.answers()),
        frame_ms=cost.frame_ms,
    )


def kind_of(recipe: Recipe) -> str:
    """Which of KINDS a recipe's scenes are."""
    if recipe.camera == "still":
        return STILL
    return AT_REST if recipe.motion == "rest" else MOVING


class Things:
    """The sprites of a scene that move on the sensor, targets or not.

    Args:
        scene: where they are.

    Attributes:
        scene: the same.
        first_ns: when half of each target can be seen first (ns), by name; without those that never can.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        times_s = np.arange(0.0, scene.duration_s, SAMPLE_S)
        placements = scene.placements(times_s)
        self._indices: dict[str, int] = {}
        self._visible: dict[str, npt.NDArray[np.float64]] = {}
        self.first_ns: dict[str, int] = {}
        for index, sprite in enumerate(scene.sprites):
            boxes = np.array([box_of(sprite, placement) for placement in placements[:, 1 + index]])
            if np.ptp(boxes, axis=0).max() < MOVED_MIN_PX:
                continue
            visible = visible_shares(scene, sprite.name, times_s).visible
            self._indices[sprite.name], self._visible[sprite.name] = index, visible
            if sprite.is_target and (visible >= HALF_SEEN).any():
                self.first_ns[sprite.name] = START_NS + round(
                    int(np.argmax(visible >= HALF_SEEN)) * SAMPLE_S * NS_PER_S
                )

    def boxes(self, stamp_ns: int, visible_min: float = HALF_SEEN) -> dict[str, Box]:
        """The boxes (pixels), as far as they lie on the sensor, of the things of which so much can be seen."""
        time_s = (stamp_ns - START_NS) / NS_PER_S
        placements = self.scene.placements([time_s])[0]
        sample = round(time_s / SAMPLE_S)
        return {
            name: on_sensor(box_of(self.scene.sprites[index], placements[1 + index]), self.scene)
            for name, index in self._indices.items()
            if self._visible[name][min(sample, len(self._visible[name]) - 1)] >= visible_min
        }


class AutoStarts:
    """Judges the targets that start by themselves.

    Args:
        things: where the truth is.

    Attributes:
        parts: starts on parts of things.
        false_starts: starts on nothing.
    """

    def __init__(self, things: Things) -> None:
        self._things = things
        self._known: set[str] = set()
        self._found_ns: dict[str, int] = {}
        self._frames = self._frames_with_twins = 0
        self.parts = self.false_starts = 0

    def take(self, stamp_ns: int, reports: Iterable[TargetReport]) -> None:
        """Take what a frame (its end, ns) brought the targets; the first box of each is what it started on."""
        boxes = {report.name: on_sensor(report.box, self._things.scene) for report in reports if report.box is not None}
        self._frames += 1
        if not boxes:
            return
        truth = self._things.boxes(stamp_ns)
        found = np.array(list(boxes.values()), np.float64)
        self._frames_with_twins += any((iou(found, box) >= SUCCESS_IOU).sum() > 1 for box in truth.values())
        for name in boxes.keys() - self._known:
            self._known.add(name)
            self._judge(stamp_ns, boxes[name], truth)

    def _judge(self, stamp_ns: int, box: Box, truth: dict[str, Box]) -> None:
        overlaps = {name: box.iou(other) for name, other in truth.items()}
        best = max(overlaps, key=overlaps.__getitem__, default=None)
        if best is not None and overlaps[best] >= SUCCESS_IOU:
            self._found_ns.setdefault(best, stamp_ns)
        elif any(shared(box, other) > PART_SHARED for other in self._things.boxes(stamp_ns, HARDLY_SEEN).values()):
            self.parts += 1
        else:
            self.false_starts += 1

    def delays_s(self) -> tuple[float | None, ...]:
        """For each target how long it took until it was found, None where it was not, in the order of the scene."""
        return tuple(
            (self._found_ns[name] - first_ns) / NS_PER_S if name in self._found_ns else None
            for name, first_ns in self._things.first_ns.items()
        )

    @property
    def twice_share(self) -> float:
        """Share of the frames on which two targets were on one thing."""
        return self._frames_with_twins / max(1, self._frames)


class ClickTrial:
    """A click on each target that can be well seen at one time, all at the same place of their boxes.

    Nothing is tracked meanwhile: what is judged is the box that a click starts a target with.

    Args:
        things: where the truth is.
        time_s: when is clicked (s since the start of the scene).
        place: where, in shares of width and height from the box's middle.
        config: parameters of discovery.
    """

    def __init__(self, things: Things, time_s: float, place: tuple[float, float], config: DiscoveryConfig) -> None:
        self._things, self._place = things, place
        self._stamp_ns = START_NS + round(time_s * NS_PER_S)
        scene = things.scene
        self._starter = Starter(scene.width, scene.height, config, auto=False)
        boxes = things.boxes(self._stamp_ns, WELL_SEEN)
        self._ious: dict[str, float | None] = {name: None for name in boxes if name in things.first_ns}
        for name in self._ious:
            x, y = boxes[name].center
            x = min(max(x + place[0] * boxes[name].w, 0.0), scene.width - 1.0)
            y = min(max(y + place[1] * boxes[name].h, 0.0), scene.height - 1.0)
            self._starter.click(Click(name, x, y, self._stamp_ns))

    def take(self, stamp_ns: int, frame: npt.NDArray[np.uint8]) -> None:
        """Take a frame: its end (ns) and its levels, uint8, shape (height, width, 2)."""
        since_s = (stamp_ns - self._stamp_ns) / NS_PER_S
        if not -CLICK_MEMORY_S <= since_s <= CLICK_WAIT_S or not self._starter.waiting_clicks:
            return
        for name, box in self._starter.take(stamp_ns, frame, ()).starts:
            truth = self._things.boxes(stamp_ns, HARDLY_SEEN)
            self._ious[name] = on_sensor(box, self._things.scene).iou(truth[name]) if name in truth else 0.0

    def answers(self) -> list[ClickAnswer]:
        """What each click brought, in the order of the scene."""
        return [ClickAnswer(self._place == (0.0, 0.0), value) for value in self._ious.values()]


class _Cost:
    """Times a starter that sees what the tracker's own sees."""

    def __init__(self, scene: Scene, config: DiscoveryConfig) -> None:
        # The first use of a kernel loads it, which is no cost of a frame.
        warm_up(["discovery"])
        self._starter = Starter(scene.width, scene.height, config, auto=True)
        self._times_s: list[float] = []

    def take(self, stamp_ns: int, frame: npt.NDArray[np.uint8], reports: tuple[TargetReport, ...]) -> None:
        start_s = time.process_time()
        self._starter.take(stamp_ns, frame, reports)
        self._times_s.append(time.process_time() - start_s)

    @property
    def frame_ms(self) -> float:
        """Mean processor time of a frame (ms)."""
        return 1e3 * float(np.mean(self._times_s or [0.0]))


def on_sensor(box: Box, scene: Scene) -> Box:
    """The part of a box (pixels) that lies on the scene's sensor, of hardly any area where there is none."""
    left, top = max(box.x, 0.0), max(box.y, 0.0)
    right, bottom = min(box.x + box.w, float(scene.width)), min(box.y + box.h, float(scene.height))
    return Box(left, top, max(1e-3, right - left), max(1e-3, bottom - top))
