"""Follows one target by its moving contours: a model of where its events are and which polarity motion gives them is
fitted to the newest events, and learns slowly."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from etd_ros.boxes import Box
from etd_ros.tracking.box_view_kernels import draw_model
from etd_ros.tracking.contour_config import ContourConfig
from etd_ros.tracking.contour_drawing import normalise, splat
from etd_ros.tracking.contour_kernels import ANGLE, SCALE, Float32Array, Float64Array, arm_cells, score_at, search
from etd_ros.tracking.growth import GrowthByFlow
from etd_ros.tracking.look_pace import FAST_SIZES_PER_S, LookPace
from etd_ros.tracking.memories import Memories, Remembered
from etd_ros.tracking.misfits import Misfits, Sight
from etd_ros.tracking.model_box import ModelBox
from etd_ros.tracking.outline import beyond_box
from etd_ros.tracking.shape import reach_of
from etd_ros.tracking.steady_change import SteadyChange
from etd_ros.tracking.surface import TimeSurface
from etd_ros.tracking.turning import TurningByFlow
from etd_ros.tracking.turning_trial import TurningTrial

CELLS_MAX = 48
"""Cells along a target's longer side at most: more detail costs time and finds nothing more."""
MARGIN = 1.2
"""Width and height of the model in those of the box."""
BORDER_CELLS = 2
KEPT_MARGIN_PX = 10.0
"""How far round the model the surface is kept up to date, for the looks to come."""
TURN_GAIN, GROWTH_GAIN = 0.3, 0.25
"""How much of a misfit is a misfit of the rate."""
SCALE_LIMITS = (0.2, 5.0)
SPAN_MIN_S = 0.002
OUTLINE_GAIN, OUTLINE_TRUST_MIN = 0.3, 0.5
"""How much of what lies beyond a fast target's box is taken into it by a look, if that is trusted by so much."""
VELOCITY_PX = 2.0
VELOCITY_S = (0.004, 0.05)
"""The velocity is an average over so much motion, within these times."""
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


@dataclass(frozen=True, slots=True)
class Look:
    """What the events say about the target.

    Attributes:
        x, y: where it fits best (pixels).
        score: how well.
        events: how many are under the model.
        motion: how far the target moved while they came, in parts of `window_px`, 0.15 to 1.
        direction: x, y of the motion that fits the polarities best, of any length.
    """

    x: float
    y: float
    score: float
    events: float
    motion: float
    direction: tuple[float, float]


