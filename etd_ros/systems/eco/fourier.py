"""Functions on the search area, periodic and real, as their Fourier coefficients.

The search area is one period, its coordinates (row, column) run from -1/2 to 1/2 with the middle at 0. A function is
kept by its coefficients of frequencies -K to K along the rows and 0 to K along the columns: it is real, so the others
are conjugates. A spectrum is complex64 of shape (..., 2 K + 1, K + 1). Channels with different cells have different K;
their sums are taken on the largest one (C-COT: Danelljan et al., ECCV 2016).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import fft

FloatArray = npt.NDArray[np.float32]
Spectrum = npt.NDArray[np.complex64]
Spectra = list[Spectrum]
"""One spectrum of shape (channels, 2 K + 1, K + 1) for each kind of feature."""


def cubic_kernel_spectrum(frequency: npt.NDArray[np.float64], a: float) -> npt.NDArray[np.float64]:
    """Fourier transform of the cubic convolution kernel of Keys (1981; Park and Schowengerdt 1983); frequency in
    1 / sample."""
    f = np.where(frequency == 0, 1.0, frequency)
    own = 3 * (np.sinc(f) ** 2 - np.sinc(2 * f))
    of_a = 2 * a * (3 * np.sinc(2 * f) ** 2 - 2 * np.sinc(2 * f) - np.sinc(4 * f))
    return np.where(frequency == 0, 1.0, (own + of_a) / (np.pi * f) ** 2)


class Interpolation:
    """Maps of cells x cells samples that cover the search area, as spectra of the functions interpolated from them.

    An odd number of cells puts the middle one's centre at 0. Each map is tapered by a Hann window towards the border,
    where the period jumps. Their transform is the samples' times the kernel's.
    """

    def __init__(self, cells: int, a: float) -> None:
        self.cells = cells
        taper = np.hanning(cells + 2)[1:-1]
        self._taper = np.outer(taper, taper).astype(np.float32)
        kernel = cubic_kernel_spectrum(np.arange(-(cells // 2), cells // 2 + 1) / cells, a)
        self._kernel = np.outer(kernel, kernel[cells // 2 :]).astype(np.float32)

    def spectrum(self, maps: FloatArray) -> Spectrum:
        """Spectrum of each map; float32 of shape (channels, cells, cells)."""
        centred = np.fft.ifftshift(maps * self._taper, axes=(1, 2))
        coefficients = np.fft.fftshift(fft.rfft2(centred, norm="forward"), axes=1)
        return np.asarray(coefficients * self._kernel, np.complex64)


def label_spectrum(sigma: float, highest: int) -> FloatArray:
    """The desired score, a Gaussian of height 1 in the middle: real coefficients, float32, shape (2 K + 1, K + 1).

    Args:
        sigma: standard deviation, as a share of the search area's side.
        highest: highest frequency K.
    """
    k = np.arange(-highest, highest + 1)
    values = np.sqrt(2 * np.pi) * sigma * np.exp(-2 * (np.pi * sigma * k) ** 2)
    return np.outer(values, values[highest:]).astype(np.float32)


def shifted(spectra: Spectra, row: float, column: float) -> Spectra:
    """Spectra of the functions moved by minus (row, column): what was there is now in the middle."""
    moved = []
    for spectrum in spectra:
        highest = spectrum.shape[-1] - 1
        along_rows = np.exp(2j * np.pi * row * np.arange(-highest, highest + 1))
        along_columns = np.exp(2j * np.pi * column * np.arange(highest + 1))
        moved.append(np.asarray(spectrum * np.outer(along_rows, along_columns), np.complex64))
    return moved


def cropped(spectrum: Spectrum, highest: int) -> Spectrum:
    """The frequencies up to `highest` of a spectrum, as a view."""
    middle = spectrum.shape[-1] - 1
    return spectrum[..., middle - highest : middle + highest + 1, : highest + 1]


def inner(a: npt.NDArray[Any], b: npt.NDArray[Any]) -> float:
    """Inner product: of two spectra the integral of their functions' product over the search area (Parseval), of two
    real arrays the sum of their products."""
    if not np.iscomplexobj(a):
        return float(np.vdot(a, b))
    return float(2 * np.vdot(a, b).real - np.vdot(a[..., 0], b[..., 0]).real)


def on_grid(score: Spectrum) -> FloatArray:
    """The function of one spectrum, shape (2 K + 1, K + 1), at 2 K + 1 places a side; the middle comes first."""
    side = score.shape[0]
    return np.asarray(fft.irfft2(np.fft.ifftshift(score, axes=0), s=(side, side), norm="forward"), np.float32)
