"""The filter of a point at nearly constant velocity."""

from __future__ import annotations

import numpy as np
import pytest

from etd_ros.systems.kalman import MEASUREMENT_VARIANCE, corrected, first_estimate, predicted

PROCESS = np.diag([0.01, 0.01, 7.0, 7.0])
MEASUREMENT = np.diag([MEASUREMENT_VARIANCE] * 2)


def transition(step_s):
    return np.array([[1, 0, step_s, 0], [0, 1, 0, step_s], [0, 0, 1, 0], [0, 0, 0, 1]], float)


def most_probable_states(first, steps_s, measured):
    """All states at once, by weighted least squares over the whole path: what a Kalman filter's last state equals."""
    count = len(measured) + 1
    rows, values = [], []

    def add(blocks, value, covariance):
        root = np.linalg.cholesky(np.linalg.inv(covariance)).T
        row = np.zeros((len(value), 4 * count))
        for index, block in blocks:
            row[:, 4 * index : 4 * index + 4] = block
        rows.append(root @ row)
        values.append(root @ value)

    add([(0, np.eye(4))], first.mean, first.covariance)
    for index, (step_s, position) in enumerate(zip(steps_s, measured, strict=True), 1):
        add([(index - 1, -transition(step_s)), (index, np.eye(4))], np.zeros(4), PROCESS)
        add([(index, np.eye(2, 4))], position, MEASUREMENT)
    return np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0].reshape(count, 4)


@pytest.mark.parametrize("seed", range(3))
def test_the_last_estimate_is_the_most_probable_state_of_the_whole_path(seed):
    rng = np.random.default_rng(seed)
    steps_s, measured = rng.uniform(0.001, 0.2, 12), rng.uniform(0, 50, (12, 2))
    first = estimate = first_estimate((10.0, 20.0), (30.0, -5.0))
    for step_s, position in zip(steps_s, measured, strict=True):
        estimate = corrected(predicted(estimate, step_s), tuple(position))
    expected = most_probable_states(first, steps_s, measured)[-1]
    np.testing.assert_allclose(estimate.mean, expected, rtol=1e-6)


def test_a_steady_motion_is_learnt_and_foretold():
    estimate = first_estimate((0.0, 0.0), (0.0, 0.0))
    for number in range(1, 400):
        estimate = corrected(predicted(estimate, 0.01), (3.0 * number, -1.0 * number))
    assert predicted(estimate, 0.01).position == pytest.approx((1200, -400), abs=0.01)
    assert estimate.mean[2:] == pytest.approx([300, -100], abs=0.5)


def test_without_measurements_the_estimate_grows_less_sure():
    estimate = first_estimate((0.0, 0.0), (10.0, 0.0))
    later = predicted(predicted(estimate, 0.1), 0.1)
    assert later.position == pytest.approx((2.0, 0.0))
    assert (np.diag(later.covariance) > np.diag(estimate.covariance)).all()
