"""A tracker says how long frames may last, so that a fast target is still where its box is at their end."""

from __future__ import annotations

import math

import pytest
from tracked_scenes import HEIGHT, SIZE, START_NS, WIDTH, frames_of, scene_of

from etd_ros.boxes import Box
from etd_ros.simulation import Waypoint
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState, TrackerConfig

FRAME_SHARE = 0.05


def crossing(speed_px_s: float, size_scale: float = 1.0):
    """The square goes from left to right, 100 px in the middle of the sensor."""
    last_s = 100 / speed_px_s
    return scene_of(Waypoint(0.0, 60.0, 90.0, size_scale), Waypoint(last_s, 160.0, 90.0, size_scale), duration_s=last_s)


def limits_s(scene, *, config=None, add=()):
    """(state, what is asked for after it) of each frame."""
    tracker = MultiTracker(WIDTH, HEIGHT, contours=config or ContourConfig())
    tracker.start("thing", scene.box("thing", 0.0), START_NS)
    for name, box in add:
        tracker.start(name, box, START_NS)
    asked = []
    for frame in frames_of(scene):
        report, *_ = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
        asked.append((report.state, tracker.longest_frame_s()))
    return asked


@pytest.mark.parametrize("speed_px_s", [200.0, 800.0])
def test_frames_are_to_last_until_the_target_has_moved_by_a_share_of_its_size(speed_px_s):
    asked = [limit_s for _, limit_s in limits_s(crossing(speed_px_s))]
    half = len(asked) // 2
    assert asked[half:] == pytest.approx([FRAME_SHARE * SIZE / speed_px_s] * (len(asked) - half), rel=0.25)


def test_the_share_can_be_chosen():
    half_as_much, usual = (
        limits_s(crossing(400.0), config=ContourConfig(frame_motion=share))[-1][1] for share in (0.025, 0.05)
    )
    assert half_as_much == pytest.approx(usual / 2)


def test_the_fastest_of_several_targets_decides():
    alone, with_another = limits_s(crossing(400.0)), limits_s(crossing(400.0), add=[("still", Box(10, 10, 30, 30))])
    assert with_another[-1] == alone[-1]


def test_frames_may_last_as_they_like_before_a_target_starts_and_while_its_motion_is_not_known():
    assert MultiTracker(WIDTH, HEIGHT, contours=ContourConfig()).longest_frame_s() == math.inf
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig())
    tracker.start("thing", Box(10, 10, 30, 30), START_NS)
    assert tracker.longest_frame_s() == math.inf
    assert limits_s(crossing(800.0))[0][1] == math.inf


def test_a_target_that_is_lost_asks_for_nothing():
    asked = limits_s(scene_of(Waypoint(0.0, 150.0, 90.0), Waypoint(0.4, 300.0, 90.0), duration_s=0.9))
    assert any(limit_s < math.inf for _, limit_s in asked)
    lost = [limit_s for state, limit_s in asked if state in {TargetState.RECOVERING, TargetState.LOST}]
    assert lost
    assert set(lost) == {math.inf}


def test_frames_are_never_to_be_shorter_than_half_a_millisecond():
    tiny_steps = ContourConfig(frame_motion=0.001)
    assert min(limit_s for _, limit_s in limits_s(crossing(800.0), config=tiny_steps)) == 0.0005


def test_targets_on_proposals_ask_for_nothing():
    tracker = MultiTracker(WIDTH, HEIGHT, TrackerConfig())
    tracker.start("thing", Box(10, 10, 30, 30), 0)
    assert tracker.longest_frame_s() == math.inf
