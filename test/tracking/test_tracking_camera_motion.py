"""What moves otherwise than the camera, on simulated scenes whose truth is exact."""

import numpy as np
import pytest

from etd_ros.engine import FrameSource
from etd_ros.events import concatenate
from etd_ros.settings import Settings
from etd_ros.simulation import Path, Scene, Sprite, simulate
from etd_ros.simulation.textures import smooth_noise
from etd_ros.tracking.camera_motion import CameraMotion
from etd_ros.tracking.recent_events import RecentEvents

WIDTH, HEIGHT, DURATION_S, TILES_S = 240, 180, 0.4, 0.04


def texture_of(seed: int, height: int, width: int) -> np.ndarray:
    return 0.2 + 0.6 * smooth_noise(np.random.default_rng(seed), height, width, grain=3.0)


def square(side_px: int, velocity=(0.0, 0.0), nearness: float = 1.0) -> Sprite:
    """A square that is in the middle of the picture halfway, if the camera does not turn."""

    def way(t):
        return tuple(side / 2 + v * (t - DURATION_S / 2) for side, v in zip((WIDTH, HEIGHT), velocity, strict=True))

    texture = texture_of(1, side_px, side_px)
    return Sprite("square", texture, np.ones_like(texture), Path.of(way, DURATION_S), nearness=nearness)


def before_a_sliding_camera(sprite: Sprite, speed_px_s: float = 80.0) -> Scene:
    """The picture goes to the left."""
    camera = Path.of(lambda t: (speed_px_s * (t - DURATION_S / 2), 0 * t), DURATION_S)
    return Scene(WIDTH, HEIGHT, DURATION_S, texture_of(0, 2 * HEIGHT, 2 * WIDTH), (sprite,), view=camera)


def looked_at(scene: Scene):
    """The finder after the whole of a scene, looking for a camera that stood until now, and what it has found."""
    frames = FrameSource("atsltd_fine", WIDTH, HEIGHT, Settings()).frames(concatenate(list(simulate(scene, seed=0))))
    events = RecentEvents(WIDTH, HEIGHT)
    for frame in frames:
        events.take(frame.stamp_ns, frame.data)
    camera = CameraMotion(events)
    camera.window_s = TILES_S
    return camera, camera.look(events.points(TILES_S), moves=False)


def test_what_stands_nearer_than_most_does_not_move_by_itself():
    camera, found = looked_at(before_a_sliding_camera(square(50, nearness=1.9), 160))
    assert camera.motion.x == pytest.approx(-160, abs=15)
    assert found == []


@pytest.mark.parametrize(
    "velocity",
    [pytest.param((-160, 0), id="faster"), pytest.param((160, 0), id="against"), pytest.param((-50, 60), id="aside")],
)
def test_what_goes_faster_against_the_picture_or_aside_does(velocity):
    scene = before_a_sliding_camera(square(50, velocity))
    _, found = looked_at(scene)
    assert max(sighting.box.iou(scene.box("square", DURATION_S)) for sighting in found) > 0.6


def test_tiles_of_a_thing_that_fills_much_of_the_picture_before_a_still_camera_are_no_motion_of_the_camera():
    scene = Scene(WIDTH, HEIGHT, DURATION_S, np.full((HEIGHT, WIDTH), 0.5), (square(130, (200, 0)),))
    camera, found = looked_at(scene)
    assert camera.motion is None
    assert found == []
