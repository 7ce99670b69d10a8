"""Which events at a target are its own, where what lies behind moves with it and then otherwise."""

import numpy as np
import pytest

from etd_ros.tracking.own_events import JOLT_NS, OwnEvents

POSE = (80.0, 60.0, 1.0, 0.0)
SIZE = (30.0, 24.0)
SPAN_S = 0.04
BEFORE, JOLTED = (50.0, 0.0), (50.0, -80.0)


def points_of(velocity, outer, pixels, count):
    """The events of some pixels within `outer` times the box, which fire again and again as they move."""
    rng = np.random.default_rng(1)
    places = rng.uniform(-outer / 2, outer / 2, (pixels, 2)) * SIZE
    which, ages_s = rng.integers(0, pixels, count), rng.uniform(0, SPAN_S, count)
    moved = POSE[:2] + places[which] + np.outer(SPAN_S / 2 - ages_s, velocity)
    return np.column_stack([moved, ages_s, np.where(which % 2, 1.0, -1.0)]).astype(np.float32)


TARGET = points_of(BEFORE, 0.8, 60, 500)
TOGETHER = np.concatenate([TARGET, points_of(BEFORE, 1.9, 250, 1000)])
APART = np.concatenate([TARGET, points_of(JOLTED, 1.9, 250, 1000)])


class Surface:
    """The same events whenever it is asked."""

    def __init__(self):
        self.stamp_ns, self.points_now = 0, TOGETHER

    def window(self, _box, _margin_px):
        return 0, 0, 0, 0

    def points(self, _window, _span_s):
        return self.points_now.copy(), len(self.points_now)


class Standing:
    """A target that goes on as before."""

    velocity, pose = BEFORE, POSE

    def predicted(self, _stamp_ns):
        return POSE[0], POSE[1]

    def box_at(self, *_place):
        return None


def look(own, surface):
    """How many events are kept."""
    own.see_backdrop(surface, Standing(), SPAN_S)
    points, count = surface.points(None, SPAN_S)
    return own.keep(points, count, np.array(POSE), BEFORE, SPAN_S, surface.stamp_ns)


@pytest.fixture
def jolted():
    """What a target and its surroundings are told by until events are left out, and the surface then."""
    own, surface = OwnEvents(SIZE, 1.0, 1.2, 10.0), Surface()
    for surface.stamp_ns in range(0, 300_000_000, 5_000_000):
        assert look(own, surface) == len(TOGETHER)
        assert not own.may_lack_some(surface.stamp_ns)
    surface.points_now = APART
    for surface.stamp_ns in range(300_000_000, 500_000_000, 5_000_000):
        if look(own, surface) < len(APART):
            return own, surface
    pytest.fail("what lies behind was not told from the target")


def test_events_that_are_left_out_as_the_camera_jolts_may_be_the_targets(jolted):
    own, surface = jolted
    assert own.may_lack_some(surface.stamp_ns)


def test_what_moves_otherwise_for_longer_is_something_else(jolted):
    own, surface = jolted
    surface.stamp_ns += JOLT_NS
    assert look(own, surface) < len(APART)
    assert not own.may_lack_some(surface.stamp_ns)


def test_the_events_of_what_lies_behind_are_kept_if_that_is_asked_for(jolted):
    own, surface = jolted
    own.takes_backdrop = True
    assert look(own, surface) == len(APART)
