"""What moves round a start box is the target where little else does."""

import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.tracking.other_targets import OtherBoxes
from etd_ros.tracking.surface import TimeSurface
from etd_ros.tracking.surroundings import BOX_MARGIN, STEPS, Surroundings, _held, _held_at_steps

WIDTH, HEIGHT, START_NS, FRAME_NS = 120, 90, 5_000_000_000, 1_000_000
BOX = Box(50, 35, 20, 20)


def seen(places_of, frames=20, box=BOX):
    """Surroundings and the time (s) after frames of 1 ms; `places_of` gives a frame's event pixels at a time (s)."""
    surface = TimeSurface(WIDTH, HEIGHT)
    surroundings = Surroundings(box, START_NS)
    for number in range(1, frames + 1):
        data = np.zeros((HEIGHT, WIDTH, 2), np.uint8)
        columns, rows = places_of(number * FRAME_NS * 1e-9)
        data[rows, columns, number % 2] = 255
        surface.take(START_NS + number * FRAME_NS, data, START_NS + (number - 1) * FRAME_NS)
        surroundings.take(surface, OtherBoxes())
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
    assert len(surroundings.velocities(np.zeros(2), time_s)) == 0


def test_a_velocity_that_holds_it_already_is_not_doubted():
    x, y = BOX.center
    surroundings, time_s = seen(lambda at_s: ring_at(x + 900 * at_s, y))
    assert len(surroundings.velocities(np.array([900.0, 0.0]), time_s)) == 0


def test_where_all_round_it_moves_no_velocity_is_offered():
    rng = np.random.default_rng(0)
    surroundings, time_s = seen(lambda _: (rng.integers(0, WIDTH, 200), rng.integers(0, HEIGHT, 200)))
    assert len(surroundings.velocities(np.zeros(2), time_s)) == 0


def test_two_things_on_both_sides_offer_no_velocity():
    x, y = BOX.center

    def both(at_s):
        ahead, behind = ring_at(x + 900 * at_s, y), ring_at(x - 900 * at_s, y)
        return tuple(np.concatenate(pair) for pair in zip(ahead, behind, strict=True))

    surroundings, time_s = seen(both)
    assert len(surroundings.velocities(np.zeros(2), time_s)) == 0


def test_of_events_without_end_none_are_kept():
    rows, columns = (part.ravel() for part in np.mgrid[:HEIGHT, :WIDTH])
    surroundings, time_s = seen(lambda _: (columns, rows))
    assert len(surroundings.events) == 0
    assert len(surroundings.velocities(np.zeros(2), time_s)) == 0


def test_what_leaves_along_the_border_is_held_at_its_own_velocity():
    box = Box(-4, 60, 20, 20)

    def part_on_sensor(at_s):
        columns, rows = ring_at(box.center[0], box.center[1] - 900 * at_s)
        return columns[columns >= 0], rows[columns >= 0]

    surroundings, time_s = seen(part_on_sensor, box=box)
    offered = surroundings.velocities(np.zeros(2), time_s)
    assert min(np.hypot(*(each - (0.0, -900.0))) for each in offered) * time_s < 2.0


def test_of_a_box_that_fills_its_surroundings_nothing_is_offered():
    def corner(at_s):
        return np.full(24, 2 + int(200 * at_s)), np.arange(24) * 3

    surroundings, time_s = seen(corner, box=Box(1, 1, WIDTH - 2, HEIGHT - 2))
    assert len(surroundings.velocities(np.array([9000.0, 0.0]), time_s)) == 0


def test_what_is_held_at_every_step_of_the_velocity_is_counted_event_by_event():
    rng = np.random.default_rng(0)
    events = rng.uniform((0, 0, -0.02, -1), (WIDTH, HEIGHT, 0, 1), (300, 4)).astype(np.float32)
    box, step_px_s = np.array([*BOX.center, BOX.w, BOX.h]), np.array([150.0, 90.0])
    held = _held_at_steps(events, box, step_px_s)
    since_s = -events[:, 2].astype(np.float64)
    for down, right in np.ndindex(held.shape):
        velocity = (np.array([right, down]) - STEPS) * step_px_s
        off_px = np.abs(events[:, :2] - box[:2] - velocity * since_s[:, None])
        expected = np.count_nonzero((off_px <= box[2:] / 2 * BOX_MARGIN).all(axis=1))
        assert held[down, right] == expected == _held(events, box, *velocity)
