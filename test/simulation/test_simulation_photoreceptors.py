"""Pixels that follow the light late, against the closed form of a first-order low pass."""

import dataclasses
import math

import numpy as np
import pytest

from etd_ros.events import Events, concatenate
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite, Waypoint, simulate
from etd_ros.simulation.photoreceptors import Photoreceptors

HEIGHT, WIDTH = 20, 40
BANDWIDTH_HZ = 100.0
QUIET = SensorConfig(threshold_spread=0.0, refractory_s=0.0, noise_rate_hz=0.0, step_s=0.0005)


@pytest.mark.parametrize(("intensity", "share"), [(1.0, 1.0), (0.4, 0.4), (0.02, 0.1), (1.5, 1.0)])
def test_a_pixel_follows_a_step_of_light_exponentially_and_slower_where_it_is_dark(intensity, share):
    light = np.zeros((HEIGHT, WIDTH))
    receptors = Photoreceptors(light, BANDWIDTH_HZ)
    light[3, 5] = math.log(intensity)
    changed = np.zeros_like(receptors.changed)
    changed[0, 0] = True
    for step in range(1, 6):
        receptors.advance(light, changed, 0.0004)
        left = math.exp(-2 * math.pi * BANDWIDTH_HZ * share * 0.0004 * step)
        assert receptors.after[3, 5] == pytest.approx(math.log(intensity) * (1 - left))
        changed[:] = False
    assert not np.delete(receptors.after.ravel(), 3 * WIDTH + 5).any()


def test_squares_change_until_all_of_their_pixels_have_arrived():
    light = np.zeros((HEIGHT, WIDTH))
    receptors = Photoreceptors(light, BANDWIDTH_HZ)
    light[17, 39] = -1.0
    changed = np.zeros_like(receptors.changed)
    changed[1, 2] = True
    steps = 0
    while receptors.changed.any() or steps == 0:
        receptors.advance(light, changed if steps == 0 else np.zeros_like(changed), 0.001)
        assert not np.delete(receptors.changed.ravel(), 5).any()
        steps += 1
    arrives = math.log(1000) / (2 * math.pi * BANDWIDTH_HZ * math.exp(-1) * 0.001)
    assert steps == pytest.approx(arrives, abs=2)
    assert receptors.after[17, 39] == pytest.approx(-1.0, abs=2e-3)


def bar_scene(speed_px_s: float) -> Scene:
    """A bright bar, two pixels wide, that crosses a darker ground."""
    duration_s = 30 / speed_px_s
    path = Path([Waypoint(0.0, 5.0, 10.0), Waypoint(duration_s, 35.0, 10.0)])
    sprite = Sprite("bar", np.full((60, 2), 0.8), np.ones((60, 2)), path)
    return Scene(WIDTH, HEIGHT, duration_s, np.full((HEIGHT, WIDTH), 0.3), (sprite,))


def events_of(speed_px_s: float, bandwidth_hz: float) -> Events:
    config = dataclasses.replace(QUIET, bandwidth_hz=bandwidth_hz, step_px=0.1)
    return concatenate(list(simulate(bar_scene(speed_px_s), seed=1, config=config)))


def test_what_is_slow_loses_no_contrast_and_what_is_fast_loses_some():
    slow, fast = (len(events_of(speed, 300.0)) / len(events_of(speed, 0.0)) for speed in (20.0, 3000.0))
    assert slow > 0.95
    assert 0 < fast < 0.5


def test_events_trail_behind_what_is_fast():
    def behind_px(bandwidth_hz: float) -> float:
        events = events_of(400.0, bandwidth_hz)
        bar_x = 5 + 400.0 * events.t / 1e9
        return float(np.median(bar_x - (events.x + 0.5)))

    # By as many pixels as it moves in the time constants of light between that of the bar and of the ground.
    least, most = (400.0 / (2 * math.pi * 200.0 * intensity) for intensity in (0.8, 0.3))
    assert least < behind_px(200.0) - behind_px(0.0) < most + 1
