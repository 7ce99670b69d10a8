"""How a target usually moves, and which velocities are not its own."""

import math

import numpy as np
import pytest

from etd_ros.tracking.body import pair
from etd_ros.tracking.steady_motion import STEADY_S, SteadyMotion

STEP_S = 0.01
USUAL = (100.0, 0.0)


def off(px_s):
    return USUAL[0], USUAL[1] + px_s


def seen(duration_s, spread_px_s=0.0):
    rng = np.random.default_rng(1)
    motion = SteadyMotion()
    for _ in range(round(duration_s / STEP_S)):
        motion.learn(pair(USUAL + spread_px_s * rng.standard_normal(2)), STEP_S)
    return motion


def test_any_velocity_is_plausible_until_the_motion_is_known():
    assert seen(0.9 * STEADY_S).plausible((-500.0, 0.0)) == 1.0


@pytest.mark.parametrize(("off_px_s", "plausible"), [(7.9, 1.0), (16.0, 0.5), (80.0, 0.1)])
def test_a_velocity_is_plausible_by_how_far_it_could_be_from_the_mean(off_px_s, plausible):
    motion = seen(1.1 * STEADY_S)
    assert motion.plausible(off(off_px_s)) == pytest.approx(plausible)


def test_what_moves_unsteadily_may_stray_farther():
    assert seen(2 * STEADY_S, 10.0).plausible(off(30.0)) == 1.0


def test_one_stray_hardly_moves_the_mean_and_a_lasting_change_does():
    motion = seen(2 * STEADY_S)
    motion.learn(off(80.0), STEP_S)
    assert math.dist(motion.velocity, USUAL) < 0.3
    for _ in range(500):
        motion.learn(off(80.0), STEP_S)
    np.testing.assert_allclose(motion.velocity, off(80.0), atol=1.0)


def test_no_time_teaches_nothing():
    motion = SteadyMotion()
    motion.learn(USUAL, 0.0)
    assert motion.velocity == (0.0, 0.0)


def test_what_is_forgotten_is_not_known_any_more():
    motion = seen(2 * STEADY_S)
    motion.forget()
    assert motion.plausible((-USUAL[0], -USUAL[1])) == 1.0
