"""The penalty that keeps a filter's energy on the target (SRDCF: Danelljan et al., ICCV 2015)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from etd_ros.systems.eco.config import EcoConfig
from etd_ros.systems.eco.fourier import Spectrum


class PenaltyWindow:
    """Multiplies filters by a window w that is smallest in the target's middle and grows quadratically from it,

    w(row, column) = min + (edge - min) ((row / half height)^2 + (column / half width)^2),

    by a convolution of their coefficients with those of w. Its coefficients are known in closed form and lie on the
    axes only; small ones are left out, and the mean set so that the smallest value is `window_min` again.

    Attributes:
        energy: sum of the squared coefficients.
    """

    def __init__(self, target: tuple[float, float], side: float, config: EcoConfig) -> None:
        growth = config.window_edge - config.window_min
        strengths = [growth * (2 * side / length) ** 2 for length in reversed(target)]
        mean = config.window_min + sum(strengths) / 12
        threshold = config.window_threshold * max(mean, *(strength / (2 * math.pi**2) for strength in strengths))
        self._rows, self._columns = (_axis_coefficients(strength, threshold) for strength in strengths)
        self._mean = config.window_min - _lowest(self._rows) - _lowest(self._columns)
        self.energy = self._mean**2 + 2 * float(np.sum(self._rows**2) + np.sum(self._columns**2))

    def apply_squared(self, filters: Spectrum) -> Spectrum:
        """Spectra of w^2 times each function, in the frequencies of the given ones: what the penalty's gradient is."""
        rows, columns = len(self._rows), len(self._columns)
        highest = filters.shape[-1] - 1
        # Columns of negative frequency that the two convolutions reach, as conjugates of the positive ones.
        mirrored = np.conj(filters[:, ::-1, min(2 * columns, highest) : 0 : -1])
        lacking = 2 * columns - mirrored.shape[-1]
        padding = ((0, 0), (2 * rows, 2 * rows), (lacking, 2 * columns))
        plane = np.pad(np.concatenate([mirrored, filters], axis=-1), padding)
        return np.asarray(self._convolved(self._convolved(plane)), np.complex64)

    def _convolved(self, plane: Spectrum) -> Spectrum:
        """The part of a convolution with w for which all coefficients are there."""
        rows, columns = len(self._rows), len(self._columns)
        height, width = plane.shape[1] - 2 * rows, plane.shape[2] - 2 * columns
        middle_rows, middle_columns = slice(rows, rows + height), slice(columns, columns + width)
        total = np.float32(self._mean) * plane[:, middle_rows, middle_columns]
        for k, value in enumerate(self._rows.astype(np.float32), start=1):
            before, after = plane[:, rows - k : rows - k + height], plane[:, rows + k : rows + k + height]
            total += value * (before + after)[:, :, middle_columns]
        for k, value in enumerate(self._columns.astype(np.float32), start=1):
            before, after = (
                plane[:, :, columns - k : columns - k + width],
                plane[:, :, columns + k : columns + k + width],
            )
            total += value * (before + after)[:, middle_rows]
        return total


def _axis_coefficients(strength: float, threshold: float) -> npt.NDArray[np.float64]:
    """Fourier coefficients of strength * u^2, u from -1/2 to 1/2, of frequencies 1, 2, ... down to a threshold."""
    number = math.floor(math.sqrt(strength / (2 * math.pi**2 * threshold)))
    k = np.arange(1, number + 1)
    return strength * (-1.0) ** k / (2 * math.pi**2 * k**2)


def _lowest(coefficients: npt.NDArray[np.float64]) -> float:
    """Smallest value of the cosine series without a mean."""
    u = np.linspace(-0.5, 0.5, 1001)
    k = np.arange(1, len(coefficients) + 1)
    return float(np.min(2 * np.cos(2 * np.pi * np.outer(u, k)) @ coefficients))
