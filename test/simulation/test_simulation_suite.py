"""The fixed suite and random scenes: seeded, apart from each other, and as they are described."""

import dataclasses
import importlib.util
import types

import cv2
import numpy as np
import pytest

from etd_ros.events import concatenate
from etd_ros.simulation import (
    SUITE,
    Absence,
    Recipe,
    SimulationError,
    absent_times,
    make_scene,
    random_scene,
    random_sequence,
    sequence_named,
    visible_shares,
)
from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.photographs import photograph
from etd_ros.simulation.steps import step_times_us
from etd_ros.simulation.textures import BRIGHT, DARK
from etd_ros.simulation.things import KINDS, rim_seen


def event_bytes(sequence) -> bytes:
    recipe = dataclasses.replace(sequence.recipe, duration_s=0.05)
    short = dataclasses.replace(sequence, recipe=recipe)
    return concatenate(list(short.events())).to_structured().tobytes()


@pytest.mark.parametrize("name", ["ball", "pan", "mains"])
def test_a_seed_repeats_its_bytes_and_another_makes_others(name):
    sequence = SUITE[name]
    assert event_bytes(sequence) == event_bytes(sequence)
    assert event_bytes(sequence) != event_bytes(sequence.with_seed(5))


def test_the_suite_has_the_sensors_durations_and_numbers_of_targets_that_it_should():
    assert 24 <= len(SUITE) <= 40
    assert len({sequence.seed for sequence in SUITE.values()}) == len(SUITE)
    sizes = [(sequence.width, sequence.height) for sequence in SUITE.values()]
    assert sizes.count((640, 480)) >= 3
    assert sizes.count((1280, 720)) >= 2
    assert all(0.8 <= sequence.recipe.duration_s <= 2.5 for sequence in SUITE.values())
    targets = [sequence.recipe.targets for sequence in SUITE.values()]
    assert (min(targets), max(targets)) == (1, 20)


@pytest.mark.parametrize("name", SUITE)
def test_targets_of_the_suite_are_seen_at_their_start_and_hidden_as_their_recipe_says(name):
    sequence = SUITE[name]
    recipe, scene = sequence.recipe, sequence.scene()
    assert len(scene.targets) == recipe.targets
    for number, target in enumerate(scene.targets):
        assert visible_shares(scene, target, [0.1]).visible[0] > 0.5
        absences = absent_times(scene, target)
        occluded = [absence for absence in absences if absence.reason is Absence.OCCLUDED]
        if recipe.occlusion_s and number < 2:
            (hidden,) = occluded
            assert recipe.occlusion_s <= hidden.end_s - hidden.start_s <= 0.5
        assert any(absence.reason is Absence.LEFT for absence in absences) == (recipe.leaves_s > 0)


def test_sizes_are_those_of_the_recipe():
    scene = SUITE["huge"].scene()
    assert max(scene.box("irregular_1", 0.5)[2:]) == pytest.approx(200, abs=6)
    assert all(10 <= max(SUITE["tiny"].scene().box(name, 0.5)[2:]) <= 17 for name in ("ball_1", "panel_2"))


def test_speeds_are_those_of_the_recipe():
    scene = SUITE["whirl"].scene()
    x, y = scene.placements(np.arange(0, 0.8, 0.001))[:, 1, :2].T
    speeds = np.hypot(np.diff(x), np.diff(y)) / 0.001
    assert 3000 / 1.4 < np.sqrt((speeds**2).mean()) < 3000 * 1.4


@pytest.mark.parametrize("name", ["whirl", "creep", "pan", "zoom"])
def test_nothing_moves_farther_in_a_step_than_it_may(name):
    scene = SUITE[name].scene()
    times_us = step_times_us(scene, step_s=0.005, step_px=0.6)
    assert times_us[0] == 0
    assert times_us[-1] == round(scene.duration_s * 1e6)
    assert 0 < np.diff(times_us).min() <= np.diff(times_us).max() <= 5001
    corners = corners_of(scene, times_us / 1e6)
    assert np.hypot(*np.moveaxis(np.diff(corners, axis=0), -1, 0)).max() < 0.65


def corners_of(scene, times_s) -> np.ndarray:
    """Where the corners of the view and of the sprites are on the sensor, shape (times, things, 4, 2)."""
    sizes = [(scene.width, scene.height), *(sprite.texture.shape[::-1] for sprite in scene.sprites)]
    offsets = np.array([[(sx * w / 2, sy * h / 2) for sx in (-1, 1) for sy in (-1, 1)] for w, h in sizes])
    placements = scene.placements(times_s)
    turns = placements[..., 2] * np.exp(1j * placements[..., 3])
    points = turns[..., None] * (offsets[..., 0] + 1j * offsets[..., 1])
    return placements[:, :, None, :2] + np.stack([points.real, points.imag], axis=-1)


