"""By how much another scale or angle would fit a look better."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etd_ros.tracking.contour_drawing import learn
from etd_ros.tracking.contour_kernels import (
    ANGLE,
    MAPS,
    SCALE,
    WEIGHT,
    Float32Array,
    Float64Array,
    measure_norms,
    parabola,
    scores_beside,
)

SCALE_STEP = 0.04
ANGLE_STEP_CELLS, ANGLE_STEP_MAX = 1.0, 0.3
"""An angle is tried that moves the model by so many cells, usually."""
STIFFNESS = 0.03
"""A change of scale or angle that changes the score by less than this share of it is hardly taken on: a ball has no
angle."""
PREFERENCE_LOOKS, PREFERENCE_RATE = 3, 0.25
"""What the score prefers hardly changes: it is learnt from one look in so many, and so fast."""


@dataclass(frozen=True, slots=True)
class Sight:
    """The points of a look, and how the target was and moved.

    Attributes:
        points, count: as `TimeSurface.points` returns them.
        pose: of the model; parts of it change as they are fitted.
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

    The score itself prefers sizes and angles, whatever the target does: a smaller model has fewer points under it that
    are of other things, a larger one more lines of a background that goes on beyond it, and a line counts as far as the
    model reaches. So the points are also compared with what they draw themselves, which is off by nothing: what they
    seem to be off by there is taken away.

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
        self._steps = {SCALE: SCALE_STEP, ANGLE: min(ANGLE_STEP_CELLS / arm_cells, ANGLE_STEP_MAX)}
        self._preferred = dict.fromkeys(self._steps, 0.0)
        self._looks = 0

    def misfit(self, part: int, sight: Sight, maps: Float32Array, norms: Float64Array) -> float:
        """How far the model's scale (its logarithm) or angle (rad) is off, at most half a step.

        Args:
            part: SCALE or ANGLE.
            sight: what is seen.
            maps: of the model, shape (MAPS, rows, columns).
            norms: what `measure_norms` says of them.
        """
        less, as_is, more = self._scores(part, sight, maps, norms)
        preferred = self._preferred[part] * as_is
        return self._steps[part] * parabola(less + preferred, as_is, more - preferred, STIFFNESS * abs(as_is))

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
        rate = max(PREFERENCE_RATE, 1 / self._looks)
        for part, preferred in self._preferred.items():
            less, as_is, more = self._scores(part, sight, self._own, self._own_norms)
            if as_is > 0:
                self._preferred[part] += rate * ((more - less) / (2 * as_is) - preferred)

    def _scores(self, part: int, sight: Sight, maps: Float32Array, norms: Float64Array) -> tuple[float, float, float]:
        """Of a step less, none and a step more."""
        return scores_beside(
            sight.points, sight.count, maps, norms, sight.pose, part, self._steps[part], self._cell_px, sight.velocity,
            sight.motion, self._ridge_weight,
        )  # fmt: skip
