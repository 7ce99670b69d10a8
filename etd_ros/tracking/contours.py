"""The moving contours of one target: a model of where its events are and which polarity motion gives them, which is
fitted to the newest events and learns slowly."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from etd_ros.boxes import Box
from etd_ros.tracking.body import Body
from etd_ros.tracking.box_view_kernels import draw_model
from etd_ros.tracking.contour_config import ContourConfig
from etd_ros.tracking.contour_drawing import normalise, splat
from etd_ros.tracking.contour_kernels import ANGLE, SCALE, Float32Array, Float64Array, arm_cells, score_at, search
from etd_ros.tracking.growth import GrowthByFlow
from etd_ros.tracking.look import Look
from etd_ros.tracking.look_pace import LookPace
from etd_ros.tracking.memories import Memories, Remembered, known_along
from etd_ros.tracking.misfits import Misfits, Sight
from etd_ros.tracking.model_box import Pose
from etd_ros.tracking.outline import beyond_box
from etd_ros.tracking.own_events import OwnEvents
from etd_ros.tracking.slid_past import SHARE, SlidPast
from etd_ros.tracking.surface import TimeSurface
from etd_ros.tracking.turning import BeginningTurn, TurningByFlow
from etd_ros.tracking.turning_trial import TurningTrial

CELLS_MAX = 48
"""Cells along a target's longer side at most: more detail costs time and finds nothing more."""
MARGIN = 1.2
"""Width and height of the model in those of the box."""
BORDER_CELLS = 2
KEPT_MARGIN_PX = 10.0
"""How far round the model the surface is kept up to date, for the looks to come."""
SPAN_MIN_S = 0.002
OUTLINE_GAIN, OUTLINE_TRUST_MIN = 0.3, 0.5
"""How much of what lies beyond a fast target's box is taken into it by a look, if that is trusted by so much."""
BIAS_PX = 400.0
"""The direction so far counts like this much motion when the polarity of a place is predicted: a look's own way there
hardly does, or a place farther along the upright edges of somebody who walks would predict what makes it better."""
NEW_RATE = 0.05
"""How fast the model learns what a new direction of motion shows."""
STRIDING_MIN = 1.5
"""What is at least so many times as high as wide may be somebody who walks: a stride is no turning."""
MOTION_MIN = 0.15
SPEED_MIN_PX_S = 5.0
"""Slower motion has no direction that can be told from noise."""


@dataclass(frozen=True, slots=True)
class Impression:
    """What a target looked like at some time: memories, the last direction of its motion, and how it was turned
    (rad)."""

    remembered: Remembered
    direction: Float64Array
    angle_rad: float


