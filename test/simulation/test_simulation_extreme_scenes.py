"""Balls behind a net or hidden for a moment, and drones in the dark."""

import numpy as np
import pytest

from etd_ros.simulation import SimulationError, extreme_scene, visible_shares
from etd_ros.simulation.extreme_scenes import BEFORE_S, KINDS, TARGET, WANDERS_S, Flash

SEEDS = range(6)


def scene_of(kind: str, seed: int):
    return extreme_scene(np.random.default_rng(seed), kind)[0]


def shares_of(scene):
    """How much of the target a thing in front of it leaves, at times when it is wholly on the sensor, shape (n,)."""
    shares = visible_shares(scene, TARGET, np.linspace(BEFORE_S, scene.duration_s - 2 * BEFORE_S, 60))
    is_inside = shares.on_sensor > 0.95
    return shares.visible[is_inside] / shares.on_sensor[is_inside]


@pytest.mark.parametrize("kind", KINDS)
def test_a_generator_gives_one_scene_and_another_generator_another(kind):
    (first, sensor), (again, sensor_again), (other, _) = (
        extreme_scene(np.random.default_rng(seed), kind) for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(first.render(0.2), again.render(0.2))
    assert sensor == sensor_again
    assert (first.render(0.2) != other.render(0.2)).any()


@pytest.mark.parametrize("kind", KINDS)
def test_a_scene_has_one_target_and_is_dark_unless_there_is_a_net(kind):
    scene = scene_of(kind, 1)
    assert scene.targets == (TARGET,)
    assert (scene.dark > 0) == (kind != "net")
    assert isinstance(scene.flicker, Flash) == (kind == "flash")


@pytest.mark.parametrize("seed", SEEDS)
def test_a_net_hides_some_of_the_ball_all_the_time_and_never_most_of_it(seed):
    shares = shares_of(scene_of("net", seed))
    assert shares.max() < 0.97
    assert shares.min() > 0.5


@pytest.mark.parametrize("seed", SEEDS)
def test_a_ball_is_hidden_for_a_moment_and_wholly_seen_before_and_after_it(seed):
    shares = shares_of(scene_of("hidden", seed))
    hidden = np.flatnonzero(shares < 0.25)
    assert np.array_equal(hidden, np.arange(hidden[0], hidden[-1] + 1))
    assert shares[: hidden[0]].max() == pytest.approx(1, abs=0.02)
    assert shares[hidden[-1] :].max() == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("kind", ["net", "hidden"])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_ball_crosses_the_sensor(kind, seed):
    scene = scene_of(kind, seed)
    x = scene.placements([BEFORE_S, scene.duration_s - 2 * BEFORE_S])[:, 1, 0]
    assert abs(x[1] - x[0]) > 0.75 * scene.width
    assert 18 <= max(scene.sprites[0].texture.shape) <= 45


@pytest.mark.parametrize("kind", ["drone", "flash"])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_drone_is_small_and_stays_before_the_camera(kind, seed):
    scene = scene_of(kind, seed)
    assert scene.duration_s == WANDERS_S
    assert 13 <= max(scene.sprites[0].texture.shape) <= 33
    assert visible_shares(scene, TARGET, np.linspace(0, WANDERS_S, 40)).visible.min() > 0.9


def test_light_flashes_up_at_once_and_down_more_slowly_and_again():
    light = Flash(60.0, 0.5).at(np.array([0.09, 0.0985, 0.1, 0.1015, 0.2, 0.31]))
    assert light[[0, 4]] == pytest.approx(1, abs=0.001)
    assert light[[2, 5]] == pytest.approx(1.5)
    assert 1 < light[1] < light[3] < 1.5


def test_a_kind_that_there_is_not_is_refused_with_those_that_there_are():
    with pytest.raises(SimulationError, match=r"'fog'.*net, hidden, drone, flash"):
        scene_of("fog", 0)
