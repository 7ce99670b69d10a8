"""How the picture moves near a point is told from most of the edges there."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.tracking.local_motion import (
    ALL_ALIKE,
    FITS,
    FOLLOWED_MIN_S,
    SPAN_S,
    STRAY_PX_S,
    STRAY_SHARE,
    followed_s,
    velocity_near,
    velocity_of_most,
)
from etd_ros.tracking.recent_events import RecentEvents

WIDTH, HEIGHT = 160, 120
STEP_NS, STEPS = 500_000, 400


def discs(*moving, width=WIDTH, height=HEIGHT):
    """The last times of the pixels that the edges of discs have passed: (middle now, radius, velocity) of each."""
    events = RecentEvents(width, height)
    events.stamp_ns = STEPS * STEP_NS
    y, x = np.mgrid[:height, :width] + 0.5
    for step in range(STEPS + 1):
        age_s = (STEPS - step) * STEP_NS * 1e-9
        for middle, radius, velocity in moving:
            r = np.hypot(x - middle[0] + velocity[0] * age_s, y - middle[1] + velocity[1] * age_s)
            events.times_of_each[np.abs(r - radius) < 0.5, 0] = step * STEP_NS
    return events


@pytest.mark.parametrize("velocity", [(40.0, -20.0), (-90.0, 60.0), (0.0, 130.0), (400.0, 100.0)])
def test_the_velocity_near_a_point_is_found(velocity):
    found = velocity_near(discs(((80.0, 60.0), 18.0, velocity)), 80.0, 60.0)
    assert np.hypot(*np.subtract(found, velocity)) < 0.15 * np.hypot(*velocity)


def test_it_is_that_of_what_is_nearer_to_the_point():
    events = discs(((55.0, 60.0), 15.0, (60.0, 0.0)), ((115.0, 60.0), 15.0, (150.0, 0.0)))
    assert velocity_near(events, 55.0, 60.0)[0] == pytest.approx(60.0, rel=0.2)
    assert velocity_near(events, 115.0, 60.0)[0] == pytest.approx(150.0, rel=0.2)


def test_in_the_middle_of_something_large_and_plain_its_far_edges_tell():
    events = discs(((200.0, 150.0), 90.0, (80.0, 30.0)), width=400, height=300)
    assert velocity_near(events, 200.0, 150.0) == pytest.approx((80.0, 30.0), rel=0.2, abs=3.0)


def test_hardly_any_events_have_no_motion():
    assert velocity_near(RecentEvents(WIDTH, HEIGHT), 80.0, 60.0) is None
    assert velocity_near(RecentEvents(1, 1), 0.5, 0.5) is None


def test_events_are_followed_for_as_long_as_their_way_is_short():
    assert followed_s((0.0, 0.0)) == SPAN_S
    assert followed_s((3000.0, 0.0)) == FOLLOWED_MIN_S
    assert followed_s((60.0, -80.0)) == pytest.approx(0.1)


def most_plainly(flows, weights, tried):
    """The same in NumPy."""

    def strays(velocity):
        speeds = flows[:, :2] @ velocity
        usual = STRAY_PX_S + STRAY_SHARE * np.abs(speeds)
        return (flows[:, 2] - speeds) / usual, usual

    velocity = max(tried, key=lambda each: (weights / (1 + strays(each)[0] ** 2) ** 2).sum())
    for _ in range(FITS):
        stray, usual = strays(velocity)
        root = np.sqrt(weights) / ((1 + stray**2) * usual)
        rows = flows[:, :2] * root[:, None]
        squares = rows.T @ rows
        if np.linalg.det(squares) <= ALL_ALIKE * np.trace(squares) ** 2:
            break
        velocity = np.linalg.solve(squares, rows.T @ (flows[:, 2] * root))
    return velocity


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000), st.sampled_from([3, 40]))
def test_the_velocity_of_most_is_that_of_plain_sums(seed, number):
    rng = np.random.default_rng(seed)
    angles = rng.uniform(0, 2 * np.pi, number)
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    own = rng.normal(0, 100, 2)
    flows = np.column_stack([normals, np.abs(normals @ own) + rng.normal(0, 20, number), np.zeros((number, 2))])
    weights, tried = rng.uniform(0.1, 1, number), rng.normal(0, 100, (30, 2))
    assert velocity_of_most(flows, weights, tried) == pytest.approx(most_plainly(flows, weights, tried), rel=1e-5)


def test_edges_that_all_lie_alike_leave_the_best_that_was_tried():
    flows = np.tile([1.0, 0.0, 50.0, 0.0, 0.0], (30, 1))
    tried = np.array([[0.0, 0.0], [48.0, 7.0], [90.0, 0.0]])
    assert velocity_of_most(flows, np.ones(30), tried) == (48.0, 7.0)
