"""Events of what stands nearer or farther than something, before a camera that slides, are told from its own."""

import numpy as np
import pytest

from etd_ros.tracking.moving_alike import are_own

SIDE = 160
WINDOW_S = 0.1


def dots(velocity, seed):
    """Events of dots that move over the picture."""
    rng = np.random.default_rng(seed)
    places, ages = rng.uniform(0, SIDE, (120, 2)), rng.uniform(0, WINDOW_S, (120, 8)).astype(np.float32)
    x, y = (places[:, axis, None] - velocity[axis] * ages for axis in range(2))
    return np.stack([np.floor(x) + 0.5, np.floor(y) + 0.5, ages], axis=2).reshape(-1, 3).astype(np.float32)


@pytest.mark.parametrize("times", [0.4, 1.8, 2.5])
def test_what_goes_slower_or_faster_in_the_same_direction_is_not_its_own(times):
    velocity = (90.0, -40.0)
    own, other = dots(velocity, 0), dots((times * velocity[0], times * velocity[1]), 1)
    found = are_own(np.concatenate([own, other]), velocity, SIDE)
    assert found[: len(own)].mean() > 0.8
    assert found[len(own) :].mean() < 0.4


def test_no_events_are_nobodys():
    assert len(are_own(np.empty((0, 3), np.float32), (50.0, 0.0), SIDE)) == 0


def test_events_that_move_out_of_the_picture_are_taken_at_its_border():
    points = np.array([[1.0, 1.0, 0.1], [SIDE - 1.0, SIDE - 1.0, 0.1]], np.float32)
    assert are_own(points, (-500.0, 500.0), SIDE).shape == (2,)
