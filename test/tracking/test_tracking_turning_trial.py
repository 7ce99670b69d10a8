"""What seems to turn is held against what it was before it did."""

from __future__ import annotations

import numpy as np
import pytest

from etd_ros.tracking.cell_weights import WEIGHT_FADES, oval
from etd_ros.tracking.contour_drawing import learn, normalise, splat
from etd_ros.tracking.contour_kernels import MAPS, WEIGHT, arm_cells, measure_norms
from etd_ros.tracking.misfits import Sight
from etd_ros.tracking.turning_trial import AVERAGE_S, TURNED_MAX_RAD, TurningTrial

SIDE = 40
WEIGHTS = oval(SIDE, SIDE, 14, 34, WEIGHT_FADES)
MIDDLE = np.array([50.0, 50.0])
TO_THE_RIGHT = np.array([4.0, 0.0, 0.0, 0.0])
LOOK_S = 0.005


def upright_thing(angle_rad=0.0):
    """Points of the two long edges of something that is higher than wide, turned."""
    down = np.linspace(-14, 14, 57)
    turn = np.array([[np.cos(angle_rad), -np.sin(angle_rad)], [np.sin(angle_rad), np.cos(angle_rad)]])
    rows = []
    for side, polarity in ((-4.0, 1.0), (4.0, -1.0)):
        places = np.stack([np.full(57, side), down], axis=1) @ turn.T + MIDDLE
        rows.append(np.column_stack([places, np.zeros(57), np.full(57, polarity)]))
    return np.concatenate(rows).astype(np.float32)


def sight_of(points, angle_rad):
    """Those points, as the model is taken to be turned."""
    return Sight(points, len(points), np.array([*MIDDLE, 1.0, angle_rad]), np.zeros(4), TO_THE_RIGHT.copy())


def trial(forgets=False):
    """Of what was upright, and begins to turn; the model may be another afterwards."""
    drawn = np.zeros((2, SIDE, SIDE), np.float32)
    before = sight_of(upright_thing(), 0.0)
    splat(before.points, before.count, before.pose, 1.0, before.velocity, drawn)
    normalise(drawn, np.zeros_like(drawn), WEIGHTS, 1.0)
    maps, norms = np.zeros((MAPS, SIDE, SIDE), np.float32), np.zeros((5, 5))
    maps[WEIGHT] = WEIGHTS
    learn(maps, drawn, TO_THE_RIGHT / 4, 1.0)
    measure_norms(maps, norms)
    made = TurningTrial(maps, norms, 0.0, arm_cells(SIDE, SIDE))
    if forgets:
        maps[:WEIGHT] = norms[:] = 0
    return made


def fails(found, sight, looks=9):
    """Whether one of so many looks says that it has not turned."""
    return any(found.fails(sight, 1.0, 0.5, LOOK_S) for _ in range(looks))


@pytest.mark.parametrize("angle_rad", [-0.3, 0.3])
def test_what_is_upright_still_has_not_turned(angle_rad):
    assert fails(trial(), sight_of(upright_thing(), angle_rad))


@pytest.mark.parametrize("angle_rad", [-0.3, 0.3])
def test_what_lies_where_the_turned_model_does_has_turned(angle_rad):
    assert not fails(trial(), sight_of(upright_thing(angle_rad), angle_rad))


def test_a_turn_too_small_to_be_told_is_let_pass():
    assert not fails(trial(), sight_of(upright_thing(), 0.02))


def test_what_turned_by_a_quarter_is_not_asked_any_more():
    assert not fails(trial(), sight_of(upright_thing(), TURNED_MAX_RAD + 0.01))


def test_a_few_looks_do_not_outweigh_those_of_a_while():
    found = trial()
    assert not fails(found, sight_of(upright_thing(0.3), 0.3), looks=round(2 * AVERAGE_S / LOOK_S))
    assert not fails(found, sight_of(upright_thing(), 0.3), looks=2)
    assert fails(found, sight_of(upright_thing(), 0.3), looks=round(4 * AVERAGE_S / LOOK_S))


def test_what_the_model_learns_afterwards_does_not_count():
    assert fails(trial(forgets=True), sight_of(upright_thing(), 0.3))
