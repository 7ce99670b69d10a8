"""What is said to stand somewhere is not said to be seen there while something else moves through that place."""

from __future__ import annotations

import numpy as np
import pytest
from tracked_scenes import HEIGHT, START_NS, WIDTH, frames_of, frames_without_it, tracked

from etd_ros.boxes import Box
from etd_ros.simulation import Path, Scene, Sprite, Waypoint
from etd_ros.simulation.textures import checks, smooth_noise
from etd_ros.tracking import TargetState
from etd_ros.tracking.other_targets import OtherBoxes
from etd_ros.tracking.surface import TimeSurface
from etd_ros.tracking.swept import GIVEN_UP_S, SWEPT_S, Swept

DURATION_S = 1.6
BOX = Box(100.0, 70.0, 40.0, 40.0)


def textured(rng):
    """What is seen all over the sensor."""
    return 0.2 + 0.6 * checks(rng, HEIGHT, 2 * WIDTH, cell=9)


def moving(texture, from_x, to_x, until_s=DURATION_S):
    """Something that moves along a row until a time, and stops."""
    path = Path((Waypoint(0, from_x, 90), Waypoint(until_s, to_x, 90), Waypoint(DURATION_S + 1, to_x, 90)))
    return Sprite("moving", texture, np.ones(texture.shape), path, is_target=False)


def taken(sprite, others=None, noise_rate_hz=1000.0):
    """(seconds, is swept, is given up) of a box, frame by frame, while a sprite moves before a wall."""
    rng = np.random.default_rng(2)
    wall = 0.5 + 0.05 * smooth_noise(rng, HEIGHT, WIDTH)
    scene = Scene(WIDTH, HEIGHT, DURATION_S, wall, (sprite,))
    surface = TimeSurface(WIDTH, HEIGHT)
    swept = Swept(BOX, START_NS, others or OtherBoxes())
    said = []
    for frame in frames_of(scene, noise_rate_hz=noise_rate_hz):
        surface.take(frame.stamp_ns, frame.data, frame.start_ns)
        surface.keep((0, HEIGHT, 0, WIDTH))
        given_up = swept.take(surface)
        said.append(((frame.stamp_ns - START_NS) * 1e-9, swept.is_swept, given_up))
    return said


def test_nothing_stands_where_a_camera_moves_past():
    said = taken(moving(textured(np.random.default_rng(1)), 60, 180))
    first_swept_s = next(time_s for time_s, is_swept, _ in said if is_swept)
    first_given_up_s = next(time_s for time_s, _, given_up in said if given_up)
    assert SWEPT_S <= first_swept_s < SWEPT_S + 0.1
    assert first_given_up_s == pytest.approx(first_swept_s + GIVEN_UP_S, abs=0.1)


def test_what_passes_hides_what_stands_for_as_long_as_it_passes():
    said = taken(moving(checks(np.random.default_rng(1), 70, 70, cell=9), -60, 300, until_s=1.0))
    swept_s = [time_s for time_s, is_swept, _ in said if is_swept]
    assert swept_s
    assert swept_s[-1] - swept_s[0] < 0.6
    assert not said[-1][1]
    assert not any(given_up for _, _, given_up in said)


def test_noise_is_nothing_that_moves_through():
    resting = moving(np.full((10, 10), 0.5), 20, 20)
    assert not any(is_swept for _, is_swept, _ in taken(resting, noise_rate_hz=50_000.0))


def test_what_lies_in_the_box_of_another_target_is_known_to_pass():
    class AllTaken(OtherBoxes):
        are_far = False

        def leave_out(self, _points, _count, _stamp_ns):
            return 0

    said = taken(moving(textured(np.random.default_rng(1)), 60, 180), AllTaken())
    assert not any(is_swept for _, is_swept, _ in said)


def test_a_target_that_vanishes_before_a_camera_that_moves_is_not_said_to_stand_there_for_long(monkeypatch):
    rng = np.random.default_rng(5)
    ground = 0.35 + 0.3 * checks(rng, HEIGHT, 2 * WIDTH, cell=9)
    way = Path((Waypoint(0, 40, 90), Waypoint(1, 240, 90)))
    thing = Sprite("thing", checks(rng, 36, 36, cell=9), np.ones((36, 36)), way)
    scene = Scene(WIDTH, HEIGHT, 0.8, np.full((HEIGHT, WIDTH), 0.5), (moving(ground, 60, 28, until_s=0.8), thing))
    frames = frames_without_it(scene, 0.25)
    _, report, _ = tracked(scene, frames=frames)[-1]
    assert (report.state, report.box) == (TargetState.RECOVERING, None)
    monkeypatch.setattr(Swept, "take", lambda *_: False)
    _, report, _ = tracked(scene, frames=frames)[-1]
    assert report.state is TargetState.TRACKING
    assert report.box is not None
