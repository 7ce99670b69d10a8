"""Scenes to learn from: depth, twins, flawed sensors."""

from __future__ import annotations

import numpy as np
import pytest

from etd_ros.recovery.training.depth_scenes import depth_scene
from etd_ros.recovery.training.scenes import DURATION_S, random_situation, training_situation
from etd_ros.simulation import Scene
from etd_ros.simulation.motion import FloatArray

SEEDS = range(24)
TIMES_S = np.linspace(0, DURATION_S, 9)


def scene_in_depth(seed: int) -> Scene:
    return depth_scene(np.random.default_rng(seed), 240, 180, DURATION_S)


def ways(scene: Scene) -> FloatArray:
    """How far background and sprites have moved on the sensor when nothing zooms (pixels), shape (times, 1 + n, 2)."""
    assert scene.view is not None
    placed = scene.placements(TIMES_S)
    centre = np.array([scene.width / 2, scene.height / 2])
    at_rest = (placed[..., :2] - centre) / scene.view.poses(TIMES_S)[:, None, 2:3]
    return np.asarray(at_rest - at_rest[:1], np.float64)


def test_what_is_nearer_hides_what_is_farther_and_moves_more():
    for seed in SEEDS:
        scene = scene_in_depth(seed)
        nearness = [sprite.nearness for sprite in scene.sprites]
        assert nearness == sorted(nearness)
        moved = ways(scene)
        camera = moved[:, 1:] / np.array(nearness)[:, None]
        still = [np.ptp(sprite.path.poses(TIMES_S)[:, :2], axis=0).max() == 0 for sprite in scene.sprites]
        assert any(still)
        for index in np.flatnonzero(still[1:]) + 1:
            np.testing.assert_allclose(camera[:, index], camera[:, still.index(True)], atol=1e-6)


def test_some_scenes_have_a_pole_in_front_that_is_no_target():
    poles = [scene.sprites[-1] for scene in map(scene_in_depth, SEEDS) if scene.sprites[-1].name == "pole"]
    assert 4 < len(poles) < 16
    assert not any(pole.is_target for pole in poles)
    assert all(pole.opacity.shape[0] > 180 for pole in poles)


def test_a_seed_gives_one_situation():
    first, again = (training_situation(np.random.default_rng(7)) for _ in range(2))
    assert first.sensor == again.sensor
    assert first.reconstruction == again.reconstruction
    np.testing.assert_array_equal(first.scene.render(0.8), again.scene.render(0.8))


def test_half_of_the_situations_are_in_depth_and_half_of_the_sensors_are_flawed():
    situations = [training_situation(np.random.default_rng(seed)) for seed in range(60)]
    in_depth = sum(situation.scene.sprites[0].name.startswith("thing_") for situation in situations)
    hot = sum(situation.sensor.hot_pixels > 0 for situation in situations)
    leaking = sum(situation.sensor.leak_rate_hz > 0 for situation in situations)
    assert all(18 < count < 42 for count in (in_depth, hot, leaking))
    assert np.std([situation.sensor.threshold_bias for situation in situations]) == pytest.approx(0.2, rel=0.4)


def test_what_a_camera_films_is_seen_by_no_flawed_sensor():
    sensor = random_situation(np.random.default_rng(3)).sensor
    assert (sensor.hot_pixels, sensor.leak_rate_hz, sensor.threshold_bias) == (0, 0.0, 0.0)


def test_a_twin_wears_anothers_surface_turned_over_at_its_own_depth():
    twins = 0
    for seed in SEEDS:
        sprites = [s for s in training_situation(np.random.default_rng(seed)).scene.sprites if s.is_target]
        for index, sprite in enumerate(sprites):
            for other in sprites[:index]:
                turned = (np.s_[:, ::-1], np.s_[::-1, ::-1])
                if sprite.texture.shape == other.texture.shape and any(
                    np.array_equal(sprite.texture[way], other.texture) for way in turned
                ):
                    twins += 1
    assert 4 < twins < 20
