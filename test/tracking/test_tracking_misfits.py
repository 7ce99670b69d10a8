"""By how much scale and angle are off, whatever the score itself prefers."""

import numpy as np
import pytest

from etd_ros.tracking.cell_weights import WEIGHT_FADES, oval
from etd_ros.tracking.contour_drawing import learn, normalise, splat
from etd_ros.tracking.contour_kernels import MAPS, WEIGHT, arm_cells, measure_norms
from etd_ros.tracking.misfits import Misfits, Sight

SIDE = 40
WEIGHTS = oval(SIDE, SIDE, 30, 30, WEIGHT_FADES)
UPRIGHT = np.array([50.0, 50.0, 1.0, 0.0])
STILL = np.zeros(4)
TO_THE_RIGHT = np.array([4.0, 0.0, 0.0, 0.0])
DIRECTION = np.array([1.0, 0.0, 0.0, 0.0])


def points_at(places, polarity):
    """Points of x, y from the middle of the model, shape (n, 2)."""
    rows = np.zeros((len(places), 4), np.float32)
    rows[:, :2] = places + UPRIGHT[:2]
    rows[:, 3] = polarity
    return rows


def triangle(size=1.0, angle_rad=0.0):
    """Two slanted edges that meet at the top, and nothing below: what slides past to the right shows no more."""
    down = np.linspace(-10, 10, 41)
    edges = [np.stack([way * (down + 10) / 2, down], axis=1) for way in (-1, 1)]
    turn = np.array([[np.cos(angle_rad), -np.sin(angle_rad)], [np.sin(angle_rad), np.cos(angle_rad)]])
    return np.concatenate([points_at(size * edge @ turn.T, sign) for edge, sign in zip(edges, (1, -1), strict=True)])


def square(wide=1.0, high=1.0):
    """All four edges of a square, wider or higher."""
    along = np.linspace(-10, 10, 41)
    sides = [np.stack([np.full(41, way * 10.0), along], axis=1) for way in (-1, 1)]
    edges = [*sides, *(side[:, ::-1] for side in sides)]
    signs = (1, -1, 1, -1)
    return np.concatenate([points_at(edge * (wide, high), sign) for edge, sign in zip(edges, signs, strict=True)])


def clutter(seed):
    """Events of other things, all over the model."""
    rng = np.random.default_rng(seed)
    return points_at(rng.uniform(-19, 19, (150, 2)), rng.choice([-1, 1], 150))


def sight_of(*points):
    rows = np.concatenate(points)
    return Sight(rows, len(rows), UPRIGHT, STILL, TO_THE_RIGHT)


def drawing_of(sight):
    drawn = np.zeros((2, SIDE, SIDE), np.float32)
    splat(sight.points, sight.count, UPRIGHT, 1.0, STILL, drawn)
    normalise(drawn, np.zeros_like(drawn), WEIGHTS, 1.0)
    return drawn


def model_of(sight):
    maps = np.zeros((MAPS, SIDE, SIDE), np.float32)
    maps[WEIGHT] = WEIGHTS
    learn(maps, drawing_of(sight), DIRECTION, 1.0)
    norms = np.zeros((5, 5))
    measure_norms(maps, norms)
    return maps, norms


def misfits():
    return Misfits(WEIGHTS, arm_cells(SIDE, SIDE), 1.0, 0.5)


def seen_for_a_while(shape=triangle):
    """What has seen a shape among other things, where its model fits."""
    found = misfits()
    for look in range(60):
        sight = sight_of(shape(), clutter(look))
        found.learn_preferences(sight, drawing_of(sight), DIRECTION)
    return found


def is_off(found, shape=triangle, **now):
    """Mean misfits of scale and angle, of a model of the shape as it is by default."""
    model = model_of(sight_of(shape()))
    looks = [found.measure(sight_of(shape(**now), clutter(look)), *model) for look in range(60)]
    return np.mean([(look.scale, look.angle) for look in looks], axis=0)


def test_what_has_its_size_seems_too_large_among_other_things_until_it_is_known_what_the_score_prefers():
    before, after = (is_off(found)[0] for found in (misfits(), seen_for_a_while()))
    assert before < -0.003
    assert abs(after) < 0.4 * abs(before)


@pytest.mark.parametrize("size", [0.97, 1.03])
@pytest.mark.parametrize(("shape", "sides", "share"), [(triangle, ("size",), 0.15), (square, ("wide", "high"), 0.3)])
def test_another_size_is_found_by_its_sign(shape, sides, share, size):
    found = seen_for_a_while(shape)
    off = is_off(found, shape, **dict.fromkeys(sides, size))[0] - is_off(found, shape)[0]
    assert off / np.log(size) > share


@pytest.mark.parametrize("angle_rad", [-0.03, 0.03])
def test_another_angle_is_found(angle_rad):
    found = seen_for_a_while()
    off = is_off(found, angle_rad=angle_rad)[1] - is_off(found)[1]
    assert off == pytest.approx(angle_rad, rel=0.5)


def test_what_the_score_prefers_is_known_from_the_first_look_on():
    found, sight = misfits(), sight_of(triangle(), clutter(0))
    found.learn_preferences(sight, drawing_of(sight), DIRECTION)
    own = model_of(sight)
    assert found.measure(sight, *own) == pytest.approx((0, 0, 0), abs=1e-6)
    assert abs(misfits().measure(sight, *own).scale) > 1e-3


def test_misfits_are_half_a_step_at_most():
    for thing, larger in ((triangle(), triangle(size=1.2)), (square(), square(wide=1.2, high=1.2))):
        off = misfits().measure(sight_of(larger), *model_of(sight_of(thing)))
        assert off.scale == pytest.approx(0.02, rel=0, abs=1e-12)


@pytest.mark.parametrize("times", [0.97, 1.03])
def test_what_becomes_wider_or_narrower_alone_is_hardly_taken_to_have_grown(times):
    found, model = misfits(), model_of(sight_of(square()))
    found.learn_preferences(sight_of(square()), drawing_of(sight_of(square())), DIRECTION)
    grown = found.measure(sight_of(square(wide=times, high=times)), *model).scale
    stretched = found.measure(sight_of(square(wide=times)), *model).scale
    assert grown * np.log(times) > 0.3 * np.log(times) ** 2
    assert abs(stretched) < 0.4 * abs(grown)
