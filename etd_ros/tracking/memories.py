"""What a target looks like: usually, lately, and in its last few looks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etd_ros.tracking.cell_trust import CellTrust
from etd_ros.tracking.cell_weights import OUTSIDE_FADES, WEIGHT_FADES, oval
from etd_ros.tracking.contour_drawing import learn
from etd_ros.tracking.contour_kernels import MAPS, WEIGHT, Float32Array, Float64Array

RECENT_RATE, LATEST_TIMES = 0.1, 3.0
"""Share of what the target looks like lately that a look renews; of what its last few looks are, so many times as
much."""


@dataclass(frozen=True, slots=True)
class Remembered:
    """Memories at some time: their maps, float32, shape (3, MAPS, rows, columns), and how much is known of edges across
    each direction, float64, shape (2, 2): a direction d has been seen by d . seen d, 0 to 1."""

    maps: Float32Array
    seen: Float64Array


def known_along(seen: Float64Array, x: float, y: float) -> float:
    """How much of what a direction of motion shows has been seen, 0 to 1, by what `Remembered` has of that; x, y of
    length 1, in the model's coordinates."""
    (xx, xy), (yx, yy) = seen.tolist()
    return float(x * (xx * x + xy * y) + y * (yx * x + yy * y))


class Memories:
    """Three models of a target, which differ in how fast a look renews them.

    Args:
        rows: cells of a model.
        columns: the same.
        width: of the target, in cells.
        height: the same.

    Attributes:
        usual: what the target usually looks like, float32, shape (MAPS, rows, columns).
        weight: how much the cells count, float32, shape (rows, columns).
        cells: what looks are compared with, and how far its cells can be trusted.
    """

    def __init__(self, rows: int, columns: int, width: float, height: float) -> None:
        self._maps: Float32Array = np.zeros((3, MAPS, rows, columns), np.float32)
        self.usual, self._recent, self._latest = self._maps
        self._maps[:, WEIGHT] = oval(rows, columns, width, height, WEIGHT_FADES)
        outside: Float32Array = np.float32(1) - oval(rows, columns, width, height, OUTSIDE_FADES)
        self.weight: Float32Array = self.usual[WEIGHT]
        self._outside = outside
        self.cells = CellTrust(self.usual, outside)
        self._seen = np.zeros((2, 2))
        self._kept = self.remembered()

    def known_along(self, x: float, y: float) -> float:
        """How much of what a direction of motion shows has been seen, 0 to 1; x, y of length 1, in the model's
        coordinates."""
        return known_along(self._seen, x, y)

    def see(self, x: float, y: float, share: float) -> None:
        """A direction of motion has shown this share of what can be seen along it."""
        self._seen += share * np.array([[x * x, x * y], [x * y, y * y]])

    def learn(
        self, drawn: Float32Array, direction: Float64Array, rate: float, trust: float, *, sees_covers: bool
    ) -> None:
        """Move the memories towards what a look has drawn.

        Args:
            drawn: normalised, shape (2, rows, columns).
            direction: of the motion, as `contour_drawing.learn` takes it.
            rate: how much of the usual memory is renewed, 0 to 1.
            trust: how far the look is trusted: the recent memory is renewed by RECENT_RATE of that, by `rate` at least,
                and the latest by LATEST_TIMES as much.
            sees_covers: whether cells that show what covers the target count less from now on.
        """
        recent_rate = max(rate, trust * RECENT_RATE)
        learn(self.usual, drawn, direction, rate)
        learn(self._recent, drawn, direction, recent_rate)
        learn(self._latest, drawn, direction, min(1.0, LATEST_TIMES * recent_rate))
        self._weigh(sees_covers=sees_covers)

    def uncover(self) -> None:
        """Trust all of the target again."""
        self._weigh(sees_covers=False)

    def keep(self) -> None:
        """Keep what they are now."""
        np.copyto(self._kept.maps, self._maps)
        np.copyto(self._kept.seen, self._seen)

    def restore(self) -> None:
        """Go back to what was kept last."""
        self.recall(self._kept)

    def remembered(self) -> Remembered:
        """What they are now."""
        return Remembered(self._maps.copy(), self._seen.copy())

    def recall(self, remembered: Remembered) -> None:
        """Be as they once were."""
        np.copyto(self._maps, remembered.maps)
        np.copyto(self._seen, remembered.seen)

    def cells_of(self, remembered: Remembered) -> CellTrust:
        """What looks would be compared with if they were as they once were, and all of the target trusted."""
        usual, recent, latest = remembered.maps
        cells = CellTrust(usual, self._outside)
        cells.weigh(usual, recent, latest, remembered.seen, sees_covers=False)
        return cells

    def _weigh(self, *, sees_covers: bool) -> None:
        self.cells.weigh(self.usual, self._recent, self._latest, self._seen, sees_covers=sees_covers)
