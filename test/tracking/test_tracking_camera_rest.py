"""A camera that comes to a halt: what stands has no events then, and is where it was."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd_ros.boxes import Box
from etd_ros.engine import track
from etd_ros.evaluation.suite import START_NS
from etd_ros.events import concatenate
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite, simulate
from etd_ros.simulation.textures import checks, smooth_noise
from etd_ros.stream import StreamGuard
from etd_ros.targets import TargetStart
from etd_ros.tracking import TargetState
from etd_ros.tracking.camera_rest import BLOCKS, LIVELY_SHARE, CameraRest, fired, lively_parts

WIDTH, HEIGHT = 240, 180
FRAME_S = 0.002


def frame(share, *, columns=slice(None), seed=0):
    """A frame of whose pixels in these columns a share has fired."""
    data = np.zeros((HEIGHT, WIDTH, 2), np.uint8)
    chosen = np.random.default_rng(seed).random((HEIGHT, WIDTH)) < share
    data[:, columns, 0] = 200 * chosen[:, columns]
    return data


class Watched:
    """What is known after stretches of frames."""

    def __init__(self, *stretches, boxes=None):
        self.rest, self._stamp_ns = CameraRest(), 0
        for stretch in stretches:
            self.go_on(*stretch, boxes=boxes)

    def go_on(self, time_s, share, columns, boxes=None):
        """Frames of a time (s), of whose pixels in these columns such a share has fired."""
        for step in range(round(time_s / FRAME_S)):
            self._stamp_ns += round(FRAME_S * 1e9)
            self.rest.take(self._stamp_ns, frame(share, columns=columns, seed=step), FRAME_S, boxes or {})


def after(*stretches, boxes=None):
    return Watched(*stretches, boxes=boxes).rest


ALL, FEW = slice(None), slice(0, 50)


def test_the_camera_is_at_rest_when_events_end_all_over_the_sensor():
    assert not after((0.3, 0.03, ALL)).is_at_rest
    assert after((0.3, 0.03, ALL), (0.06, 0.0003, ALL)).is_at_rest


@pytest.mark.parametrize(("share", "columns", "sees_motion"), [(0.03, ALL, True), (0.1, FEW, False), (0.0, ALL, False)])
def test_pixels_fire_all_over_the_sensor_before_a_camera_that_moves(share, columns, sees_motion):
    assert after((0.1, share, columns)).sees_motion == sees_motion


def test_a_camera_that_halts_sees_no_motion_any_more():
    assert not after((0.3, 0.03, ALL), (0.2, 0.0, ALL)).sees_motion


def test_a_halt_is_a_matter_of_a_moment():
    watched = Watched((0.3, 0.03, ALL), (0.1, 0.0, ALL))
    assert watched.rest.has_just_halted
    watched.go_on(0.3, 0.0, ALL)
    assert watched.rest.is_at_rest
    assert not watched.rest.has_just_halted


def test_it_moves_again_with_new_events():
    assert not after((0.3, 0.03, ALL), (0.1, 0.0, ALL), (0.06, 0.03, ALL)).is_at_rest


def test_one_thing_that_stops_is_not_the_camera():
    assert not after((0.3, 0.1, FEW), (0.1, 0.0, ALL)).is_at_rest


def test_what_targets_do_is_not_what_the_camera_does():
    assert not after((0.3, 0.03, ALL), (0.1, 0.0, ALL), boxes={"thing": Box(0.0, 0.0, WIDTH, HEIGHT)}).is_at_rest


def test_what_a_target_did_before_it_started_is_not_what_the_camera_does():
    watched = Watched((0.3, 0.03, ALL))
    watched.go_on(0.1, 0.03, ALL, boxes={"thing": Box(0.0, 0.0, WIDTH, HEIGHT)})
    assert not watched.rest.is_at_rest


def test_noise_that_ends_says_nothing():
    assert not after((0.3, 0.0005, ALL), (0.1, 0.0, ALL)).is_at_rest


def test_a_stream_that_starts_again_has_not_moved_before():
    rest = after((0.3, 0.03, ALL))
    rest.forget()
    rest.take(10**9, frame(0.0), FRAME_S, {})
    assert not rest.is_at_rest


def test_a_frame_without_duration_says_nothing():
    rest = after((0.3, 0.03, ALL))
    for _ in range(100):
        rest.take(10**9, frame(0.0), 0.0, {})
    assert not rest.is_at_rest


@given(st.integers(0, 1000), st.sampled_from([1, 3, 4]), st.integers(0, 3))
def test_pixels_are_counted_by_parts_and_beside_the_boxes(seed, stride, number):
    rng = np.random.default_rng(seed)
    data = (rng.random((37, 51, 2)) < 0.1).astype(np.uint8)
    boxes = np.column_stack([rng.uniform(-5, 40, (number, 2)), rng.uniform(3, 20, (number, 2))])
    before = rng.random((BLOCKS, BLOCKS))
    expected = np.zeros((BLOCKS, BLOCKS))
    for row in range(0, 37, stride):
        for column in range(0, 51, stride):
            is_inside = any(
                abs(column - x - w / 2) < 0.75 * w and abs(row - y - h / 2) < 0.75 * h for x, y, w, h in boxes.tolist()
            )
            if data[row, column].any() and not is_inside:
                expected[row * BLOCKS // 37, column * BLOCKS // 51] += 1
    rates_hz = before.copy()
    total_hz = fired(data, stride, boxes, 1.5, rates_hz, 0.25, 0.01)
    assert total_hz == pytest.approx(expected.sum() / 0.01)
    np.testing.assert_allclose(rates_hz, 0.75 * before + 0.25 * expected / 0.01)


def test_lively_parts_have_a_share_of_the_mean():
    rates_hz = np.full((BLOCKS, BLOCKS), 8.0)
    rates_hz[0] = 0.0
    rates_hz[1, 0] = 100.0
    total_hz, lively = lively_parts(rates_hz, LIVELY_SHARE)
    assert total_hz == rates_hz.sum()
    assert lively == 12


def last_reports(scene, starts, missing_s=(0.0, 0.0)):
    """Those of a scene's last frame; events between two times (s) are missing."""
    guard = StreamGuard()
    events = concatenate(list(simulate(scene, seed=1, start_ns=START_NS, config=SensorConfig(noise_rate_hz=1000.0))))
    since_ns, until_ns = (START_NS + round(time_s * 1e9) for time_s in missing_s)
    parts = events.between(0, since_ns), events.between(until_ns, 2 * START_NS)
    batches = (batch for part in parts for batch in guard.feed(part))
    return [step.reports for step in track(batches, starts, threads=False)][-1]


