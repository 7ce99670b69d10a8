"""Something thrown, which crosses the sensor once."""

import dataclasses

import numpy as np
import pytest

from etd_ros.simulation import SensorConfig, thrown_scene, visible_shares
from etd_ros.simulation.thrown_scenes import BEFORE_S, SENSOR_SIZES

SEEDS = range(12)


def scene_and_sensor(seed: int, bandwidth_hz: float = 0.0):
    return thrown_scene(np.random.default_rng(seed), bandwidth_hz)


def test_a_generator_gives_one_scene_and_another_generator_another():
    (first, sensor), (again, sensor_again), (other, _) = (scene_and_sensor(seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.render(0.2), again.render(0.2))
    assert sensor == sensor_again
    assert (first.width, first.height) != (other.width, other.height) or (first.render(0.2) != other.render(0.2)).any()


def test_the_bandwidth_is_the_sensors_and_changes_nothing_else():
    (scene, endless), (late_scene, late) = scene_and_sensor(5), scene_and_sensor(5, 300.0)
    assert (endless.bandwidth_hz, late.bandwidth_hz) == (SensorConfig().bandwidth_hz, 300.0)
    assert dataclasses.replace(late, bandwidth_hz=endless.bandwidth_hz) == endless
    np.testing.assert_array_equal(scene.render(0.2), late_scene.render(0.2))


def test_sensors_and_cameras_are_of_all_kinds():
    scenes = [scene_and_sensor(seed)[0] for seed in range(20)]
    assert {(scene.width, scene.height) for scene in scenes} == set(SENSOR_SIZES)
    assert {scene.view is None for scene in scenes} == {True, False}


@pytest.mark.parametrize("seed", SEEDS)
def test_it_crosses_the_sensor_from_border_to_border_and_is_wholly_seen_between_them(seed):
    scene, _ = scene_and_sensor(seed)
    (name,) = scene.targets
    assert 0.1 <= scene.duration_s - 3 * BEFORE_S <= 0.9
    x = scene.placements([0, BEFORE_S, scene.duration_s - 2 * BEFORE_S, scene.duration_s])[:, 1, 0]
    off_centre = (x / scene.width - 0.5) * np.sign(x[-1] - x[0])
    assert off_centre[:2].max() < -0.4
    assert off_centre[2:].min() > 0.4
    shares = visible_shares(scene, name, np.linspace(0, scene.duration_s, 60)).on_sensor
    assert max(shares[0], shares[-1]) < 0.5
    assert shares.max() == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("seed", SEEDS)
def test_its_size_and_how_much_that_changes_are_within_the_limits(seed):
    scene, _ = scene_and_sensor(seed)
    assert 12 <= max(scene.sprites[0].texture.shape) <= 0.3 * scene.height + 1
    scales = scene.placements(np.linspace(BEFORE_S, scene.duration_s - 2 * BEFORE_S, 20))[:, 1, 2]
    assert 1 < scales.max() / scales.min() <= np.exp(0.7) + 0.01
    assert np.sqrt(scales[0] * scales[-1]) == pytest.approx(1, abs=0.01)
