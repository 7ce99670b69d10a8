"""The simulated sensor against what a moving edge must give, and its noise."""

import dataclasses

import numpy as np
import pytest

from etd_ros.events import Events, concatenate
from etd_ros.parameters import ParameterError
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite, Waypoint, simulate

DARK, BRIGHT = 0.2, 0.8
SPEED = 100.0
EDGE_START, EDGE_END = 30, 10
CONTRAST = 0.25
QUIET = SensorConfig(
    contrast_threshold=CONTRAST, threshold_spread=0.0, refractory_s=0.0, noise_rate_hz=0.0, step_s=0.0001
)


def edge_scene(ground: float, front: float) -> Scene:
    """A sheet of one brightness that covers all rows; its left edge moves from column 30 to column 10 in 0.2 s."""
    duration_s = (EDGE_START - EDGE_END) / SPEED
    sheet = np.full((9, 60), front)
    path = Path([Waypoint(0.0, EDGE_START + 30, 1.5), Waypoint(duration_s, EDGE_END + 30, 1.5)])
    sprite = Sprite("sheet", sheet, np.ones_like(sheet), path)
    return Scene(40, 3, duration_s, np.full((3, 40), ground), (sprite,))


def still_scene() -> Scene:
    return Scene(32, 24, 0.2, np.full((24, 32), 0.5), ())


def all_events(scene: Scene, seed: int = 1, config: SensorConfig = QUIET, start_ns: int = 0) -> Events:
    return concatenate(list(simulate(scene, seed=seed, config=config, start_ns=start_ns)))


def log_intensity(columns: np.ndarray, times_s: np.ndarray, ground: float, front: float) -> np.ndarray:
    """The edge at EDGE_START - SPEED t covers a pixel within one pixel of its way, linearly in intensity."""
    cover = np.clip(1 + columns - (EDGE_START - SPEED * times_s), 0, 1)
    return np.log(ground + (front - ground) * cover)


@pytest.mark.parametrize(("ground", "front", "polarity"), [(DARK, BRIGHT, 1), (BRIGHT, DARK, 0)])
def test_an_edge_makes_events_on_the_pixels_it_crosses_and_of_its_polarity(ground, front, polarity):
    events = all_events(edge_scene(ground, front))
    counts = np.zeros((3, 40), int)
    np.add.at(counts, (events.y, events.x), 1)
    levels = np.log(BRIGHT / DARK) / CONTRAST
    assert set(events.p.tolist()) == {polarity}
    assert not counts[:, :EDGE_END].any()
    assert not counts[:, EDGE_START:].any()
    # Where between two events a pixel starts decides whether it has one more or less.
    assert np.isin(counts[:, EDGE_END:EDGE_START], (int(levels - 0.5), int(levels + 0.5))).all()


@pytest.mark.parametrize(("ground", "front"), [(DARK, BRIGHT), (BRIGHT, DARK)])
def test_events_come_when_log_intensity_has_changed_by_the_threshold(ground, front):
    events = all_events(edge_scene(ground, front))
    sign = 1 if front > ground else -1
    levels = sign * log_intensity(events.x.astype(float), events.t / 1e9, ground, front)
    for row, column in np.ndindex(3, 40):
        of_pixel = levels[(events.y == row) & (events.x == column)]
        if len(of_pixel):
            assert np.diff(of_pixel) == pytest.approx(CONTRAST, abs=3e-3)
            assert CONTRAST / 2 - 3e-3 <= of_pixel[0] - sign * np.log(ground) <= 1.5 * CONTRAST + 3e-3


def test_the_first_levels_of_the_pixels_differ_or_an_edge_would_fire_in_step():
    events = all_events(edge_scene(DARK, BRIGHT))
    first = [events.t[(events.y == row) & (events.x == 20)][0] for row in range(3)]
    assert len(set(first)) == 3


