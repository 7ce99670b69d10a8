"""What slows down stands still where it stopped, however noisy the sensor; what leaves while it starts has left."""

import numpy as np
import pytest
from tracked_scenes import HEIGHT, START_NS, WIDTH, frames_of, overlap, tracked

from etd_ros.simulation import Path, Scene, Sprite
from etd_ros.simulation.textures import checks, smooth_noise
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState
from etd_ros.tracking import following as module

SPEED_PX_S, BRAKES_AT_S, BRAKES_FOR_S = 100.0, 0.5, 0.2


def scene_along(way, size, duration_s):
    """A checked square of a size (pixels) whose middle goes along a row, before a smooth wall."""
    rng = np.random.default_rng(5)
    wall = 0.5 + 0.05 * smooth_noise(rng, HEIGHT, WIDTH)
    path = Path.of(lambda t: (way(np.asarray(t, float)), HEIGHT / 2 + 0 * t), duration_s)
    return Scene(
        WIDTH,
        HEIGHT,
        duration_s,
        wall,
        (Sprite("thing", checks(rng, size, size, cell=9), np.ones((size, size)), path),),
    )


def braking(t, again_s=np.inf):
    """At rest from 0.7 s on, or until it goes on."""
    slowed = np.clip(t - BRAKES_AT_S, 0, BRAKES_FOR_S)
    way_s = np.minimum(t, BRAKES_AT_S) + slowed - slowed**2 / (2 * BRAKES_FOR_S) + np.clip(t - again_s, 0, None)
    return 60 + SPEED_PX_S * way_s


@pytest.mark.parametrize(("size", "noise_rate_hz"), [(36, 1_000.0), (36, 50_000.0), (90, 5_000.0)])
def test_what_slows_down_and_stands_still_in_noise_keeps_its_box_and_state(size, noise_rate_hz):
    scene = scene_along(braking, size, 1.6)
    found = tracked(scene, frames=frames_of(scene, noise_rate_hz=noise_rate_hz))
    at_rest = [(report, truth) for time_s, report, truth in found if time_s > 1.0]
    assert {report.state for report, _ in at_rest} == {TargetState.TRACKING}
    assert min(overlap(report, truth) for report, truth in at_rest) > 0.85


def test_what_stood_still_in_noise_is_followed_on():
    scene = scene_along(lambda t: braking(t, again_s=1.2), 36, 1.5)
    _, report, truth = tracked(scene, frames=frames_of(scene, noise_rate_hz=20_000.0))[-1]
    assert report.state is TargetState.TRACKING
    assert overlap(report, truth) > 0.9


def test_noise_where_it_stands_is_no_reason_to_look_elsewhere(monkeypatch):
    scene = scene_along(braking, 90, 1.6)
    frames = frames_of(scene, noise_rate_hz=5_000.0)
    monkeypatch.setattr(module.Contours, "sees_noise", lambda *_: False)
    assert tracked(scene, frames=frames)[-1][1].state is not TargetState.TRACKING


@pytest.mark.parametrize("speed_px_s", [120, 300])
def test_what_leaves_the_sensor_while_it_starts_is_lost(speed_px_s):
    start_s, gone_s, size = 0.02, 0.07, 36
    scene = scene_along(lambda t: WIDTH + size / 2 + speed_px_s * (t - gone_s), size, 0.6)
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig())
    tracker.start("thing", scene.box("thing", start_s), START_NS + round(start_s * 1e9))
    for frame in frames_of(scene):
        (report,) = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
    assert report.box is None
    assert report.state is TargetState.LOST


def test_what_stops_half_over_the_border_stays_there():
    speed_px_s, size, stops_s, at_px = 60.0, 32, 1.0, 230.0

    def way(t):
        # It comes to a halt within 0.06 s.
        slowed_s = np.clip(t - stops_s, 0, 0.06)
        return at_px + speed_px_s * (np.minimum(t, stops_s) - stops_s + slowed_s - slowed_s**2 / 0.12)

    found = tracked(scene_along(way, size, stops_s + 0.4))
    assert {report.state for _, report, _ in found} == {TargetState.TRACKING}
    assert overlap(*found[-1][1:]) > 0.7
