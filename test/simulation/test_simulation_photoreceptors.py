"""Pixels that follow the light late, against the closed form of a first-order low pass."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from etd_ros.events import Events, concatenate
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite, Waypoint, simulate
from etd_ros.simulation.photoreceptors import Photoreceptors
from etd_ros.simulation.steps import step_times_us

HEIGHT, WIDTH = 20, 40
BANDWIDTH_HZ = 100.0
QUIET = SensorConfig(threshold_spread=0.0, refractory_s=0.0, noise_rate_hz=0.0, step_s=0.0005)


@pytest.mark.parametrize(("intensity", "share"), [(1.0, 1.0), (0.4, 0.4), (0.02, 0.1), (1.5, 1.0)])
def test_a_pixel_follows_a_step_of_light_exponentially_and_slower_where_it_is_dark(intensity, share):
    dark = np.zeros((HEIGHT, WIDTH))
    receptors = Photoreceptors(dark, BANDWIDTH_HZ)
    light = dark.copy()
    light[3, 5] = math.log(intensity)
    for step in range(1, 6):
        receptors.advance(light, light, only_square(receptors, 0, 0, step == 1), 0.0004)
        left = math.exp(-2 * math.pi * BANDWIDTH_HZ * share * 0.0004 * step)
        assert receptors.after[3, 5] == pytest.approx(math.log(intensity) * (1 - left))
    assert not np.delete(receptors.after.ravel(), 3 * WIDTH + 5).any()


@pytest.mark.parametrize("steps", [1, 7])
def test_a_pixel_is_late_behind_light_that_changes_evenly_however_long_the_steps_are(steps):
    light = np.zeros((HEIGHT, WIDTH))
    receptors = Photoreceptors(light, BANDWIDTH_HZ)
    duration_s, change = 0.007, 0.5
    for _ in range(steps):
        before, light = light, light.copy()
        light[3, 5] += change / steps
        receptors.advance(before, light, only_square(receptors, 0, 0), duration_s / steps)
    constant_s = 1 / (2 * math.pi * BANDWIDTH_HZ)
    late_s = constant_s * (1 - math.exp(-duration_s / constant_s))
    assert receptors.after[3, 5] == pytest.approx(change * (1 - late_s / duration_s))


@pytest.mark.parametrize(("first", "last"), [(0.1, 0.9), (0.9, 0.1), (0.3, 0.8)])
def test_light_that_changes_within_a_time_constant_is_followed_nearly_the_same_in_one_step_as_in_many(first, last):
    def after(steps):
        lights = np.linspace(math.log(first), math.log(last), steps + 1)
        receptors = Photoreceptors(np.full((HEIGHT, WIDTH), lights[0]), BANDWIDTH_HZ)
        duration_s = 0.5 / (2 * math.pi * BANDWIDTH_HZ)
        for before, light in itertools.pairwise(lights):
            frames = (np.full((HEIGHT, WIDTH), value) for value in (before, light))
            receptors.advance(*frames, np.ones_like(receptors.changed), duration_s / steps)
        return receptors.after[3, 5] - lights[0]

    assert after(1) == pytest.approx(after(100), abs=0.05 * abs(math.log(last / first)))


def test_squares_change_until_all_of_their_pixels_have_arrived():
    dark = np.zeros((HEIGHT, WIDTH))
    receptors = Photoreceptors(dark, BANDWIDTH_HZ)
    light = dark.copy()
    light[17, 39] = -1.0
    steps = 0
    while receptors.changed.any() or steps == 0:
        receptors.advance(light, light, only_square(receptors, 1, 2, steps == 0), 0.001)
        assert not np.delete(receptors.changed.ravel(), 5).any()
        steps += 1
    arrives = math.log(1000) / (2 * math.pi * BANDWIDTH_HZ * math.exp(-1) * 0.001)
    assert steps == pytest.approx(arrives, abs=2)
    assert receptors.after[17, 39] == pytest.approx(-1.0, abs=2e-3)


def only_square(receptors, row, column, changes=True):
    """Which squares the light has changed in: this one, if it `changes`."""
    changed = np.zeros_like(receptors.changed)
    changed[row, column] = changes
    return changed


def bar_scene(speed_px_s: float) -> Scene:
    """A bright bar, two pixels wide, that crosses a darker ground."""
    duration_s = 30 / speed_px_s
    path = Path([Waypoint(0.0, 5.0, 10.0), Waypoint(duration_s, 35.0, 10.0)])
    sprite = Sprite("bar", np.full((60, 2), 0.8), np.ones((60, 2)), path)
    return Scene(WIDTH, HEIGHT, duration_s, np.full((HEIGHT, WIDTH), 0.3), (sprite,))


def events_of(speed_px_s: float, bandwidth_hz: float, step_px: float = 0.1) -> Events:
    config = dataclasses.replace(QUIET, bandwidth_hz=bandwidth_hz, step_px=step_px)
    return concatenate(list(simulate(bar_scene(speed_px_s), seed=1, config=config)))


def test_what_is_slow_loses_no_contrast_and_what_is_fast_loses_some():
    slow, fast = (len(events_of(speed, 300.0)) / len(events_of(speed, 0.0)) for speed in (20.0, 3000.0))
    assert slow > 0.95
    assert 0 < fast < 0.5


def behind_px(events: Events, speed_px_s: float) -> float:
    """How far the events are behind the middle of the bar when they come."""
    return float(np.median(5 + speed_px_s * events.t / 1e9 - (events.x + 0.5)))


@pytest.mark.parametrize("step_px", [0.1, 0.6])
def test_events_trail_behind_what_is_fast_by_its_motion_in_a_time_constant_whatever_the_steps(step_px):
    late_px = behind_px(events_of(400.0, 200.0, step_px), 400.0) - behind_px(events_of(400.0, 0.0), 400.0)
    # The light's time constants are between that of the bar and that of the ground.
    least, most = (400.0 / (2 * math.pi * 200.0 * intensity) for intensity in (0.8, 0.3))
    assert least < late_px < most + 0.5


def test_half_of_the_events_of_a_jump_come_after_log_2_time_constants_though_nothing_moves_any_more():
    jump_s, width = 0.0051, 8

    def pose(times_s):
        still = np.zeros_like(times_s)
        return np.where(times_s < jump_s, 10.0, 30.0), still + 10, still + 1, still

    thing = Sprite("thing", np.full((width, width), 0.9), np.ones((width, width)), Path.of(pose, 0.08))
    scene = Scene(WIDTH, HEIGHT, 0.08, np.full((HEIGHT, WIDTH), 0.1), (thing,))
    config = dataclasses.replace(QUIET, bandwidth_hz=50.0, step_s=0.08)
    events = concatenate(list(simulate(scene, seed=1, config=config)))
    bright, dark = (events.t[events.p == polarity] / 1e9 - jump_s for polarity in (1, 0))
    for times_s, intensity in ((bright, 0.9), (dark, 0.1)):
        constant_s = 1 / (2 * math.pi * 50.0 * intensity)
        assert np.median(times_s) == pytest.approx(math.log(2) * constant_s, abs=0.002)
        assert len(times_s) > 0.8 * (width - 1) ** 2 * math.log(9) / QUIET.contrast_threshold


def test_a_step_that_does_not_divide_a_scene_is_shortened_so_that_it_does():
    scene = bar_scene(3000.0)
    times_us = step_times_us(scene, step_s=0.0003, step_px=0)
    assert times_us[0] == 0
    assert times_us[-1] == round(scene.duration_s * 1e6)
    assert np.diff(times_us).max() <= 300
