"""How much larger or smaller the target has become: a correlation filter along sizes.

DSST (Danelljan et al., BMVC 2014) with the interpolated sizes of fDSST (Danelljan et al., PAMI 2017). fDSST's
compression to as many dimensions as there are sizes changes nothing in the answer, and is left out.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy import fft

from etd_ros.systems.eco.config import EcoConfig
from etd_ros.systems.eco.fhog import fhog
from etd_ros.systems.eco.pictures import Pyramid


class ScaleFilter:
    """Learns what the target looks like at `scales` sizes round its own, and finds the size that fits best."""

    def __init__(self, target: tuple[float, float], config: EcoConfig) -> None:
        """`target` is the width and height (pixels, any scale) that fix the shape of what the filter sees."""
        self._config = config
        cell = config.scale_cell
        shrink = min(1.0, math.sqrt(config.scale_area_max / (target[0] * target[1])))
        columns, rows = (max(2, math.floor(length * shrink / cell)) * cell for length in target)
        self._shape = rows, columns
        # Index 0 is the target's own size, as in a discrete Fourier transform; later ones wrap to smaller sizes.
        offsets = np.fft.ifftshift(np.arange(config.scales) - config.scales // 2)
        exponents = offsets * config.scales_fine / config.scales
        self._factors = config.scale_step**exponents
        self._taper = np.fft.ifftshift(np.hanning(config.scales)).astype(np.float32)
        sigma = config.scale_sigma * config.scales_fine
        self._label = fft.rfft(np.exp(-0.5 * (exponents / sigma) ** 2)).astype(np.complex64)
        self._numerator: npt.NDArray[np.complex64] | None = None
        self._denominator: npt.NDArray[np.float32] | None = None

    def learn(self, pyramid: Pyramid, center: tuple[float, float], size: tuple[float, float]) -> None:
        """The target is at `center` (column, row; pixels) and has this width and height (pixels)."""
        spectrum = self._spectrum(pyramid, center, size)
        numerator = np.conj(self._label) * spectrum
        denominator = np.sum(np.square(spectrum.real) + np.square(spectrum.imag), axis=0)
        if self._numerator is None or self._denominator is None:
            self._numerator, self._denominator = numerator, denominator
            return
        rate = np.float32(self._config.scale_learning_rate)
        self._numerator += rate * (numerator - self._numerator)
        self._denominator += rate * (denominator - self._denominator)

    def find(self, pyramid: Pyramid, center: tuple[float, float], size: tuple[float, float]) -> float:
        """How many times `size` (width and height, pixels) the target at `center` has; 1 before anything is learnt."""
        if self._numerator is None or self._denominator is None:
            return 1.0
        spectrum = self._spectrum(pyramid, center, size)
        matched = np.sum(np.conj(self._numerator) * spectrum, axis=0)
        response = matched / (self._denominator + np.float32(self._config.scale_penalty))
        number = self._config.scales_fine
        # A transform of more values than the spectrum has interpolates between the sizes.
        scores = fft.irfft(response, number)
        best = int(np.argmax(scores))
        before, here, after = (float(scores[(best + k) % number]) for k in (-1, 0, 1))
        bend = before - 2 * here + after
        vertex = 0.5 * (before - after) / bend if bend < 0 else 0.0
        exponent = (best + number // 2) % number - number // 2 + vertex
        return float(self._config.scale_step**exponent)

    def _spectrum(
        self, pyramid: Pyramid, center: tuple[float, float], size: tuple[float, float]
    ) -> npt.NDArray[np.complex64]:
        """Transform along the sizes of each oriented gradient, complex64, shape (gradients, scales // 2 + 1)."""
        looks = [
            fhog(pyramid.patch(center, (size[0] * factor, size[1] * factor), self._shape), self._config.scale_cell)
            for factor in self._factors
        ]
        features = np.stack([look.ravel() for look in looks], axis=1)
        return np.asarray(fft.rfft(features * self._taper, axis=1), np.complex64)
