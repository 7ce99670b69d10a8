"""What moves round a start box is the target where little else does."""

import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.tracking.surface import TimeSurface
from etd_ros.tracking.surroundings import EVENTS_MAX, Surroundings

WIDTH, HEIGHT, START_NS, FRAME_NS = 120, 90, 5_000_000_000, 1_000_000
BOX = Box(50, 35, 20, 20)


def seen(places_of, frames=20):
    """Surroundings and the time (s) after frames of 1 ms; `places_of` gives a frame's event pixels at a time (s)."""
    surface = TimeSurface(WIDTH, HEIGHT)
    surroundings = Surroundings(BOX, START_NS)
    for number in range(1, frames + 1):
        data = np.zeros((HEIGHT, WIDTH, 2), np.uint8)
        columns, rows = places_of(number * FRAME_NS * 1e-9)
        data[rows, columns, number % 2] = 255
        surface.take(START_NS + number * FRAME_NS, data, START_NS + (number - 1) * FRAME_NS)
        surroundings.take(surface)
    return surroundings, frames * FRAME_NS * 1e-9


def ring_at(x, y):
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    return (x + 9 * np.cos(angles)).astype(int), (y + 9 * np.sin(angles)).astype(int)


@pytest.mark.parametrize("velocity", [(900.0, 0.0), (-600.0, 500.0)])
def test_what_has_left_its_box_is_held_at_its_own_velocity(velocity):
    x, y = BOX.center
    surroundings, time_s = seen(lambda at_s: ring_at(x + velocity[0] * at_s, y + velocity[1] * at_s))
    offered = surroundings.velocities(np.zeros(2), time_s)
    assert min(np.hypot(*(each - velocity)) for each in offered) * time_s < 2.0
    # A velocity brings the box to within its margin of where the thing is.
    assert all(np.abs(each - velocity).max() * time_s < BOX.w / 2 for each in offered)


def test_what_is_still_in_its_box_is_offered_no_other_velocity():
    surroundings, time_s = seen(lambda at_s: ring_at(*BOX.center))
    assert surroundings.velocities(np.zeros(2), time_s) == []


def test_a_velocity_that_holds_it_already_is_not_doubted():
    x, y = BOX.center
    surroundings, time_s = seen(lambda at_s: ring_at(x + 900 * at_s, y))
    assert surroundings.velocities(np.array([900.0, 0.0]), time_s) == []


def test_where_all_round_it_moves_no_velocity_is_offered():
    rng = np.random.default_rng(0)
    surroundings, time_s = seen(lambda _: (rng.integers(0, WIDTH, 200), rng.integers(0, HEIGHT, 200)))
    assert surroundings.velocities(np.zeros(2), time_s) == []


def test_two_things_on_both_sides_offer_no_velocity():
    x, y = BOX.center

    def both(at_s):
        ahead, behind = ring_at(x + 900 * at_s, y), ring_at(x - 900 * at_s, y)
        return tuple(np.concatenate(pair) for pair in zip(ahead, behind, strict=True))

    surroundings, time_s = seen(both)
    assert surroundings.velocities(np.zeros(2), time_s) == []


def test_events_without_end_are_not_kept_without_end():
    rows, columns = (part.ravel() for part in np.mgrid[:HEIGHT, :WIDTH])
    surroundings, time_s = seen(lambda _: (columns, rows))
    assert EVENTS_MAX < len(surroundings.events) < EVENTS_MAX + 3600 * 2
    assert surroundings.velocities(np.zeros(2), time_s) == []


def test_at_the_corner_of_the_sensor_the_box_is_clipped_and_nothing_is_offered_of_nothing():
    surface = TimeSurface(WIDTH, HEIGHT)
    surroundings = Surroundings(Box(-5, -5, 20, 20), START_NS)
    surface.take(START_NS + FRAME_NS, np.zeros((HEIGHT, WIDTH, 2), np.uint8), START_NS)
    surroundings.take(surface)
    assert len(surroundings.events) == 0
    assert surroundings.velocities(np.zeros(2), 0.001) == []