class Contours:
    """A target's model and pose.

    Attributes:
        pose: float64, x, y of the centre (pixels), scale, angle (rad).
        velocity: float64, x, y (pixels/s).
        stamp_ns: the time of the pose (ns).
        least_speed_px_s: looks take the events of no more time than if the target were so fast (pixels/s).
        is_changing: whether looks are compared with what the target looked like lately as well, not only with what it
            usually looks like. That follows a change, and drifts.
    """

    def __init__(self, box: Box, stamp_ns: int, config: ContourConfig) -> None:
        self.config = config
        self.pose = np.array([*box.center, 1.0, 0.0])
        self.velocity = np.zeros(2)
        self._turning = SteadyChange(TURN_GAIN)
        self._growing = SteadyChange(GROWTH_GAIN)
        self._growth_by_flow: GrowthByFlow | None = None
        self._turning_by_flow: TurningByFlow | None = None
        self._trial: TurningTrial | None = None
        self._may_stride = box.h > STRIDING_MIN * box.w
        self.stamp_ns = stamp_ns
        self.cell_px = max(1.0, max(box.w, box.h) / CELLS_MAX)
        self._model_box = ModelBox(box.w, box.h)
        columns, rows = (math.ceil(side * MARGIN / self.cell_px) + BORDER_CELLS for side in self.size_px)
        width, height = (side / self.cell_px for side in self.size_px)
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

    def box_at(self, x: float, y: float) -> Box:
        """The target's box if its centre is there (pixels)."""
        return self._model_box.at(x, y, self.pose)

    @property
    def size_px(self) -> tuple[float, float]:
        """Width and height of the box at scale 1."""
        return self._model_box.size_px

    @property
    def box(self) -> Box:
        """The target's box (pixels)."""
        x, y, _, _ = self.pose.tolist()
        return self.box_at(x, y)

    @property
    def speed_px_s(self) -> float:
        """How fast the target moves (pixels/s)."""
        return math.hypot(*self.velocity.tolist())

    @property
    def sweep_px_s(self) -> float:
        """How fast its edges usually pass over pixels, by its motion and, of what turned from its start on, by that as
        well (pixels/s)."""
        if self._turning_by_flow is None:
            return self.speed_px_s
        arm_px = self._arm_cells * self.cell_px * self.pose[SCALE]
        return math.hypot(self.speed_px_s, self._turning.per_s * arm_px)

    @property
    def sizes_per_s(self) -> float:
        """How fast the target moves in widths and in heights of its box, together (1/s): what a box that stays behind
        loses of its overlap."""
        (width, height), (right, down) = self._model_box.size(self.pose), self.velocity.tolist()
        return abs(right) / width + abs(down) / height

    @property
    def is_fast(self) -> bool:
        """Whether it moves so fast that it does not come to a halt at once."""
        return self.sizes_per_s > FAST_SIZES_PER_S

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

    @property
    def motion(self) -> Float64Array:
        """How the target moves, turns and grows: pixels/s, pixels/s, rad/s and 1/s."""
        return np.array([*self.velocity.tolist(), self._turning.per_s, self._growing.per_s])

    @property
    def _maps(self) -> Float32Array:
        cells = self._memories.cells
        return cells.both if self.is_changing else cells.trusted

    @property
    def _norms(self) -> Float64Array:
        cells = self._memories.cells
        return cells.both_norms if self.is_changing else cells.trusted_norms

    def predicted(self, stamp_ns: int) -> tuple[float, float]:
        """Where the centre is at a time, if the motion goes on."""
        (x, y, _, _), (right, down), since_s = self.pose.tolist(), self.velocity.tolist(), self._since_s(stamp_ns)
        return x + right * since_s, y + down * since_s

    def keep(self, surface: TimeSurface) -> int:
        """Keep the surface up to date round the target; how many pixels of the newest frame fired there."""
        box = self.box_at(*self.predicted(surface.stamp_ns)).scaled(MARGIN)
        new = surface.keep(surface.window(box, KEPT_MARGIN_PX))
        self._pace.wait_with(new)
        return new

    def is_due(self, stamp_ns: int) -> bool:
        """Whether it is time for a look; the events for the next one count from then on."""
        return self._pace.is_due(self._since_s(stamp_ns), self.sweep_px_s, self.sizes_per_s)

    def take_turning_of_flow(self, surface: TimeSurface) -> None:
        """Believe how fast a target that began to turn does so by the flow of its edges. Looks cannot tell when it
        turns back: all of its polarities change."""
        if self._turning_by_flow is None:
            return
        place = np.array(self.predicted(surface.stamp_ns))
        correction = self._turning_by_flow.correction(
            surface, self.box_at(*place.tolist()), place, self.sweep_px_s, self._turning.per_s
        )
        if correction != 0:
            self._turning.per_s += (1 - self.covered) * correction
            self._note_direction()

    def look(self, surface: TimeSurface, *, any_motion: bool = False) -> Look:
        """Fit the model to the newest events round the predicted place.

        Args:
            surface: the events.
            any_motion: the target may have turned or sped up: polarities count for the direction that fits them best,
                and places twice as far away are looked at.
        """
        radius_px = self.config.search_radius * (2 if any_motion else 1)
        return self.look_at(surface, *self.predicted(surface.stamp_ns), radius_px, any_motion=any_motion)

    def look_at(
        self,
        surface: TimeSurface,
        x: float,
        y: float,
        radius_px: float,
        any_motion: bool = True,
    ) -> Look:
        """Fit the model to the newest events round a place (pixels).

        Args:
            surface: the events.
            x: the column in the middle (pixels).
            y: the row in the middle (pixels).
            radius_px: how far from it (pixels).
            any_motion: as for `look`.
        """
        config = self.config
        box = self.box_at(x, y).scaled(MARGIN)
        margin = radius_px + BORDER_CELLS
        span_s = self._span_s(surface.stamp_ns)
        points, count = surface.points(surface.window(box, margin), span_s)
        pose = np.array([x, y, *self._changed(self._since_s(surface.stamp_ns))])
        maps, norms, velocity, motion = self._maps, self._norms, self.motion, BIAS_PX * self.direction
        pose[0], pose[1] = x, y = search(
            points, count, maps, norms, pose, self.cell_px, velocity, motion, self.pose, config.ridge_weight,
            any_motion, float(radius_px),
        )  # fmt: skip
        motion[:2] += pose[:2] - self.pose[:2]
        score, events, *direction = score_at(
            points, count, maps, norms, pose, self.cell_px, velocity, motion, config.ridge_weight, any_motion
        )
        moved = min(max(self.sweep_px_s * span_s / config.window_px, MOTION_MIN), 1.0)
        return Look(x, y, score, events, moved, (direction[0], direction[1]))

    def sees_noise(self, surface: TimeSurface) -> bool:
        """Whether what a look has where the target should be is noise, so that it makes no events itself."""
        box = self.box_at(*self.predicted(surface.stamp_ns))
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

    def follow(self, surface: TimeSurface, x: float, y: float, gain: float) -> None:
        """Go to a place (pixels) at the surface's time; the velocity follows by `gain`, 0 to 1."""
        self.velocity += gain * (self.velocity_to(x, y, surface.stamp_ns) - self.velocity)
        self.pose[2:] = self._changed(self._since_s(surface.stamp_ns))
        self.pose[:2] = x, y
        self.stamp_ns = surface.stamp_ns

    def velocity_to(self, x: float, y: float, stamp_ns: int) -> Float64Array:
        """The velocity, x and y (pixels/s), if the target goes to a place (pixels) by a time (ns): an average
        of that so far and of the way there."""
        elapsed_s = self._since_s(stamp_ns)
        if elapsed_s <= 0:
            return self.velocity.copy()
        shortest_s, longest_s = VELOCITY_S
        average_s = min(max(VELOCITY_PX / max(self.speed_px_s, 1e-3), shortest_s), longest_s)
        last = (np.array([x, y]) - self.pose[:2]) / elapsed_s
        return np.asarray(self.velocity + elapsed_s / (elapsed_s + average_s) * (last - self.velocity))

    def go_on_at(self, velocity: Float64Array, gain: float) -> None:
        """Take the target to move at a velocity (pixels/s), by `gain` from 0 to 1, and neither to turn nor to grow."""
        self.velocity += gain * (velocity - self.velocity)
        self._turning.stop()
        self._growing.stop()

    def adapt(self, surface: TimeSurface, elapsed_s: float, trust: float, *, sees_covers: bool) -> None:
        """Take into the box what lies beyond that of a fast target, unless its size is kept; fit scale and angle to the
        newest events, and learn from them by their trust (0 to 1); cells that show what covers the target count less
        from now on, if `sees_covers`."""
        if self.config.scale_gain > 0 and self.is_fast and trust > OUTLINE_TRUST_MIN:
            self._take_in_outline(surface)
        box = self.box.scaled(MARGIN)
        span_s = max(self._motion_s(), elapsed_s, SPAN_MIN_S)
        self._take_growth_of_flow(surface)
        points, count = surface.points(surface.window(box, BORDER_CELLS), span_s)
        self._fit_scale_and_angle(self._sight(points, count), elapsed_s)
        self._note_direction()
        self._looks += 1
        sight = self._sight(points, count)
        inside = splat(points, count, self.pose, self.cell_px, sight.velocity, self.drawn)
        self._pace.count(inside, self.sweep_px_s * span_s)
        rate = trust * max(self.config.learning_rate, 1 / self._looks, NEW_RATE * (1 - self.known))
        normalise(self.drawn, self.room, self._memories.weight, 1.0)
        direction = self._direction_by_the_cell()
        self._misfits.learn_preferences(sight, self.drawn, direction)
        self._learn(direction, rate, trust, sees_covers=sees_covers)

    def stop(self) -> None:
        """Take the target to be at rest."""
        self.velocity[:] = 0
        self._growth_by_flow = None
        self._turning_by_flow = self._trial = None
        self._turning.stop()
        self._growing.stop()

    def change_since(self, pose: Float64Array, growing_per_s: float, turning_rad_s: float, time_s: float) -> None:
        """The target has grown and turned at these rates (1/s, rad/s) for a time (s), from the scale and angle of a
        pose, by the flow of its edges."""
        self._turning_by_flow = TurningByFlow() if turning_rad_s != 0 else None
        self._turning.per_s = turning_rad_s
        self.pose[ANGLE] = pose[ANGLE] + turning_rad_s * time_s
        self._growth_by_flow = GrowthByFlow() if growing_per_s != 0 else None
        self._growing.per_s = growing_per_s
        self.pose[SCALE] = pose[SCALE]
        self._grow(growing_per_s * time_s)

    def begin(self, direction: Float64Array, looks: float, looks_known: int) -> None:
        """Make the model what is drawn in `drawn`, the sum of so many looks; the direction is that of the motion, of
        length 1, as `direction` has it."""
        self.direction = direction
        normalise(self.drawn, self.room, self._memories.weight, looks)
        self._learn(self._direction_by_the_cell(), 1.0, 1.0, sees_covers=False)
        self._looks = looks_known

    def take_shape(self, places: Float64Array) -> None:
        """Learn the target's shape from where its events are beside its middle (pixels at scale 1, shape (n, 2))."""
        self._model_box.take_shape(reach_of(places / np.divide(self.size_px, 2)))

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
        return Impression(self._memories.remembered(), self.direction, float(self.pose[ANGLE]))

    def recall(self, impression: Impression) -> None:
        """Look as the target once did."""
        self._memories.recall(impression.remembered)
        self.direction = impression.direction
        self.uncover()
        self.keep_memories()

    def appear(self, impression: Impression, box: Box, stamp_ns: int) -> None:
        """Take the target to be at rest in a box (pixels) at a time (ns), and to look as it once did."""
        self.recall(impression)
        self.pose[:] = *box.center, 1.0, impression.angle_rad
        self._model_box.reset()
        upright = self.box
        least, most = SCALE_LIMITS
        self.pose[SCALE] = min(max(math.sqrt(box.w * box.h / (upright.w * upright.h)), least), most)
        self._pace.forget()
        self.stamp_ns = stamp_ns
        self.stop()

    def uncover(self) -> None:
        """Trust all of the target again: where it is found, what covered it is elsewhere."""
        self._memories.uncover()

    @property
    def covered(self) -> float:
        """How surely something covers a part of it, 0 to 1."""
        return self._memories.cells.covered

    @property
    def growing_per_s(self) -> float:
        """How fast it grows (the logarithm of its scale, 1/s)."""
        return self._growing.per_s

    def correct(self, misfit: Float64Array) -> None:
        """Put the box on the model right: it is off by parts of its width and height along x and y, and the right one
        is so much wider and higher (logarithms), unless its size is kept."""
        box, (right, below, *larger) = self.box, misfit.tolist()
        wider, higher = larger if self.config.scale_gain > 0 else (0.0, 0.0)
        self._model_box.correct(right * box.w, below * box.h, wider, higher, self.pose)

    def draw_usual(self, drawn: Float32Array, span: float) -> None:
        """Draw what the target usually looks like where it lies now, `span` times as wide and high as its box; shape
        (3, cells, cells), as `draw_model` has it."""
        box, (x, y) = self.box, self.pose[:2].tolist()
        middle = box.center[0] - x, box.center[1] - y
        draw_model(self._memories.usual, self.pose, self.cell_px, *middle, span * box.w, span * box.h, drawn)

    def draw_first(self, maps: Float32Array, drawn: Float32Array, span: float) -> None:
        """Draw what the target looked like at some time (its usual memory's maps of then) in its box as it was at the
        start, turned and grown as it is now."""
        width, height = self._model_box.size_at_first(self.pose)
        draw_model(maps, self.pose, self.cell_px, 0.0, 0.0, span * width, span * height, drawn)

    def usual_maps(self) -> Float32Array:
        """What the target usually looks like now: the memory's maps, which no look renews any more."""
        return np.array(self._memories.usual)

    def _learn(self, direction: Float64Array, rate: float, trust: float, *, sees_covers: bool) -> None:
        """Move the memories towards what is drawn and normalised, with a direction by the cell."""
        self._memories.learn(self.drawn, direction, rate, trust, sees_covers=sees_covers)
        x, y, *_ = direction.tolist()
        self._memories.see(x, y, rate * (1 - self.known))

    def _sight(self, points: Float32Array, count: int) -> Sight:
        return Sight(points, count, self.pose, self.motion, BIAS_PX * self.direction)

    def _fit_scale_and_angle(self, sight: Sight, elapsed_s: float) -> None:
        config = self.config
        if config.scale_gain == 0 and config.angle_gain == 0:
            return
        too_small, turned = self._misfits.measure(sight, self._maps, self._norms)
        if config.scale_gain > 0:
            # A part of the target cannot tell whether it moves or grows.
            too_small *= 1 - self.covered
            self._growing.learn(too_small, elapsed_s)
            self._grow(config.scale_gain * too_small)
        if config.angle_gain > 0:
            self._turn(sight, turned, elapsed_s)

    def _turn(self, sight: Sight, turned: float, elapsed_s: float) -> None:
        """Turn by what the angle is off by (rad), once the target is known to turn and until that proves wrong."""
        begins = self._turning.per_s == 0
        if not self._turning.learn(turned, elapsed_s):
            return
        if begins and self._may_stride:
            self._trial = TurningTrial(self._maps, self._norms, float(self.pose[ANGLE]), self._arm_cells)
        self.pose[ANGLE] += self.config.angle_gain * turned
        if self._trial and self._trial.fails(sight, self.cell_px, self.config.ridge_weight, elapsed_s):
            self.pose[ANGLE] = self._trial.angle_rad
            self._turning.stop()

    def _grow(self, growth: float) -> None:
        """Change the scale's logarithm, within limits."""
        least, most = SCALE_LIMITS
        self.pose[SCALE] = min(max(self.pose[SCALE] * math.exp(growth), least), most)

    def _take_in_outline(self, surface: TimeSurface) -> None:
        """Move and enlarge the box towards what lies beyond it and is of the target."""
        box, span_s = self.box, max(self._motion_s(), SPAN_MIN_S)
        # What comes after the target was as far behind as that goes in the meantime: short frames have kept it there.
        window = surface.window(box.scaled(MARGIN), KEPT_MARGIN_PX + self.speed_px_s * span_s)
        points, count = surface.points(window, span_s)
        beyond = beyond_box(points, count, self.pose, self.velocity, box.w, box.h)
        growth = beyond.growth(box.w, box.h)
        if growth > 0:
            self._grow(OUTLINE_GAIN * growth)
            self.pose[:2] += np.multiply(OUTLINE_GAIN, beyond.shift)
            self._growing.doubt_if_below_0()

    def _take_growth_of_flow(self, surface: TimeSurface) -> None:
        """Believe how fast a target that began to grow does so by the flow of its edges. Of others, what passes before
        or behind them would be taken for it."""
        if self._growth_by_flow is not None:
            correction = self._growth_by_flow.correction(
                surface, self.box, self.pose[:2], self.speed_px_s, self._growing.per_s
            )
            # What something covers seems to shrink.
            self._growing.per_s += (1 - self.covered) * correction

    def _note_direction(self) -> None:
        arm_px = self._arm_cells * self.cell_px * self.pose[SCALE]
        motion = self.motion * (1.0, 1.0, arm_px, arm_px)
        speed_px_s = math.hypot(*motion.tolist())
        if speed_px_s > SPEED_MIN_PX_S:
            self.direction = motion / speed_px_s

    def _direction_by_the_cell(self) -> Float64Array:
        """The direction of motion in the model's coordinates, as `learn` takes it."""
        x, y, turning, growing = self.direction.tolist()
        return np.array([*self._turned(x, y), turning / self._arm_cells, growing / self._arm_cells])

    def _turned(self, x: float, y: float) -> tuple[float, float]:
        """A direction in the model's coordinates."""
        cos, sin = math.cos(self.pose[ANGLE]), math.sin(self.pose[ANGLE])
        return cos * x + sin * y, cos * y - sin * x

    def _changed(self, since_s: float) -> tuple[float, float]:
        """Scale and angle after a time, if growing and turning go on."""
        scale = self.pose[SCALE] * math.exp(self._growing.per_s * since_s)
        return float(scale), float(self.pose[ANGLE] + self._turning.per_s * since_s)

    def _since_s(self, stamp_ns: int) -> float:
        return (stamp_ns - self.stamp_ns) * 1e-9

    def _motion_s(self) -> float:
        """The time of a window's motion (s), at most `window_max_s`."""
        return self._pace.motion_s(max(self.sweep_px_s, self.least_speed_px_s), self.sizes_per_s)

    def _span_s(self, stamp_ns: int) -> float:
        return max(self._motion_s(), self._since_s(stamp_ns), SPAN_MIN_S)
