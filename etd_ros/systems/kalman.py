"""A Kalman filter for a point that moves at nearly constant velocity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

POSITION_VARIANCE, VELOCITY_VARIANCE = 0.01, 7.0
"""Process noise of a step, Q = diag(.01, .01, 7, 7) (pixels^2, (pixels/s)^2), of Barranco et al. 2018."""
MEASUREMENT_VARIANCE = 0.1
"""R = .1 I (pixels^2), from there too."""


@dataclass(frozen=True, slots=True)
class Gaussian:
    """What is known of the point: the mean of x, y, vx, vy, float64, shape (4,), and its covariance, shape (4, 4)."""

    mean: FloatArray
    covariance: FloatArray

    @property
    def position(self) -> tuple[float, float]:
        """x, y (pixels)."""
        return float(self.mean[0]), float(self.mean[1])


def first_estimate(position: tuple[float, float], velocity: tuple[float, float]) -> Gaussian:
    """Before the first step: measured positions (pixels), and a velocity (pixels/s) that may be off by the noise of one
    step."""
    variances = [MEASUREMENT_VARIANCE] * 2 + [VELOCITY_VARIANCE] * 2
    return Gaussian(np.array([*position, *velocity]), np.diag(variances))


def predicted(estimate: Gaussian, step_s: float) -> Gaussian:
    """The estimate some time (s) later: F P F' + Q, whose Q is that of a step however long it is."""
    transition = np.eye(4)
    transition[0, 2] = transition[1, 3] = step_s
    noise = np.diag([POSITION_VARIANCE] * 2 + [VELOCITY_VARIANCE] * 2)
    return Gaussian(transition @ estimate.mean, transition @ estimate.covariance @ transition.T + noise)


def corrected(estimate: Gaussian, measured: tuple[float, float]) -> Gaussian:
    """The estimate once a position (pixels) has been measured: K = P H' (H P H' + R)^-1, P <- (I - K H) P."""
    observation = np.eye(2, 4)
    innovation = np.array(measured) - observation @ estimate.mean
    spread = observation @ estimate.covariance @ observation.T + MEASUREMENT_VARIANCE * np.eye(2)
    gain = estimate.covariance @ observation.T @ np.linalg.inv(spread)
    covariance = (np.eye(4) - gain @ observation) @ estimate.covariance
    return Gaussian(estimate.mean + gain @ innovation, covariance)
