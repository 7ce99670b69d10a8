"""By how much another scale or angle would fit a look better."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from etd_ros.tracking.contour_drawing import learn
from etd_ros.tracking.contour_kernels import (
    MAPS,
    WEIGHT,
    Float32Array,
    Float64Array,
    measure_norms,
    parabola,
    scores_of_shapes,
)

STRETCH_STEP = 0.04
ANGLE_STEP_CELLS, ANGLE_STEP_MAX = 1.0, 0.3
"""An angle is tried that moves the model by so many cells, usually."""
STIFFNESS = 0.015, 0.015, 0.03
"""A change of width, height or angle that changes the score by less than this share of it is hardly taken on: a ball
has no angle."""
PREFERENCE_LOOKS, PREFERENCE_RATE = 3, 0.25
"""What the score prefers hardly changes: it is learnt from one look in so many, and so fast."""


class Misfit(NamedTuple):
    """By how much a model is off: too narrow, too low (logarithms), and turned (rad)."""

    wider: float
    higher: float
    angle: float

    @property
    def scale(self) -> float:
        """The logarithm by which it is too small: the harmonic mean of both, which is nearer to the lesser; 0 where one
        is too large."""
        return 2 * self.wider * self.higher / (self.wider + self.higher) if self.wider * self.higher > 0 else 0.0


@dataclass(frozen=True, slots=True)
class Sight:
    """The points of a look, and how the target was and moved.

    Attributes:
        points, count: as `TimeSurface.points` returns them.
        pose: of the model.
        velocity: a motion, pixels/s, rad/s and 1/s.
        motion: what polarities are predicted by (pixels).
    """

    points: Float32Array
    count: int
    pose: Float64Array
    velocity: Float64Array
    motion: Float64Array


class Misfits:
    """Of a target's scale and angle.

    What grows becomes wider and higher. What is not flat becomes wider or narrower alone when it is passed: its nearest
    parts overtake the others. So the model is stretched along both of its axes, each for itself, and the scale is off
    by the harmonic mean of what they say, which is nearer to the lesser; by nothing where one says more and one less,
    or one says nothing.

    The score itself prefers shapes, whatever the target does: a smaller model has fewer points under it that are of
    other things, a larger one more lines of a background that goes on beyond it, and a line counts as far as the model
    reaches. So the points are also compared with what they draw themselves, which is off by nothing: what they seem to
    be off by there is taken away.

    Args:
        weight: how much each of the model's cells counts, float32, shape (rows, columns).
        arm_cells: cells from the middle to where turning moves the model as much as moving does, usually.
        cell_px: pixels of a cell at scale 1.
        ridge_weight: weight of where events are, beside which polarity they have.
    """

    def __init__(self, weight: Float32Array, arm_cells: float, cell_px: float, ridge_weight: float) -> None:
        self._own: Float32Array = np.zeros((MAPS, *weight.shape), np.float32)
        self._own[WEIGHT] = weight
        self._own_norms = np.zeros((5, 5))
        self._cell_px, self._ridge_weight = cell_px, ridge_weight
        angle_step = min(ANGLE_STEP_CELLS / arm_cells, ANGLE_STEP_MAX)
        self._steps = STRETCH_STEP, STRETCH_STEP, angle_step
        self._shapes = np.tile([1.0, 1.0, 0.0], (1 + 2 * len(self._steps), 1))
        for part, step in enumerate(self._steps):
            self._shapes[1 + 2 * part, part] -= step
            self._shapes[2 + 2 * part, part] += step
        self._scores = np.empty(len(self._shapes))
        self._preferred = np.zeros(len(self._steps))
        self._looks = 0

    def measure(self, sight: Sight, maps: Float32Array, norms: Float64Array) -> Misfit:
        """How far the model's shape is off, at most half a step each way.

        Args:
            sight: what is seen.
            maps: of the model, shape (MAPS, rows, columns).
            norms: what `measure_norms` says of them.
        """
        as_is, less, more = self._beside(sight, maps, norms)
        return Misfit(
            *(
                step * parabola(left + preferred * as_is, as_is, right - preferred * as_is, stiffness * abs(as_is))
                for step, left, right, preferred, stiffness in zip(
                    self._steps, less.tolist(), more.tolist(), self._preferred.tolist(), STIFFNESS, strict=True
                )
            )
        )

    def learn_preferences(self, sight: Sight, drawn: Float32Array, direction: Float64Array) -> None:
        """Learn what the score prefers.

        Args:
            sight: what is seen.
            drawn: what its points draw, normalised, shape (2, rows, columns).
            direction: of the motion, as `learn` takes it.
        """
        self._looks += 1
        if self._looks % PREFERENCE_LOOKS != 1:
            return
        self._own[:WEIGHT] = 0
        learn(self._own, drawn, direction, 1.0)
        measure_norms(self._own, self._own_norms)
        as_is, less, more = self._beside(sight, self._own, self._own_norms)
        if as_is > 0:
            rate = max(PREFERENCE_RATE, 1 / self._looks)
            self._preferred += rate * ((more - less) / (2 * as_is) - self._preferred)

    def _beside(
        self, sight: Sight, maps: Float32Array, norms: Float64Array
    ) -> tuple[float, Float64Array, Float64Array]:
        """Scores of the model as it is, and a step less and a step more wide, high and turned, shape (3,): views that
        the next call overwrites."""
        scores_of_shapes(
            sight.points, sight.count, maps, norms, sight.pose, self._shapes, self._cell_px, sight.velocity,
            sight.motion, self._ridge_weight, self._scores,
        )  # fmt: skip
        return float(self._scores[0]), self._scores[1::2], self._scores[2::2]
