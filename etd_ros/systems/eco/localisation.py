"""Where a continuous score is highest, to a fraction of its cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from etd_ros.systems.eco.fourier import Spectrum, on_grid

DoubleArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Peak:
    """The highest place of a score: (row, column) from the middle in shares of the search area's side, and the score
    there."""

    row: float
    column: float
    score: float


def find_peak(score: Spectrum, newton_steps: int) -> Peak:
    """Highest place of a score.

    The highest of its values on a grid is where Newton's method starts on the Fourier series itself
    (C-COT: Danelljan et al., ECCV 2016). The grid's place stays where the steps do not lead higher.

    Args:
        score: spectrum, complex64, shape (2 K + 1, K + 1).
        newton_steps: steps taken.
    """
    side = score.shape[0]
    values = on_grid(score)
    row, column = divmod(int(np.argmax(values)), side)
    best = Peak(_wrapped(row / side), _wrapped(column / side), float(values[row, column]))
    place = np.array([best.row, best.column])
    for _ in range(newton_steps):
        _, gradient, hessian = _taylor(score, place)
        if hessian[0, 0] >= 0 or np.linalg.det(hessian) <= 0:
            return best
        place = place - np.linalg.solve(hessian, gradient)
    value, _, _ = _taylor(score, place)
    if value <= best.score:
        return best
    return Peak(_wrapped(float(place[0])), _wrapped(float(place[1])), value)


def _wrapped(place: float) -> float:
    """The same place within [-1/2, 1/2)."""
    return (place + 0.5) % 1.0 - 0.5


def _taylor(score: Spectrum, place: DoubleArray) -> tuple[float, DoubleArray, DoubleArray]:
    """A series' value, gradient (2,) and Hessian (2, 2) at a place (row, column)."""
    highest = score.shape[1] - 1
    along_rows, along_columns = np.arange(-highest, highest + 1), np.arange(highest + 1)
    rows = np.exp(2j * np.pi * along_rows * place[0])
    # Columns of negative frequency are not kept: each other column but the first counts for its conjugate as well.
    columns = np.exp(2j * np.pi * along_columns * place[1]) * np.where(along_columns > 0, 2, 1)
    slope_r, slope_c = 2j * np.pi * along_rows, 2j * np.pi * along_columns
    left = np.stack([rows, rows * slope_r, rows * slope_r**2])
    right = np.stack([columns, columns * slope_c, columns * slope_c**2])
    terms = (left @ score @ right.T).real
    hessian = np.array([[terms[2, 0], terms[1, 1]], [terms[1, 1], terms[0, 2]]])
    return float(terms[0, 0]), np.array([terms[1, 0], terms[0, 1]]), hessian
