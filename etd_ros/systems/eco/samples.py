"""What the filter is learnt from: a mixture of Gaussians of all samples seen.

ECO: Danelljan et al., CVPR 2017, Section 3.2.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.systems.eco.fourier import Spectra, Spectrum, cropped, inner


class SampleSpace:
    """At most so many components, each a mean sample and a weight; the newest samples weigh most.

    Where there is no room for a new sample, a component with next to no weight makes place for it. If none has so
    little, the two nearest of all, the new one among them, become one.

    Attributes:
        weights: of the components, float32; they sum to 1 and those not yet used are 0.
        count: components in use.
    """

    def __init__(self, capacity: int, learning_rate: float) -> None:
        self.weights = np.zeros(capacity, np.float32)
        self.count = 0
        self._rate = learning_rate
        self._weight_min = learning_rate * (1 - learning_rate) ** (2 * capacity)
        self._samples: list[Spectrum] = []
        self._products = np.zeros((capacity, capacity))

    @property
    def samples(self) -> list[Spectrum]:
        """The components' means, for each kind of feature of shape (count, channels, 2 K + 1, K + 1)."""
        return [block[: self.count] for block in self._samples]

    def add(self, sample: Spectra) -> None:
        """Let the model learn another sample."""
        capacity = len(self.weights)
        if not self.count:
            self._samples = [np.zeros((capacity, *part.shape), np.complex64) for part in sample]
            self._put(0, sample, 1.0)
            return
        self.weights *= np.float32(1 - self._rate)
        if self.count < capacity:
            self._put(self.count, sample, self._rate)
            return
        lightest = int(np.argmin(self.weights))
        if self.weights[lightest] < self._weight_min:
            self.weights[lightest] = 0
            self.weights *= np.float32((1 - self._rate) / self.weights.sum(dtype=np.float64))
            self._put(lightest, sample, self._rate)
            return
        self._merge_nearest(sample)

    def _merge_nearest(self, sample: Spectra) -> None:
        own = np.diagonal(self._products)
        distances = own[:, None] + own - 2 * self._products
        np.fill_diagonal(distances, np.inf)
        first, second = divmod(int(np.argmin(distances)), len(own))
        norm = sum(inner(part, part) for part in sample)
        to_new = own + norm - 2 * self._products_with(sample)
        nearest = int(np.argmin(to_new))
        if to_new[nearest] < distances[first, second]:
            self._merge(nearest, sample, self._rate)
            return
        self._merge(first, [block[second] for block in self._samples], float(self.weights[second]))
        self._put(second, sample, self._rate)

    def _merge(self, index: int, other: Spectra, weight: float) -> None:
        total = float(self.weights[index]) + weight
        share = np.float32(weight / total)
        self._put(
            index,
            [block[index] + share * (part - block[index]) for block, part in zip(self._samples, other, strict=True)],
            total,
        )

    def _put(self, index: int, sample: Spectra, weight: float) -> None:
        for block, part in zip(self._samples, sample, strict=True):
            block[index] = part
        self.weights[index] = weight
        self.count = max(self.count, index + 1)
        self._products[index] = self._products_with(sample)
        self._products[:, index] = self._products[index]

    def _products_with(self, sample: Spectra) -> npt.NDArray[np.float64]:
        """Inner product of a sample with each component, shape (capacity,)."""
        products = np.zeros(len(self.weights))
        for block, part in zip(self._samples, sample, strict=True):
            _add_products(block[: self.count], part, products)
        return products


def filter_samples(samples: list[Spectrum], filters: Spectra) -> Spectrum:
    """Scores of samples: the sum over all features of sample times filter.

    Args:
        samples: for each kind of feature shape (samples, channels, 2 K + 1, K + 1).
        filters: for each kind of feature shape (channels, 2 K + 1, K + 1).

    Returns:
        Spectra of shape (samples, 2 K + 1, K + 1) with the largest K.
    """
    parts = []
    for block, channels in zip(samples, filters, strict=True):
        part = np.zeros((len(block), *channels.shape[1:]), np.complex64)
        _add_scores(block, channels, part)
        parts.append(part)
    total = max(parts, key=lambda part: part.shape[-1])
    for part in parts:
        if part is not total:
            cropped(total, part.shape[-1] - 1)[...] += part
    return total


def correlate_samples(samples: list[Spectrum], scores: Spectrum) -> Spectra:
    """The adjoint of `filter_samples`: for each channel the sum over samples of its conjugate times the score."""
    results = []
    for block in samples:
        part = np.ascontiguousarray(cropped(scores, block.shape[-1] - 1))
        result = np.zeros(block.shape[1:], np.complex64)
        _add_correlations(block, part, result)
        results.append(result)
    return results


@njit(cache=True, nogil=True)
def _add_products(
    block: npt.NDArray[np.complex64], sample: npt.NDArray[np.complex64], products: npt.NDArray[np.float64]
) -> None:
    """Add each component's inner product with a sample; columns of negative frequency are counted with the others."""
    number, channels, rows, columns = block.shape
    for i in range(number):
        first, others = 0.0, 0.0
        for d in range(channels):
            for r in range(rows):
                a, b = block[i, d, r, 0], sample[d, r, 0]
                first += a.real * b.real + a.imag * b.imag
                for c in range(1, columns):
                    a, b = block[i, d, r, c], sample[d, r, c]
                    others += a.real * b.real + a.imag * b.imag
        products[i] += first + 2 * others


@njit(cache=True, nogil=True)
def _add_scores(
    block: npt.NDArray[np.complex64], filters: npt.NDArray[np.complex64], scores: npt.NDArray[np.complex64]
) -> None:
    number, channels, rows, columns = block.shape
    for i in range(number):
        for d in range(channels):
            for r in range(rows):
                for c in range(columns):
                    scores[i, r, c] += block[i, d, r, c] * filters[d, r, c]


@njit(cache=True, nogil=True)
def _add_correlations(
    block: npt.NDArray[np.complex64], scores: npt.NDArray[np.complex64], result: npt.NDArray[np.complex64]
) -> None:
    number, channels, rows, columns = block.shape
    for i in range(number):
        for d in range(channels):
            for r in range(rows):
                for c in range(columns):
                    result[d, r, c] += np.conj(block[i, d, r, c]) * scores[i, r, c]