def test_steps_of_flickering_scenes_follow_the_flicker():
    assert np.diff(step_times_us(SUITE["mains"].scene(), step_s=0.005, step_px=0.6)).max() <= 1_000_000 / (12 * 100) + 1


def test_random_scenes_follow_their_seed_and_are_none_of_the_suite():
    first, again, other = (random_scene(seed) for seed in (3, 3, 4))
    assert np.array_equal(first.background, again.background)
    assert first.targets == again.targets
    assert [first.box(name, 0.5) for name in first.targets] == [again.box(name, 0.5) for name in again.targets]
    assert not np.array_equal(first.background, other.background)
    ball = SUITE["ball"]
    rng = np.random.default_rng([random_sequence(3).stream, ball.seed])
    twin = make_scene(ball.recipe, ball.width, ball.height, rng)
    assert not np.array_equal(twin.background, ball.scene().background)


@pytest.mark.parametrize("seed", range(12))
def test_random_sequences_can_be_simulated(seed):
    sequence = random_sequence(seed, duration_s=0.3)
    scene = sequence.scene()
    events = concatenate(list(sequence.events(scene)))
    events.check()
    assert (events.width, events.height) == (240, 180)
    assert all(scene.box(name, 0.1).w > 5 for name in scene.targets)


@pytest.mark.parametrize("kind", sorted(set(KINDS) - {"picture"}))
def test_things_are_as_large_as_they_should_be_and_reach_their_edges(kind):
    for size in (14, 61):
        texture, opacity = KINDS[kind](np.random.default_rng(size), size)
        assert texture.shape == opacity.shape
        assert size - 1 <= max(texture.shape) <= size + 1
        assert texture.min() > 0
        rows, columns = np.nonzero(opacity > 0.5)
        assert np.ptp(rows) + 1 >= texture.shape[0] - 2
        assert np.ptp(columns) + 1 >= texture.shape[1] - 2


@pytest.mark.parametrize("name", sorted(set(BACKGROUNDS) - {"photo"}))
def test_backgrounds_have_their_shape_and_follow_their_seed(name):
    first, again = (BACKGROUNDS[name](np.random.default_rng(2), 60, 90) for _ in range(2))
    assert first.shape == (60, 90)
    assert first.min() > 0
    assert np.array_equal(first, again)
    assert first.std() > 0.01


def test_the_fixed_suite_needs_no_photographs():
    assert all(sequence.recipe.background != "photo" for sequence in SUITE.values())
    assert all("picture" not in sequence.recipe.kinds for sequence in SUITE.values())


def test_photographs_are_read_from_the_installed_wheel_and_nowhere_else(monkeypatch, tmp_path):
    (tmp_path / "data").mkdir()
    ramp = np.tile(np.arange(250, dtype=np.uint8), (200, 1))
    assert cv2.imwrite(str(tmp_path / "data" / "camera.png"), ramp)
    wheel = types.SimpleNamespace(submodule_search_locations=[str(tmp_path)])
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: wheel if name == "skimage" else None)
    image = photograph(np.random.default_rng(3), 50, 80)
    assert image.shape == (50, 80)
    assert DARK <= image.min() < image.max() <= BRIGHT
    steps = np.diff(image, axis=1)
    assert (steps >= 0).all() or (steps <= 0).all()
    scene = make_scene(Recipe(("picture",), "photo"), 64, 48, np.random.default_rng(1))
    assert scene.background.shape == (48, 64)


def test_photographs_without_scikit_image_are_refused_with_the_cure(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(SimulationError, match="pip install scikit-image"):
        make_scene(Recipe(("ball",), "photo"), 64, 48, np.random.default_rng(1))


def test_unknown_names_are_refused_with_the_known_ones():
    with pytest.raises(SimulationError, match="unknown sequence 'moon': choose one of ball"):
        sequence_named("moon")
    with pytest.raises(SimulationError, match="unknown 'moon' in a recipe: choose one of wall"):
        Recipe(("ball",), "moon")


def test_the_rim_of_a_thing_is_seen_where_it_is_brighter_or_darker_than_the_ground():
    texture = np.full((20, 20), 0.5)
    texture[:, :10] = 1.0
    opacity = np.ones((20, 20))
    assert rim_seen((texture, opacity), np.log(0.5), 0.3) == pytest.approx(0.5)
    assert rim_seen((texture, opacity), np.log(0.7), 0.3) == 1.0
    assert rim_seen((texture, opacity), np.log(0.7), 0.4) == 0.0
    texture[5:15, 5:15] = 0.1
    assert rim_seen((texture, opacity), np.log(0.7), 0.4) == 0.0
