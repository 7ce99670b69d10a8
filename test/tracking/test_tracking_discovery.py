"""Whether the camera moves, on simulated scenes whose truth is exact."""

import numpy as np

from etd_ros.engine import FrameSource
from etd_ros.events import concatenate
from etd_ros.settings import Settings
from etd_ros.simulation import Path, Scene, simulate
from etd_ros.simulation.textures import smooth_noise
from etd_ros.tracking.discovery import Discovery

WIDTH, HEIGHT, DURATION_S = 240, 180, 0.42


def test_a_camera_that_turns_slowly_is_soon_found_to_move():
    background = 0.35 + 0.3 * smooth_noise(np.random.default_rng(0), 2 * HEIGHT, 2 * WIDTH, grain=3.0)
    scene = Scene(WIDTH, HEIGHT, DURATION_S, background, (), view=Path.of(lambda t: (35 * t, 0 * t), DURATION_S))
    discovery = Discovery(WIDTH, HEIGHT)
    for frame in FrameSource("atsltd_fine", WIDTH, HEIGHT, Settings()).frames(
        concatenate(list(simulate(scene, seed=0)))
    ):
        discovery.take(frame.stamp_ns, frame.data)
        if discovery.is_due():
            discovery.look()
    assert discovery.camera_moves
