"""Whether what seems to turn does: a stride swings and leans for a moment as if all of somebody turned.

Looks cannot tell that from their misfits, which all say that it turns, and the model soon is of somebody askew, as it
goes on learning. So what it was before is kept: of what turns, that fits best turned, of what does not, as it was.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from etd_ros.tracking.contour_kernels import ANGLE, TURNING, Float32Array, Float64Array, scores_of_shapes
from etd_ros.tracking.misfits import Sight

TURNED_CELLS = 1.0
"""Turned by less than what moves the outline by so many cells, both poses fit alike."""
TURNED_MAX_RAD = math.pi / 2
"""What has turned by so much does: its first look, of then, may be another by now."""
LOOKS, AVERAGE_S = 3, 0.1
"""One look in so many is asked; what they say is averaged over this time."""
SCORE_MIN = 1e-6
AS_IT_IS = np.array([[1.0, 1.0, 0.0]])
PLACES_PX = ((0.0, 0.0), (-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0))
"""Each pose is tried there, too: the place was fitted to what it has learnt since."""


class TurningTrial:
    """What a target looked like when it began to turn, and how well that fits since, turned and as it was.

    Args:
        maps: of the model then, shape (MAPS, rows, columns).
        norms: what `measure_norms` says of them.
        angle_rad: of the model then.
        arm_cells: cells from the middle to where turning moves the model as much as moving does, usually.

    Attributes:
        angle_rad: the same.
    """

    def __init__(self, maps: Float32Array, norms: Float64Array, angle_rad: float, arm_cells: float) -> None:
        self._maps, self._norms = maps.copy(), norms.copy()
        self.angle_rad = angle_rad
        self._arm_cells = arm_cells
        self._upright = 0.0
        self._looks = 0
        self._since_s = 0.0

    def fails(self, sight: Sight, cell_px: float, ridge_weight: float, elapsed_s: float) -> bool:
        """Whether looks so far fit what was before better as it was than turned. Where it turned by little or by much,
        or it is not this look's turn to be asked, that is not so.

        Args:
            sight: what the newest look sees.
            cell_px: pixels of a model's cell at scale 1.
            ridge_weight: weight of where events are, beside which polarity they have.
            elapsed_s: since the last look (s).
        """
        self._looks += 1
        self._since_s += elapsed_s
        turned_rad = abs(float(sight.pose[ANGLE]) - self.angle_rad)
        if turned_rad > TURNED_MAX_RAD or self._looks % LOOKS != 1:
            return False
        turned, upright = (self._score(seen, cell_px, ridge_weight) for seen in (sight, self._as_it_was(sight)))
        kept, self._since_s = math.exp(-self._since_s / AVERAGE_S), 0.0
        better = (upright - turned) / max(upright, turned, SCORE_MIN)
        self._upright = kept * self._upright + (1 - kept) * better
        return self._upright > 0 and turned_rad * self._arm_cells > TURNED_CELLS

    def _as_it_was(self, sight: Sight) -> Sight:
        """The same if the target has not turned, and does not."""
        pose, velocity, motion = sight.pose.copy(), sight.velocity.copy(), sight.motion.copy()
        pose[ANGLE] = self.angle_rad
        velocity[TURNING] = motion[TURNING] = 0.0
        return replace(sight, pose=pose, velocity=velocity, motion=motion)

    def _score(self, sight: Sight, cell_px: float, ridge_weight: float) -> float:
        """Of the best place near by."""
        best, score, pose = 0.0, np.empty(1), sight.pose.copy()
        for right, below in PLACES_PX:
            pose[:2] = sight.pose[0] + right, sight.pose[1] + below
            scores_of_shapes(
                sight.points, sight.count, self._maps, self._norms, pose, AS_IT_IS, cell_px, sight.velocity,
                sight.motion, ridge_weight, score,
            )  # fmt: skip
            best = max(best, float(score[0]))
        return best
