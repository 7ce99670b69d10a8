"""The filter's least squares problem, for a given projection of the samples, or together with it.

The loss is that of C-COT (Danelljan et al., ECCV 2016); the projection is learnt as in ECO (Danelljan et al., CVPR
2017, Section 3.1).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.systems.eco.config import EcoConfig
from etd_ros.systems.eco.conjugate_gradient import Momentum, Vector, solve
from etd_ros.systems.eco.features import Projections, project_all
from etd_ros.systems.eco.fourier import FloatArray, Spectra, Spectrum, cropped
from etd_ros.systems.eco.samples import SampleSpace, correlate_samples, filter_samples
from etd_ros.systems.eco.window import PenaltyWindow


def sample_energy(sample: Spectra) -> list[FloatArray]:
    """Squared magnitude of each coefficient of a sample."""
    return [np.asarray(np.square(part.real) + np.square(part.imag), np.float32) for part in sample]


class FilterSystem:
    """The normal equations of the filter f that minimises, over weighted samples x_i and for the label y,

    sum_i weight_i |sum_d x_i,d f_d - y|^2 + sum_d |w f_d|^2.
    """

    def __init__(
        self, space: SampleSpace, energy: list[FloatArray], label: FloatArray, window: PenaltyWindow, config: EcoConfig
    ) -> None:
        self._samples = space.samples
        self._weights = space.weights[: space.count, None, None]
        self._label = label
        self._window = window
        self._diagonal = _diagonal(energy, window, config)

    def apply(self, x: Vector) -> Vector:
        scores = filter_samples(self._samples, x) * self._weights
        return _penalised(correlate_samples(self._samples, scores), x, self._window)

    def precondition(self, x: Vector) -> Vector:
        return [part / diagonal for part, diagonal in zip(x, self._diagonal, strict=True)]

    def right_side(self) -> Vector:
        return list(correlate_samples(self._samples, (self._weights * self._label).astype(np.complex64)))


class JointSystem:
    """One Gauss-Newton step for filter f and projection P together: the normal equations of f and the change D of P
    that minimise, over one sample z of all channels and linearised round the filter g and the projection P so far,

    |sum (P^T z) f + sum (D^T z) g - y|^2 + sum_d |w f_d|^2 + penalty |P + D|^2.

    The unknown holds the spectra of f and then the matrices D.
    """

    def __init__(
        self,
        sample: Spectra,
        filters: Spectra,
        projections: Projections,
        label: FloatArray,
        window: PenaltyWindow,
        config: EcoConfig,
    ) -> None:
        self._sample = sample
        self._filters = filters
        self._projections = projections
        self._label = label.astype(np.complex64)
        self._window = window
        self._penalty = np.float32(config.projection_penalty)
        projected = project_all(sample, projections)
        self._projected = [part[None] for part in projected]
        self._diagonal = _diagonal(sample_energy(projected), window, config)
        channels = sum(len(part) for part in sample)
        label_energy = 2 * float(np.sum(np.square(label))) / channels
        self._projection_diagonal = np.float32(config.precondition_projection * (label_energy + self._penalty))

    def apply(self, x: Vector) -> Vector:
        number = len(self._sample)
        filters, changes = x[:number], x[number:]
        change_samples = [part[None] for part in project_all(self._sample, changes)]
        score = filter_samples(self._projected, filters) + filter_samples(change_samples, self._filters)
        of_changes = [
            gradient + self._penalty * change
            for gradient, change in zip(self._projection_gradients(score[0]), changes, strict=True)
        ]
        return [*_penalised(correlate_samples(self._projected, score), filters, self._window), *of_changes]

    def precondition(self, x: Vector) -> Vector:
        number = len(self._sample)
        filters = [part / diagonal for part, diagonal in zip(x[:number], self._diagonal, strict=True)]
        return [*filters, *(change / self._projection_diagonal for change in x[number:])]

    def right_side(self) -> Vector:
        gradients = self._projection_gradients(self._label)
        of_changes = [
            gradient - self._penalty * projection
            for gradient, projection in zip(gradients, self._projections, strict=True)
        ]
        return [*correlate_samples(self._projected, self._label[None]), *of_changes]

    def _projection_gradients(self, score: Spectrum) -> list[FloatArray]:
        """For each channel z_c and filter g_d the inner product of their product with a score."""
        gradients = []
        for sample, filters in zip(self._sample, self._filters, strict=True):
            products = filters * np.conj(cropped(score, sample.shape[-1] - 1))
            # Columns of positive frequency stand for those of negative frequency, too.
            products[..., 1:] *= 2
            gradient = np.zeros((len(sample), len(filters)), np.float32)
            _add_real_products(sample, products, gradient)
            gradients.append(gradient)
        return gradients


@njit(cache=True, nogil=True)
def _add_real_products(
    channels: npt.NDArray[np.complex64], others: npt.NDArray[np.complex64], sums: npt.NDArray[np.float32]
) -> None:
    """Add the real part of the sum of products of each of the channels with each of the others."""
    _, rows, columns = channels.shape
    for c in range(len(channels)):
        for d in range(len(others)):
            total = 0.0
            for r in range(rows):
                for k in range(columns):
                    a, b = channels[c, r, k], others[d, r, k]
                    total += a.real * b.real - a.imag * b.imag
            sums[c, d] += total


def learn_first(
    sample: Spectra, projections: Projections, label: FloatArray, window: PenaltyWindow, config: EcoConfig
) -> tuple[Spectra, Projections]:
    """Filter and projection that suit the first sample, by Gauss-Newton steps from a filter of zero.

    Args:
        sample: spectra of all channels.
        projections: where to start from.
        label: the desired score.
        window: the penalty on the filter.
        config: how many steps, and the weights of the loss.
    """
    filters: Spectra = [
        np.zeros((projection.shape[1], *part.shape[1:]), np.complex64)
        for part, projection in zip(sample, projections, strict=True)
    ]
    for _ in range(config.first_gauss_newton):
        system = JointSystem(sample, filters, projections, label, window, config)
        start = [*filters, *(np.zeros_like(projection) for projection in projections)]
        solution, _ = solve(system, start, config.first_iterations)
        filters = solution[: len(filters)]
        projections = [
            projection + change for projection, change in zip(projections, solution[len(filters) :], strict=True)
        ]
    return filters, projections


class FilterLearner:
    """Keeps the filter up to date with the samples.

    Attributes:
        filters: spectra of the filter of each channel.
    """

    def __init__(self, filters: Spectra, label: FloatArray, window: PenaltyWindow, config: EcoConfig) -> None:
        self.filters = filters
        self._label = label
        self._window = window
        self._config = config
        self._momentum: Momentum | None = None

    def learn(self, space: SampleSpace, energy: list[FloatArray]) -> None:
        """A few iterations more on the samples as they are now, with the samples' mean energy."""
        system = FilterSystem(space, energy, self._label, self._window, self._config)
        forget = (1 - self._config.learning_rate) ** self._config.forgetting
        self.filters, self._momentum = solve(
            system, self.filters, self._config.train_iterations, self._momentum, forget
        )


def _penalised(gradient: Spectra, filters: Spectra, window: PenaltyWindow) -> Vector:
    return [part + window.apply_squared(channels) for part, channels in zip(gradient, filters, strict=True)]


def _diagonal(energy: list[FloatArray], window: PenaltyWindow, config: EcoConfig) -> list[FloatArray]:
    """About the diagonal of the normal equations: the samples' energy, partly that of all channels of a kind, and the
    penalty's."""
    of_data, of_window = config.precondition_data, config.precondition_window
    return [
        np.asarray(
            (1 - of_window) * (of_data * part + (1 - of_data) * part.mean(axis=0)) + of_window * window.energy,
            np.float32,
        )
        for part in energy
    ]
