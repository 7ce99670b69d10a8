"""Motions with which events agree, of events whose motion is known."""

import numpy as np
import pytest

from etd_ros.tracking.coherent_motions import CoherentMotions, Motion
from etd_ros.tracking.turning import Turned

POSE = np.array([60.0, 50.0, 1.0, 0.0])
SIZE = (40.0, 30.0)
TIME_S = 0.04
AT_REST = np.zeros(2)


def motions():
    return CoherentMotions(POSE, SIZE, 1.0)


def events_of(velocity, *, turning_rad_s=0.0, count=600, span=0.9, seed=4):
    """Those of some pixels of a box that fire again and again as they move, and turn round its middle."""
    rng = np.random.default_rng(seed)
    texture = rng.uniform(-0.5, 0.5, (40, 2)) * np.multiply(span, SIZE)
    which, times_s = rng.integers(0, len(texture), count), rng.uniform(0, TIME_S, count)
    cos, sin = np.cos(turning_rad_s * times_s), np.sin(turning_rad_s * times_s)
    x, y = texture[which].T
    places = POSE[:2] + np.outer(times_s, velocity) + np.stack([cos * x - sin * y, sin * x + cos * y], axis=1)
    return np.column_stack([places, -times_s, np.where(which % 2, 1.0, -1.0)]).astype(np.float32)


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (25.0, -20.0)])
def test_the_motion_near_the_one_so_far_is_found(velocity):
    found = motions().near(events_of(velocity), TIME_S, AT_REST)
    assert np.hypot(*(found.velocity - velocity)) * TIME_S < 0.4
    assert found.alike > 0.5


def test_what_is_climbed_to_agrees_as_it_does_by_itself():
    events = events_of((25.0, -20.0))
    found = motions().near(events, TIME_S, AT_REST)
    alone = motions().best_of(events, TIME_S, found.velocity[None])
    assert (found.agreement, found.alike) == pytest.approx((alone.agreement, alone.alike), rel=1e-6)


def test_a_fast_motion_is_found_farther_off_alone():
    velocity, events = np.array([150.0, 0.0]), events_of((150.0, 0.0))
    near = motions().near(events, TIME_S, AT_REST)
    found = motions().farther_off(events, TIME_S, AT_REST, near)
    assert np.hypot(*(near.velocity - velocity)) * TIME_S > 2
    assert np.hypot(*(found.velocity - velocity)) * TIME_S < 0.4
    assert found.is_clearly_better(near, ((0.7, 1.1),))


def test_the_best_near_by_stays_where_nothing_farther_off_is_better():
    events = events_of(AT_REST)
    near = motions().near(events, TIME_S, AT_REST)
    assert motions().farther_off(events, TIME_S, AT_REST, near) is near


def test_the_best_of_some_velocities_is_that_of_the_events():
    velocities = np.array([(0.0, 0.0), (50.0, 0.0), (100.0, 0.0)])
    assert motions().best_of(events_of((50.0, 0.0)), TIME_S, velocities).velocity.tolist() == [50.0, 0.0]


def test_the_best_motion_in_a_direction_is_found_though_another_was_believed():
    direction = np.array([0.8, 0.6])
    found = motions().along(events_of(100.0 * direction), TIME_S, np.array([60.0, 20.0]), direction)
    np.testing.assert_allclose(found.velocity / np.hypot(*found.velocity), direction)
    assert np.hypot(*(found.velocity - 100.0 * direction)) * TIME_S < 0.4


def test_events_of_what_turns_agree_if_it_has_turned():
    events = events_of((30.0, 0.0), turning_rad_s=6.0)
    along, turned = (
        motions().agreement_if(Turned(np.array([30.0, 0.0]), rate, 0.0), events, TIME_S) for rate in (0.0, 6.0)
    )
    assert turned > 1.05 * along


def test_a_target_is_told_apart_from_the_ring_round_it():
    own = events_of((50.0, 0.0), count=500, span=0.6)
    behind = events_of((25.0, 0.0), count=900, span=1.4, seed=5)
    events = np.concatenate([own, behind])
    together = motions().near(events, TIME_S, np.array([40.0, 0.0])).velocity
    apart = motions().told_apart(events, TIME_S, together)
    assert abs(apart[0] - 50) < abs(together[0] - 50)


def of_target_and_behind(own, behind):
    """Events of a small target, and three times as many of what moves as one round and behind it."""
    return events_of(own, count=400, span=0.6), events_of(behind, count=1200, span=1.6, seed=5)


def test_a_target_is_told_from_what_moves_otherwise_round_it_though_that_was_believed():
    own, behind = np.array([-60.0, 40.0]), np.array([120.0, 0.0])
    events = np.concatenate(of_target_and_behind(own, behind))
    apart = motions().apart_from(behind, events, TIME_S, behind)
    assert np.hypot(*(apart.velocity - own)) * TIME_S < 0.7


def test_events_of_what_lies_behind_are_not_those_of_a_target_that_moves_otherwise():
    own, behind = np.array([-60.0, 40.0]), np.array([120.0, 0.0])
    of_target, of_others = of_target_and_behind(own, behind)
    apart = motions().apart_from(behind, np.concatenate([of_target, of_others]), TIME_S, own)
    kept = set(map(tuple, apart.events))
    assert np.mean([tuple(event) in kept for event in of_target]) > 0.8
    assert np.mean([tuple(event) in kept for event in of_others]) < 0.3


def test_nothing_is_told_apart_that_moves_alike():
    behind = np.array([120.0, 0.0])
    events = np.concatenate(of_target_and_behind(behind, behind))
    assert motions().apart_from(behind, events, TIME_S, behind) is None


def test_what_agrees_best_at_the_border_of_what_is_tried_is_not_the_targets_motion():
    behind = np.array([120.0, 0.0])
    far = behind - np.array([330.0, 0.0])  # 13 pixels within the time: it would agree the better the farther off
    events = np.concatenate(of_target_and_behind(far, behind))
    assert motions().apart_from(behind, events, TIME_S, behind) is None


def test_nothing_is_told_from_a_ring_that_does_not_move_as_one():
    own = np.array([-60.0, 40.0])
    rng = np.random.default_rng(6)
    strewn = events_of(AT_REST, count=1200, span=1.6)
    strewn[:, :2] = POSE[:2] + rng.uniform(-0.8, 0.8, (1200, 2)) * SIZE
    events = np.concatenate([events_of(own, count=400, span=0.6), strewn])
    assert motions().apart_from(np.array([120.0, 0.0]), events, TIME_S, own) is None


@pytest.mark.parametrize(
    ("alike", "agreement", "is_better"), [(0.6, 1.6, True), (0.8, 1.2, True), (0.6, 1.4, False), (0.4, 9.0, False)]
)
def test_a_motion_is_believed_that_is_alike_enough_and_agrees_so_many_times_as_well(alike, agreement, is_better):
    near = Motion(AT_REST, 1.0, 0.2)
    assert Motion(AT_REST, agreement, alike).is_clearly_better(near, ((0.5, 1.5), (0.7, 1.1))) == is_better
