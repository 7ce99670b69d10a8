"""The camera's motion, and what moves otherwise, from the flow of edges, on simulated scenes whose truth is exact."""

import numpy as np
import pytest

from etd_ros.engine import FrameSource
from etd_ros.events import concatenate
from etd_ros.settings import Settings
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite, simulate
from etd_ros.simulation.textures import smooth_noise
from etd_ros.tracking.camera_flow import SURROUNDED_ON, CameraFlow, Motion, go_with, surrounded_share
from etd_ros.tracking.edge_flow_kernels import COLUMNS
from etd_ros.tracking.recent_events import RecentEvents

WIDTH, HEIGHT, DURATION_S = 240, 180, 0.4


def texture_of(seed: int, height: int, width: int) -> np.ndarray:
    return 0.2 + 0.6 * smooth_noise(np.random.default_rng(seed), height, width, grain=3.0)


def thing(velocity, side_px=40) -> Sprite:
    """A square that is in the middle of the picture halfway."""

    def way(t):
        return tuple(side / 2 + v * (t - DURATION_S / 2) for side, v in zip((WIDTH, HEIGHT), velocity, strict=True))

    texture = texture_of(1, side_px, side_px)
    return Sprite("thing", texture, np.ones_like(texture), Path.of(way, DURATION_S))


def look_at(scene: Scene, *surrounded: float, noise_rate_hz: float = 0.0):
    """The flow's finder after the whole of a scene, and what it has found."""
    events = concatenate(list(simulate(scene, seed=0, config=SensorConfig(noise_rate_hz=noise_rate_hz))))
    frames = FrameSource("atsltd_fine", WIDTH, HEIGHT, Settings()).frames(events)
    events = RecentEvents(WIDTH, HEIGHT)
    for frame in frames:
        events.take(frame.stamp_ns, frame.data)
    flow = CameraFlow(events)
    return flow, flow.look(*surrounded)


def seen_by(camera, *sprites) -> Scene:
    background = texture_of(0, 2 * HEIGHT, 2 * WIDTH)
    return Scene(WIDTH, HEIGHT, DURATION_S, background, sprites, view=Path.of(camera, DURATION_S))


def to_the_right(t):
    return 80 * t, 0 * t


def nearer(t):
    return 0 * t, 0 * t, np.exp(0.5 * t)


def test_a_camera_that_turns_has_its_velocity_and_nothing_moves_otherwise():
    flow, found = look_at(seen_by(to_the_right))
    assert (flow.motion.x, flow.motion.y) == pytest.approx((-80, 0), abs=10)
    assert found == []


def test_a_camera_that_comes_nearer_has_its_zoom_and_nothing_moves_otherwise():
    flow, found = look_at(seen_by(nearer))
    assert flow.motion.zoom == pytest.approx(0.5, abs=0.1)
    assert (flow.motion.x, flow.motion.y) == pytest.approx((0, 0), abs=10)
    assert found == []


@pytest.mark.parametrize("camera", [to_the_right, nearer])
def test_what_moves_otherwise_has_a_box_and_a_velocity(camera):
    scene = seen_by(camera, thing((140, 40)))
    _, found = look_at(scene)
    before, truth = (scene.box("thing", time_s) for time_s in (DURATION_S - 0.05, DURATION_S))
    velocity = np.subtract(truth.center, before.center) / 0.05
    seen = max(found, key=lambda sighting: sighting.box.iou(truth))
    assert seen.box.iou(truth) > 0.6
    assert seen.velocity == pytest.approx(tuple(velocity), abs=30)


def test_what_stands_in_the_world_moves_with_the_camera():
    flow, found = look_at(seen_by(to_the_right, thing((0, 0))))
    assert flow.motion is not None
    assert found == []


def test_a_thing_before_a_still_camera_is_no_motion_of_the_camera():
    flow, found = look_at(Scene(WIDTH, HEIGHT, DURATION_S, texture_of(0, HEIGHT, WIDTH), (thing((100, 0)),)))
    assert flow.motion is None
    assert found == []


def test_a_thing_that_fills_much_of_the_picture_before_a_still_camera_is_no_motion_of_the_camera():
    plain = np.full((HEIGHT, WIDTH), 0.5)
    flow, found = look_at(Scene(WIDTH, HEIGHT, DURATION_S, plain, (thing((100, 0), side_px=130),)))
    assert flow.motion is None
    assert found == []


def test_noise_all_round_a_thing_does_not_make_it_a_motion_of_the_camera():
    plain = np.full((HEIGHT, WIDTH), 0.5)
    scene = Scene(WIDTH, HEIGHT, DURATION_S, plain, (thing((100, 0), side_px=100),))
    flow, _ = look_at(scene, noise_rate_hz=1e5)
    assert flow.motion is None


def test_less_of_the_sensor_has_to_go_with_a_camera_that_moved_until_now():
    background = texture_of(0, 2 * HEIGHT, 2 * WIDTH)
    background[:, WIDTH:] = 0.5
    scene = Scene(WIDTH, HEIGHT, DURATION_S, background, (), view=Path.of(to_the_right, DURATION_S))
    flow, _ = look_at(scene)
    assert flow.motion is None
    flow, _ = look_at(scene, SURROUNDED_ON)
    assert (flow.motion.x, flow.motion.y) == pytest.approx((-80, 0), abs=10)


def test_places_surround_what_lies_between_them():
    events = RecentEvents(WIDTH, HEIGHT)
    assert surrounded_share(np.empty((0, 2)), events) == 0
    assert surrounded_share(np.array([[0.0, 0.0], [WIDTH / 2, HEIGHT], [WIDTH, 0.0], [9.0, 3.0]]), events) == 0.5


def test_without_events_the_camera_does_not_move():
    flow = CameraFlow(RecentEvents(WIDTH, HEIGHT))
    assert flow.look() == []
    assert flow.motion is None


def test_an_edge_goes_with_a_motion_by_what_it_has_of_it_across_the_edge():
    motion = Motion(x=100.0, zoom=0.5, roll=0.1)
    flows = np.zeros((4, COLUMNS))
    #            normal    speed   place
    flows[0] = (1.0, 0.0, 145.0, 90.0, 0.0)
    flows[1] = (0.0, 1.0, 9.0, 90.0, 0.0)
    flows[2] = (0.0, 1.0, 60.0, 90.0, 0.0)
    flows[3] = (-1.0, 0.0, 145.0, 90.0, 0.0)
    assert go_with(flows, motion).tolist() == [True, True, False, False]
