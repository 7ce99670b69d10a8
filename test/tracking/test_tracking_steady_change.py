"""Rates of turning and growing."""

import math

import numpy as np
import pytest

from etd_ros.tracking.steady_change import AVERAGE_S, DECAY_S, TOLD_GAIN, SteadyChange


def test_noise_is_no_change():
    change, rng = SteadyChange(0.3), np.random.default_rng(0)
    believed = [change.learn(float(misfit), 0.005) for misfit in 0.01 * rng.choice([-1.0, 1.0], 200)]
    assert change.per_s == 0
    assert not any(believed)


def test_misfits_that_agree_become_a_rate_that_makes_up_for_them():
    change, angle_rad, turning_rad_s = SteadyChange(0.3), 0.0, 2.0
    for look in range(400):
        angle_rad += change.per_s * 0.005
        misfit = float(np.clip(turning_rad_s * 0.005 * (look + 1) - angle_rad, -0.025, 0.025))
        if change.learn(misfit, 0.005):
            angle_rad += 0.3 * misfit
    assert abs(turning_rad_s * 2.0 - angle_rad) < 0.03
    assert 1.5 < change.per_s < 2.1


def test_what_was_known_to_change_is_not_any_more_when_it_is_stopped():
    change = SteadyChange(0.3)
    while not change.learn(0.01, 0.005):
        pass
    assert change.per_s > 0
    change.stop()
    assert change.per_s == 0
    assert not change.learn(0.01, 0.005)


def test_what_something_else_than_looks_says_counts_at_once():
    change = SteadyChange(0.3)
    change.correct(-0.01)
    assert change.per_s == pytest.approx(-TOLD_GAIN * 0.01 / AVERAGE_S)


def test_noise_does_not_change_what_something_else_has_said():
    change, rng = SteadyChange(0.3), np.random.default_rng(0)
    change.correct(0.01)
    told = change.per_s
    believed = [change.learn(float(misfit), 0.005) for misfit in 0.01 * rng.choice([-1.0, 1.0], 200)]
    assert change.per_s == pytest.approx(told * math.exp(-200 * 0.005 / DECAY_S))
    assert not any(believed)


def test_looks_that_agree_change_what_something_else_has_said():
    change = SteadyChange(0.3)
    change.correct(-0.01)
    told = change.per_s
    believed = [change.learn(0.01, 0.005) for _ in range(40)]
    assert not believed[0]
    assert believed[-1]
    assert change.per_s > told / 2


def test_looks_that_know_a_change_go_on_telling_it_when_something_else_does():
    change = SteadyChange(0.3)
    while not change.learn(0.01, 0.005):
        pass
    change.correct(0.01)
    assert change.learn(0.01, 0.005)


@pytest.mark.parametrize("seed", range(5))
def test_noise_of_one_sign_is_no_change_where_a_part_that_it_is_made_of_has_none(seed):
    one, two, rng = SteadyChange(0.3), SteadyChange(0.3), np.random.default_rng(seed)
    for higher in rng.normal(0, 0.01, 200).tolist():
        # Narrower all the time; and lower, it seems, in half of the looks, which alone say that it has shrunk.
        wider, shrunk = -0.01, min(higher, 0.0)
        one.learn(shrunk, 0.005)
        two.learn(shrunk, 0.005, (wider, higher), parts_agree=True)
    assert one.per_s < -0.1
    assert two.per_s == 0


@pytest.mark.parametrize(("wider", "higher", "is_believed"), [(0.01, 0.01, True), (0.01, -0.01, False)])
def test_parts_have_to_agree_with_one_another(wider, higher, is_believed):
    change = SteadyChange(0.3)
    believed = [change.learn(0.01, 0.005, (wider, higher), parts_agree=True) for _ in range(40)]
    assert any(believed) == is_believed


def test_whether_parts_have_to_agree_may_change_from_look_to_look():
    change = SteadyChange(0.3)
    believed = [change.learn(0.01, 0.005, (0.01, -0.01), parts_agree=look % 2 == 0) for look in range(40)]
    assert believed.index(True) % 2 == 1