def scene_of(camera, sprites, duration_s):
    wall = 0.5 + 0.35 * smooth_noise(np.random.default_rng(3), HEIGHT + 120, WIDTH + 120)
    return Scene(WIDTH, HEIGHT, duration_s, wall, tuple(sprites), view=Path.of(camera, duration_s))


def square(name, way, duration_s):
    return Sprite(name, checks(np.random.default_rng(5), 36, 36, cell=9), np.ones((36, 36)), Path.of(way, duration_s))


def braked(rate_hz, fades_s):
    """The last reports of two things on a wall before a camera that brakes at 1 s and shakes across its way."""

    def camera(t):
        since_s = np.maximum(t - 1.0, 0)
        shaking = 4 * np.sin(2 * np.pi * rate_hz * since_s) * np.exp(-since_s / fades_s)
        return shaking, 40 * (np.minimum(t, 1.0) - 1.0) + shaking / 2, np.ones_like(t), np.zeros_like(t)

    places = {"left": 70.0, "right": 170.0}
    sprites = [square(name, lambda t, x=x: (x + 0 * t, 90 + 0 * t), 1.6) for name, x in places.items()]
    scene = scene_of(camera, sprites, 1.6)
    starts = [TargetStart(name, scene.box(name, 0.1), START_NS + 10**8) for name in places]
    return [(report, scene.box(report.name, 1.6)) for report in last_reports(scene, starts)]


@pytest.mark.parametrize(("rate_hz", "fades_s"), [(12.0, 0.1), (20.0, 0.14), (25.0, 0.06), (25.0, 0.14)])
def test_targets_stand_where_they_were_when_the_camera_has_braked_and_shaken(rate_hz, fades_s):
    for report, truth in braked(rate_hz, fades_s):
        assert report.state is TargetState.TRACKING
        assert report.box.iou(truth) > 0.75


def test_what_goes_behind_something_after_the_halt_is_lost():
    def camera(t):
        return 60 * (np.minimum(t, 0.4) - 0.4), np.zeros_like(t), np.ones_like(t), np.zeros_like(t)

    thing = square("thing", lambda t: (50 + 100 * np.maximum(t - 0.9, 0), 90 + 0 * t), 2.4)
    pillar = Sprite(
        "pillar", np.full((120, 80), 0.3), np.ones((120, 80)), Path.of(lambda t: (180 + 0 * t, 90 + 0 * t), 2.4)
    )
    scene = scene_of(camera, (thing, pillar), 2.4)
    (report,) = last_reports(scene, [TargetStart("thing", scene.box("thing", 0.1), START_NS + 10**8)])
    assert report.state is not TargetState.TRACKING


def test_what_was_lost_as_events_were_missing_does_not_stand_where_it_was():
    def camera(t):
        return 150 * (np.minimum(t, 1.0) - 1.0), np.zeros_like(t), np.ones_like(t), np.zeros_like(t)

    thing = square("thing", lambda t: (80 + 0 * t, 90 + 0 * t), 1.3)
    scene = scene_of(camera, (thing,), 1.3)
    start = TargetStart("thing", scene.box("thing", 0.3), START_NS + 3 * 10**8)
    (report,) = last_reports(scene, [start], missing_s=(0.82, 1.0))
    assert report.box is None or report.box.iou(scene.box("thing", 1.3)) > 0.5
