"""What ECO sees of a picture: oriented gradients and intensity channels of the search area."""

from __future__ import annotations

import math
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.boxes import Box
from etd_ros.systems.eco.config import EcoConfig
from etd_ros.systems.eco.fhog import fhog
from etd_ros.systems.eco.fourier import FloatArray, Interpolation, Spectra
from etd_ros.systems.eco.intensity import intensity_channels, membership
from etd_ros.systems.eco.pictures import Pyramid

Coefficient = TypeVar("Coefficient", np.float32, np.complex64)

Projections = list[FloatArray]
"""For each kind of feature what its channels become; float32, shape (channels, dimensions kept)."""


class Features:
    """The features of one target's search area, whose size in samples is fixed by the target's first box.

    Attributes:
        scale: picture pixels to a sample pixel for a target of its first size.
        side: of the sample (sample pixels).
        target: width and height of the target (sample pixels).
    """

    def __init__(self, box: Box, config: EcoConfig) -> None:
        wanted = config.search_scale * math.sqrt(box.w * box.h)
        self.scale = wanted / min(max(wanted, config.sample_side_min), config.sample_side_max)
        hog_cells = _nearest_odd(wanted / self.scale / config.hog_cell)
        self.side = hog_cells * config.hog_cell
        self.target = box.w / self.scale, box.h / self.scale
        self._config = config
        self._membership = membership(config.intensity_bins)
        cells = hog_cells, _nearest_odd(self.side / config.intensity_cell)
        self._interpolations = [Interpolation(number, config.interpolation_a) for number in cells]

    @property
    def highest(self) -> int:
        """The highest frequency of any feature."""
        return max(interpolation.cells for interpolation in self._interpolations) // 2

    def maps(self, pyramid: Pyramid, center: tuple[float, float], scale: float) -> list[FloatArray]:
        """Feature maps of the search area round `center` (column, row; pixels), `scale` picture pixels to a sample's.

        Returns:
            For each kind of feature float32 of shape (channels, cells, cells), its mean square 1 (0 where it has no
            content).
        """
        extent = self.side * scale
        patch = pyramid.patch(center, (extent, extent), (self.side, self.side))
        gradients = fhog(patch, self._config.hog_cell)
        intensities = intensity_channels(patch, self._interpolations[1].cells, self._membership)
        return [_normalised(gradients), _normalised(intensities)]

    def spectra(self, maps: list[FloatArray]) -> Spectra:
        """Spectra of feature maps, projected ones or all."""
        return [
            interpolation.spectrum(channels) for interpolation, channels in zip(self._interpolations, maps, strict=True)
        ]

    def principal_directions(self, maps: list[FloatArray]) -> Projections:
        """The directions of largest variance among the cells: orthonormal columns, the largest first."""
        dimensions = self._config.hog_dimensions, self._config.intensity_dimensions
        return [_principal(channels, kept) for channels, kept in zip(maps, dimensions, strict=True)]


def project(channels: npt.NDArray[Coefficient], projection: FloatArray) -> npt.NDArray[Coefficient]:
    """Feature maps, or their spectra, in the dimensions kept.

    The matrices are so small that handing them to the threads of a linear algebra library takes longer than this.

    Args:
        channels: shape (channels, rows, columns).
        projection: shape (channels, dimensions).

    Returns:
        Shape (dimensions, rows, columns).
    """
    projected = np.zeros((projection.shape[1], *channels.shape[1:]), channels.dtype)
    _add_projected(channels, projection, projected)
    return projected


def project_all(spectra: Spectra, projections: Projections) -> Spectra:
    """The spectra of each kind of feature in the dimensions kept."""
    return [project(channels, projection) for channels, projection in zip(spectra, projections, strict=True)]


@njit(cache=True, nogil=True)
def _add_projected(
    channels: npt.NDArray[Any], projection: npt.NDArray[np.float32], projected: npt.NDArray[Any]
) -> None:
    number, rows, columns = channels.shape
    for d in range(len(projected)):
        for c in range(number):
            share = projection[c, d]
            for r in range(rows):
                for k in range(columns):
                    projected[d, r, k] += share * channels[c, r, k]


def _nearest_odd(number: float) -> int:
    return 2 * round((number - 1) / 2) + 1


def _normalised(maps: FloatArray) -> FloatArray:
    mean_square = float(np.mean(np.square(maps)))
    return maps if mean_square == 0 else maps * np.float32(1 / math.sqrt(mean_square))


def _principal(channels: FloatArray, kept: int) -> FloatArray:
    values: npt.NDArray[np.float64] = channels.reshape(len(channels), -1).astype(np.float64)
    values -= values.mean(axis=1, keepdims=True)
    _, directions = np.linalg.eigh(values @ values.T)
    return np.ascontiguousarray(directions[:, ::-1][:, :kept], np.float32)
