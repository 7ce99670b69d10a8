"""Things at different depths, which a camera slides past."""

import numpy as np
import pytest

from etd_ros.simulation import shelf_scene, visible_shares
from etd_ros.simulation.shelf_scenes import DURATION_S, KINDS

SEEDS = range(10)
TIMES_S = np.arange(0, DURATION_S, 0.1)


def scene_of(seed: int):
    return shelf_scene(np.random.default_rng(seed))[0]


def test_a_generator_gives_one_scene_and_another_generator_another():
    (first, sensor), (again, sensor_again), (other, _) = (
        shelf_scene(np.random.default_rng(seed)) for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(first.render(0.2), again.render(0.2))
    assert sensor == sensor_again
    assert (first.render(0.2) != other.render(0.2)).any()


@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_changes_its_size_while_it_slides_past(seed):
    scene = scene_of(seed)
    for name in scene.targets:
        x, y, w, h = np.array([scene.box(name, time_s) for time_s in TIMES_S]).T
        assert np.ptp(w) == pytest.approx(0, abs=1e-9)
        assert np.ptp(h) == pytest.approx(0, abs=1e-9)
        assert np.hypot(np.ptp(x), np.ptp(y)) > 20


@pytest.mark.parametrize("seed", SEEDS)
def test_what_is_nearer_is_in_front_and_moves_farther_in_the_same_direction(seed):
    scene = scene_of(seed)
    nearness = np.array([sprite.nearness for sprite in scene.sprites])
    assert 3 <= len(nearness) <= 6
    assert (np.diff(nearness) >= 0).all()
    assert 1.1 <= nearness[0] <= nearness[-1] <= 4.5
    ways = np.diff(scene.placements([0, DURATION_S])[:, 1:, :2], axis=0)[0]
    np.testing.assert_allclose(ways / nearness[:, None], np.broadcast_to(ways[0] / nearness[0], ways.shape), atol=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_each_thing_is_on_the_sensor_at_some_time(seed):
    scene = scene_of(seed)
    assert all(visible_shares(scene, name, TIMES_S).on_sensor.max() > 0.5 for name in scene.targets)


def test_targets_are_named_by_what_they_are_and_where_they_stand_in_order():
    names = [name.rsplit("_", 1) for seed in range(40) for name in scene_of(seed).targets]
    assert {kind for kind, _ in names} == {kind.__name__ for kind in KINDS}
    assert [number for _, number in (name.rsplit("_", 1) for name in scene_of(0).targets)] == ["0", "1", "2", "3"]