def test_thresholds_differ_from_pixel_to_pixel_by_the_spread():
    config = SensorConfig(threshold_spread=0.03, refractory_s=0.0, noise_rate_hz=0.0, step_s=0.0001)
    events = all_events(edge_scene(DARK, BRIGHT), config=config)
    levels = log_intensity(events.x.astype(float), events.t / 1e9, DARK, BRIGHT)
    steps = [
        np.diff(levels[(events.y == row) & (events.x == column)])
        for row, column in np.ndindex(3, 40)
        if np.count_nonzero((events.y == row) & (events.x == column)) > 1
    ]
    of_pixels = np.array([step.mean() for step in steps])
    assert max(np.ptp(step) for step in steps) < 6e-3
    assert 0.02 < of_pixels.std() < 0.04


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others():
    config = SensorConfig(noise_rate_hz=5000.0)
    first, again, other = (
        all_events(edge_scene(DARK, BRIGHT), seed, config).to_structured().tobytes() for seed in (5, 5, 6)
    )
    assert first == again
    assert first != other


def test_events_are_valid_in_time_order_on_whole_microseconds_and_within_the_scene():
    start_ns = 1_700_000_000_000_000_000
    config = SensorConfig(noise_rate_hz=5000.0)
    events = all_events(edge_scene(DARK, BRIGHT), config=config, start_ns=start_ns)
    events.check()
    assert not (events.t % 1000).any()
    assert start_ns <= events.t[0]
    assert events.t[-1] < start_ns + 200_000_000


def test_a_still_scene_without_noise_is_silent():
    assert list(simulate(still_scene(), seed=1, config=QUIET)) == []


def test_noise_has_its_rate_and_no_favourite_place_or_polarity():
    rate_hz = 50_000.0
    config = SensorConfig(noise_rate_hz=rate_hz)
    events = all_events(still_scene(), config=config)
    expected = rate_hz * 0.2
    assert abs(len(events) - expected) < 5 * np.sqrt(expected)
    assert abs(int(events.p.sum()) - expected / 2) < 5 * np.sqrt(expected / 4)
    quadrants = np.bincount((events.x >= 16) + 2 * (events.y >= 12), minlength=4)
    assert (np.abs(quadrants - expected / 4) < 5 * np.sqrt(expected / 4)).all()


def test_hot_pixels_fire_all_the_time_each_in_its_place():
    config = SensorConfig(noise_rate_hz=0.0, hot_pixels=3, hot_pixel_rate_hz=5000.0)
    events = all_events(still_scene(), config=config)
    places, counts = np.unique(events.y.astype(int) * 32 + events.x, return_counts=True)
    assert 1 <= len(places) <= 3
    assert abs(counts.sum() - 3000) < 5 * np.sqrt(3000)
    assert counts.min() > 800


def test_leaking_pixels_report_light_that_rises():
    config = SensorConfig(noise_rate_hz=0.0, leak_rate_hz=20_000.0)
    events = all_events(still_scene(), config=config)
    assert abs(len(events) - 4000) < 5 * np.sqrt(4000)
    assert events.p.all()
    assert len(np.unique(events.y.astype(int) * 32 + events.x)) > 700


@pytest.mark.parametrize(("ground", "front", "share"), [(DARK, BRIGHT, np.exp(0.3)), (BRIGHT, DARK, np.exp(-0.3))])
def test_thresholds_of_falling_light_are_larger_by_the_bias_than_those_of_rising_light(ground, front, share):
    config = SensorConfig(
        contrast_threshold=0.1, threshold_spread=0.0, threshold_bias=0.6, refractory_s=0.0, noise_rate_hz=0.0,
        step_s=0.0001,
    )  # fmt: skip
    biased, even = (
        len(all_events(edge_scene(ground, front), config=config))
        for config in (config, dataclasses.replace(config, threshold_bias=0.0))
    )
    assert biased / even == pytest.approx(share, rel=0.05)


def test_a_pixel_rests_for_its_refractory_time():
    refractory_s = 0.003
    config = SensorConfig(refractory_s=refractory_s, noise_rate_hz=0.0)
    busy, resting = (all_events(edge_scene(DARK, BRIGHT), config=config) for config in (QUIET, config))
    assert len(resting) < len(busy)
    for row, column in np.ndindex(3, 40):
        of_pixel = resting.t[(resting.y == row) & (resting.x == column)]
        assert (np.diff(of_pixel) >= refractory_s * 1e9).all()


@pytest.mark.parametrize("values", [{"step_s": 0.0}, {"noise_rate_hz": -1.0}, {"contrast_threshold": float("nan")}])
def test_a_sensor_that_cannot_be_is_refused(values):
    with pytest.raises(ParameterError, match=next(iter(values))):
        SensorConfig(**values)