class Contours:
    """A target's model, and the body that it is fitted to.

    Attributes:
        body: where the target is, how it moves, and its box.
        least_speed_px_s: looks take the events of no more time than if the target were so fast (pixels/s).
        is_changing: whether looks are compared with what the target looked like lately as well, not only with what it
            usually looks like. That follows a change, and drifts.
        own: which events looks, and what they teach, take.
        slid_past: whether it stands still in what a camera slides past.
    """

    def __init__(self, box: Box, stamp_ns: int, config: ContourConfig) -> None:
        self.config = config
        self.body = Body(box, stamp_ns)
        self._growth_by_flow = GrowthByFlow()
        self._turning_by_flow: TurningByFlow | None = None
        self._trial: TurningTrial | None = None
        self._beginning = BeginningTurn()
        self._may_stride = box.h > STRIDING_MIN * box.w
        self.cell_px = max(1.0, max(box.w, box.h) / CELLS_MAX)
        columns, rows = (math.ceil(side * MARGIN / self.cell_px) + BORDER_CELLS for side in (box.w, box.h))
        width, height = box.w / self.cell_px, box.h / self.cell_px
        self._memories = Memories(rows, columns, width, height)
        self.least_speed_px_s = 0.0
        self.is_changing = False
        self.drawn = np.zeros((2, rows, columns), np.float32)
        self.room = np.zeros_like(self.drawn)
        self.direction = self._kept_direction = np.zeros(4)
        self._arm_cells = arm_cells(rows, columns)
        self._misfits = Misfits(self._memories.weight, self._arm_cells, self.cell_px, config.ridge_weight)
        self._looks = 0
        self._pace = LookPace(config.window_px, config.window_max_s)
        self._kept_ns: int | None = None
        self._patience = 1.0
        self.slid_past = SlidPast()
        self.own = OwnEvents((box.w, box.h), self.cell_px, MARGIN, KEPT_MARGIN_PX)

    def anew(self, box: Box, stamp_ns: int) -> Contours:
        """Contours of the same target in a box (pixels) at a time (ns), of which nothing is known yet."""
        contours = Contours(box, stamp_ns, self.config)
        contours.own.others = self.own.others
        return contours

    @property
    def sweep_px_s(self) -> float:
        """How fast its edges usually pass over pixels (pixels/s): by its motion, of what is known to grow by that as
        well, and of what turned from its start on by that."""
        body = self.body
        growing_per_s = body.growing.per_s if self._growth_by_flow.is_known else 0.0
        turning_rad_s = body.turning.per_s if self._turning_by_flow is not None else 0.0
        if growing_per_s == turning_rad_s == 0:
            return body.speed_px_s
        return math.hypot(body.speed_px_s, turning_rad_s * self._arm_px, growing_per_s * self._arm_px)

    @property
    def _arm_px(self) -> float:
        """How far from the middle turning moves the model as much as moving does, usually (pixels)."""
        return self._arm_cells * self.cell_px * self.body.pose[SCALE]

    @property
    def known(self) -> float:
        """How much of what this direction of motion shows has been seen, 0 to 1: edges along it make no events."""
        x, y, turning, growing = self.direction.tolist()
        return self._memories.known_along(*self._turned(x, y)) + turning**2 + growing**2

    def known_along(self, direction: tuple[float, float]) -> float:
        """The same for a target that moves in a direction (x, y of any length) and neither turns nor grows."""
        length = math.hypot(*direction)
        if length == 0:
            return self.known
        return self._memories.known_along(*self._turned(direction[0] / length, direction[1] / length))

    def known_as(self, impression: Impression) -> float:
        """How much of what this motion along shows had been seen when it looked like that."""
        right, down = self.body.velocity
        length = max(math.hypot(right, down), 1e-9)
        return known_along(impression.remembered.seen, *self._turned(right / length, down / length))

    @property
    def _maps(self) -> Float32Array:
        cells = self._memories.cells
        return cells.both if self.is_changing else cells.trusted

    @property
    def _norms(self) -> Float64Array:
        cells = self._memories.cells
        return cells.both_norms if self.is_changing else cells.trusted_norms

    def keep(self, surface: TimeSurface) -> int:
        """Keep the surface up to date round the target; how many pixels have fired there since the frame before, or
        since this was asked last if the surface keeps all."""
        body = self.body
        window = surface.window(body.box_at(*body.predicted(surface.stamp_ns), MARGIN), KEPT_MARGIN_PX)
        kept_ns, self._kept_ns = self._kept_ns, surface.stamp_ns
        if surface.keeps_all and kept_ns is not None and kept_ns < surface.start_ns:
            new = surface.count(window, (surface.stamp_ns - kept_ns) * 1e-9)
        else:
            new = surface.keep(window)
        self._pace.wait_with(new)
        return new

    def next_look_ns(self, patience: float) -> int:
        """Before this time (ns) no look is due after a sure one, however many events come; `patience` as for
        `is_due`."""
        earliest_s = self._pace.earliest_s(self.sweep_px_s, self.body.sizes_per_s, patience)
        return self.body.stamp_ns + int(earliest_s * 1e9)

    def is_due(self, stamp_ns: int, *, is_sure: bool, patience: float = 1.0) -> bool:
        """Whether it is time for a look, by whether the last ones were sure; events count for the next from then on;
        `patience` as for `LookPace.is_due`, and what looks teach asks the flow of edges as seldom."""
        body, self._patience = self.body, patience
        return self._pace.is_due(
            body.since_s(stamp_ns), self.sweep_px_s, body.sizes_per_s, is_sure=is_sure, patience=patience
        )

    def take_turning_of_flow(self, surface: TimeSurface) -> None:
        """Believe how fast a target that began to turn does so by the flow of its edges. Looks cannot tell when it
        turns back: all of its polarities change."""
        if self._turning_by_flow is None:
            return
        body = self.body
        x, y = body.predicted(surface.stamp_ns)
        correction = self._turning_by_flow.correction(
            surface, body.box_at(x, y), (x, y), self.sweep_px_s, body.turning.per_s
        )
        if correction != 0:
            body.turning.per_s += (1 - self.covered) * correction
            self._note_direction()

    def look(self, surface: TimeSurface, *, any_motion: bool = False) -> Look:
        """Fit the model to the newest events round the predicted place.

        Args:
            surface: the events.
            any_motion: the target may have turned or sped up: polarities count for the direction that fits them best,
                and places twice as far away are looked at.
        """
        radius_px = self.config.search_radius * (2 if any_motion else 1)
        self.own.see_backdrop(surface, self.body, self._span_s(surface.stamp_ns))
        x, y = self.body.predicted(surface.stamp_ns)
        return self.look_at(surface, x, y, radius_px, any_motion=any_motion, own_alone=True)

    def look_at(
        self,
        surface: TimeSurface,
        x: float,
        y: float,
        radius_px: float,
        any_motion: bool = True,
        *,
        own_alone: bool = False,
        impression: Impression | None = None,
    ) -> Look:
        """Fit the model to the newest events round a place (pixels).

        Args:
            surface: the events.
            x: the column in the middle (pixels).
            y: the row in the middle (pixels).
            radius_px: how far from it (pixels).
            any_motion: as for `look`.
            own_alone: leave out the events of other targets, and of what moves otherwise round it.
            impression: fit what the target looked like then, not what it looks like now.
        """
        config, body = self.config, self.body
        box = body.box_at(x, y, MARGIN)
        margin = radius_px + BORDER_CELLS
        span_s = self._span_s(surface.stamp_ns)
        points, count = surface.points(surface.window(box, margin), span_s)
        pose = np.array([x, y, *body.changed(surface.stamp_ns)])
        if own_alone:
            count = self.own.keep(points, count, pose, body.velocity, span_s, surface.stamp_ns)
        maps, norms = self._maps, self._norms
        if impression is not None:
            cells = self._memories.cells_of(impression.remembered)
            maps, norms = cells.trusted, cells.trusted_norms
        velocity, motion = body.motion, BIAS_PX * self.direction
        pose[0], pose[1] = x, y = search(
            points, count, maps, norms, pose, self.cell_px, velocity, motion, np.array(body.pose), config.ridge_weight,
            any_motion, float(radius_px),
        )  # fmt: skip
        motion[0] += x - body.pose[0]
        motion[1] += y - body.pose[1]
        score, events, *direction = score_at(
            points, count, maps, norms, pose, self.cell_px, velocity, motion, config.ridge_weight, any_motion
        )
        moved = min(max(self.sweep_px_s * span_s / config.window_px, MOTION_MIN), 1.0)
        return Look(x, y, score, events, moved, (direction[0], direction[1]), float(pose[SCALE]))

    def sees_noise(self, surface: TimeSurface) -> bool:
        """Whether what a look has where the target should be is noise, so that it makes no events itself."""
        box = self.body.box_at(*self.body.predicted(surface.stamp_ns))
        return surface.shows_noise(surface.window(box, 0.0), self._span_s(surface.stamp_ns))

    def look_longer(self, events: float, stamp_ns: int) -> bool:
        """A look at a time (ns) had so few events: have the next one take those of more motion; whether it does."""
        span_s = self._span_s(stamp_ns)
        self._pace.want_more(events, self.sweep_px_s * span_s)
        return self._span_s(stamp_ns) > span_s

    def turn(self, direction: tuple[float, float]) -> None:
        """The target moves in this direction now (x, y of any length)."""
        length = math.hypot(*direction)
        if length > 0:
            self.direction = np.array([*direction, 0.0, 0.0]) / length

    def adapt(self, surface: TimeSurface, elapsed_s: float, trust: float, *, sees_covers: bool) -> None:
        """Take into the box what lies beyond that of a fast target, unless its size is kept; fit scale and angle to the
        newest events, and learn from them by their trust (0 to 1); cells that show what covers the target count less
        from now on, if `sees_covers`."""
        if self.config.scale_gain > 0 and self.body.is_fast and trust > OUTLINE_TRUST_MIN:
            self._take_in_outline(surface)
        box = self.body.box.scaled(MARGIN)
        span_s = max(self._motion_s(), elapsed_s, SPAN_MIN_S)
        self._take_growth_of_flow(surface)
        points, count = surface.points(surface.window(box, BORDER_CELLS), span_s)
        pose = np.array(self.body.pose)
        count = self.own.keep(points, count, pose, self.body.velocity, span_s, surface.stamp_ns)
        self._fit_scale_and_angle(surface, self._sight(points, count), elapsed_s)
        self._note_direction()
        self._looks += 1
        sight = self._sight(points, count)
        inside = splat(points, count, sight.pose, self.cell_px, sight.velocity, self.drawn)
        self._pace.count(inside, self.sweep_px_s * span_s)
        rate = trust * max(self.config.learning_rate, 1 / self._looks, NEW_RATE * (1 - self.known))
        normalise(self.drawn, self.room, self._memories.weight, 1.0)
        direction = self._direction_by_the_cell()
        self._misfits.learn_preferences(sight, self.drawn, direction)
        self._learn(direction, rate, trust, sees_covers=sees_covers)

    def stop(self) -> None:
        """Take the target to be at rest."""
        self.body.stop()
        self._growth_by_flow = GrowthByFlow()
        self._turning_by_flow = self._trial = None

    def change_since(self, pose: Pose, growing_per_s: float, turning_rad_s: float, time_s: float) -> None:
        """The target has changed as for `Body.change_since`, by the flow of its edges."""
        self._turning_by_flow = TurningByFlow() if turning_rad_s != 0 else None
        self._growth_by_flow = GrowthByFlow(grows=growing_per_s != 0, is_new=True)
        self.body.change_since(pose, growing_per_s, turning_rad_s, time_s)

    def begin(self, direction: Float64Array, looks: float, looks_known: int) -> None:
        """Make the model what is drawn in `drawn`, the sum of so many looks; the direction is that of the motion, of
        length 1, as `direction` has it."""
        self.direction = direction
        normalise(self.drawn, self.room, self._memories.weight, looks)
        self._learn(self._direction_by_the_cell(), 1.0, 1.0, sees_covers=False)
        self._looks = looks_known

    def keep_memories(self) -> None:
        """Keep what the target looks like now, as it is seen surely."""
        self._memories.keep()
        self._kept_direction = self.direction

    def restore_memories(self) -> None:
        """Go back to what was kept last: what was learnt since may be of what covered the target."""
        self._memories.restore()
        self.direction = self._kept_direction

    def impression(self) -> Impression:
        """What the target looks like now."""
        return Impression(self._memories.remembered(), self.direction, self.body.pose[ANGLE])

    def recall(self, impression: Impression) -> None:
        """Look as the target once did."""
        self._memories.recall(impression.remembered)
        self.direction = impression.direction
        self.uncover()
        self.keep_memories()

    def appear(self, impression: Impression, box: Box, stamp_ns: int) -> None:
        """Take the target to be at rest in a box (pixels) at a time (ns), and to look as it once did."""
        self.recall(impression)
        self.body.appear(box, impression.angle_rad, stamp_ns)
        self._pace.forget()
        self.stop()

    def uncover(self) -> None:
        """Trust all of the target again: where it is found, what covered it is elsewhere."""
        self._memories.uncover()

    @property
    def covered(self) -> float:
        """How surely something covers a part of it, 0 to 1."""
        return self._memories.cells.covered

    def correct(self, misfit: Float64Array) -> None:
        """Put the box on the model right: it is off by parts of its width and height along x and y, and the right one
        is so much wider and higher (logarithms), unless its size is kept."""
        box, (right, below, *larger) = self.body.box, misfit.tolist()
        wider, higher = larger if self.config.scale_gain > 0 else (0.0, 0.0)
        self.body.correct_box(right * box.w, below * box.h, wider, higher)

    def grow_on(self, growth: float) -> None:
        """The model is too small by so much (the logarithm of its scale), and grows faster than it is taken to, unless
        its size is kept."""
        if self.config.scale_gain > 0:
            self.body.grow_on(growth)

    def draw_usual(self, drawn: Float32Array, span: float) -> None:
        """Draw what the target usually looks like where it lies now, `span` times as wide and high as its box; shape
        (3, cells, cells), as `draw_model` has it."""
        box, pose = self.body.box, self.body.pose
        middle = box.center[0] - pose[0], box.center[1] - pose[1]
        draw_model(self._memories.usual, np.array(pose), self.cell_px, *middle, span * box.w, span * box.h, drawn)

    def draw_first(self, maps: Float32Array, drawn: Float32Array, span: float) -> None:
        """Draw what the target looked like at some time (its usual memory's maps of then) in its box as it was at the
        start, turned and grown as it is now."""
        width, height = self.body.size_at_first
        draw_model(maps, np.array(self.body.pose), self.cell_px, 0.0, 0.0, span * width, span * height, drawn)

    def usual_maps(self) -> Float32Array:
        """What the target usually looks like now: the memory's maps, which no look renews any more."""
        return np.array(self._memories.usual)

    def _learn(self, direction: Float64Array, rate: float, trust: float, *, sees_covers: bool) -> None:
        """Move the memories towards what is drawn and normalised, with a direction by the cell."""
        self._memories.learn(self.drawn, direction, rate, trust, sees_covers=sees_covers)
        x, y, *_ = direction.tolist()
        self._memories.see(x, y, rate * (1 - self.known))

    def _sight(self, points: Float32Array, count: int) -> Sight:
        return Sight(points, count, np.array(self.body.pose), self.body.motion, BIAS_PX * self.direction)

    def _fit_scale_and_angle(self, surface: TimeSurface, sight: Sight, elapsed_s: float) -> None:
        config = self.config
        if config.scale_gain == 0 and config.angle_gain == 0:
            return
        misfit = self._misfits.measure(sight, self._maps, self._norms)
        turned = misfit.angle
        if config.angle_gain > 0 and self.body.turning.per_s == 0:
            turned *= self._beginning.trust(surface, self.body, self.sweep_px_s, turned, self.known, self._patience)
        if config.scale_gain > 0:
            # A part of the target cannot tell whether it moves or grows.
            seen = 1 - self.covered
            too_small = seen * misfit.scale
            parts = seen * misfit.wider, seen * misfit.higher
            if self._keeps_its_size:
                self.body.growing.stop()
                too_small *= SHARE
            else:
                # Before a camera that stands nothing becomes wider or narrower by parallax.
                self.body.growing.learn(too_small, elapsed_s, parts, parts_agree=surface.sees_motion)
            self.body.grow(config.scale_gain * too_small)
        if config.angle_gain > 0:
            self._turn(sight, turned, elapsed_s)

    def _turn(self, sight: Sight, turned: float, elapsed_s: float) -> None:
        """Turn by what the angle is off by (rad), once the target is known to turn and until that proves wrong."""
        body = self.body
        begins = body.turning.per_s == 0
        if not body.turning.learn(turned, elapsed_s):
            return
        if begins and self._may_stride:
            self._trial = TurningTrial(self._maps, self._norms, body.pose[ANGLE], self._arm_cells)
        body.turn_to(body.pose[ANGLE] + self.config.angle_gain * turned)
        if self._trial is None:
            return
        turned_sight = replace(sight, pose=np.array(body.pose))
        if self._trial.fails(turned_sight, self.cell_px, self.config.ridge_weight, elapsed_s):
            body.turn_to(self._trial.angle_rad)
            body.turning.stop()

    def _take_in_outline(self, surface: TimeSurface) -> None:
        """Move and enlarge the box towards what lies beyond it and is of the target."""
        body = self.body
        box, span_s = body.box, max(self._motion_s(), SPAN_MIN_S)
        # What comes after the target was as far behind as that goes in the meantime: short frames have kept it there.
        window = surface.window(box.scaled(MARGIN), KEPT_MARGIN_PX + body.speed_px_s * span_s)
        points, count = surface.points(window, span_s)
        beyond = beyond_box(points, count, np.array(body.pose), np.array(body.velocity), box.w, box.h)
        growth = beyond.growth(box.w, box.h)
        if growth > 0:
            body.grow(OUTLINE_GAIN * growth)
            right, down = beyond.shift
            body.be_at(body.pose[0] + OUTLINE_GAIN * right, body.pose[1] + OUTLINE_GAIN * down)
            body.growing.doubt_if_below_0()

    @property
    def _keeps_its_size(self) -> bool:
        """Whether a camera slides past it, and it is not known to grow."""
        return self.slid_past.direction is not None and not self._growth_by_flow.is_known

    def _take_growth_of_flow(self, surface: TimeSurface) -> None:
        """Believe the flow of the target's edges about how fast it grows, unless its size is kept."""
        body = self.body
        if self.config.scale_gain > 0:
            body.growing.per_s += self._growth_by_flow.correction(
                surface, body.box, body.pose[:2], body.speed_px_s, body.growing.per_s, self.covered
            )

    def _note_direction(self) -> None:
        motion = self.body.motion * (1.0, 1.0, self._arm_px, self._arm_px)
        speed_px_s = math.hypot(*motion.tolist())
        if speed_px_s > SPEED_MIN_PX_S:
            self.direction = motion / speed_px_s

    def _direction_by_the_cell(self) -> Float64Array:
        """The direction of motion in the model's coordinates, as `learn` takes it."""
        x, y, turning, growing = self.direction.tolist()
        return np.array([*self._turned(x, y), turning / self._arm_cells, growing / self._arm_cells])

    def _turned(self, x: float, y: float) -> tuple[float, float]:
        """A direction in the model's coordinates."""
        cos, sin = math.cos(self.body.pose[ANGLE]), math.sin(self.body.pose[ANGLE])
        return cos * x + sin * y, cos * y - sin * x

    def _motion_s(self) -> float:
        """The time of a window's motion (s), at most `window_max_s`."""
        return self._pace.motion_s(max(self.sweep_px_s, self.least_speed_px_s), self.body.sizes_per_s)

    def _span_s(self, stamp_ns: int) -> float:
        return max(self._motion_s(), self.body.since_s(stamp_ns), SPAN_MIN_S)
