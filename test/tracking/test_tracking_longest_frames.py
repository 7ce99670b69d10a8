"""A tracker says how long frames may last, so that a fast target is still where its box is at their end."""

from __future__ import annotations

import math

import pytest
from tracked_scenes import HEIGHT, SIZE, START_NS, WIDTH, frames_of, pillar, scene_of

from etd_ros.boxes import Box
from etd_ros.simulation import Waypoint
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState, TrackerConfig
from etd_ros.tracking.contours import Contours

FRAME_SHARE = 0.02
TRACKING = TargetState.TRACKING


def crossing(speed_px_s: float):
    """The square goes from left to right, 100 px in the middle of the sensor."""
    last_s = 100 / speed_px_s
    return scene_of(Waypoint(0.0, 60.0, 90.0), Waypoint(last_s, 160.0, 90.0), duration_s=last_s)


def limits_s(scene, *, config=None, add=()):
    """State, score, and what is asked for after it, by the time of each frame (s)."""
    tracker = MultiTracker(WIDTH, HEIGHT, contours=config or ContourConfig())
    tracker.start("thing", scene.box("thing", 0.0), START_NS)
    for name, box in add:
        tracker.start(name, box, START_NS)
    asked = {}
    for frame in frames_of(scene):
        report, *_ = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
        asked[(frame.stamp_ns - START_NS) * 1e-9] = report.state, report.score, tracker.longest_frame_s()
    return asked


def last_limit_s(scene, **options):
    return list(limits_s(scene, **options).values())[-1][2]


@pytest.mark.parametrize("speed_px_s", [400.0, 800.0])
def test_frames_are_to_last_until_the_target_has_moved_by_a_share_of_its_size(speed_px_s):
    asked = [limit_s for _, _, limit_s in limits_s(crossing(speed_px_s)).values()]
    half = len(asked) // 2
    assert asked[half:] == pytest.approx([FRAME_SHARE * SIZE / speed_px_s] * (len(asked) - half), rel=0.25)


def test_frames_of_what_is_not_fast_are_to_be_no_shorter_than_its_looks_are_apart():
    asked = [limit_s for _, _, limit_s in limits_s(crossing(200.0)).values()]
    assert {limit_s for limit_s in asked if limit_s < math.inf} == {0.005}
    assert asked[-1] == 0.005


@pytest.mark.parametrize(("speed_px_s", "waits_s"), [(3000.0, 0.0015), (4500.0, 0.001)])
def test_a_look_at_what_is_fast_waits_until_it_has_moved_by_a_share_of_its_size(speed_px_s, waits_s):
    contours = Contours(Box(10.0, 10.0, 100.0, 100.0), START_NS, ContourConfig())
    contours.body.velocity = speed_px_s, 0.0
    assert contours.body.is_fast
    assert not contours.is_due(START_NS + round(0.95 * waits_s * 1e9), is_sure=True)
    assert contours.is_due(START_NS + round(1.05 * waits_s * 1e9), is_sure=True)


def test_a_look_at_what_is_fast_waits_for_two_milliseconds_at_most():
    contours = Contours(Box(10.0, 10.0, 100.0, 100.0), START_NS, ContourConfig())
    contours.body.velocity = 1000.0, 0.0
    assert contours.body.is_fast
    assert not contours.is_due(START_NS + 1_900_000, is_sure=True)
    assert contours.is_due(START_NS + 2_000_000, is_sure=True)


def test_a_look_at_what_is_fast_waits_for_five_milliseconds_after_one_that_was_not_sure():
    contours = Contours(Box(10.0, 10.0, 100.0, 100.0), START_NS, ContourConfig())
    contours.body.velocity = 3000.0, 0.0
    assert not contours.is_due(START_NS + 4_900_000, is_sure=False)
    assert contours.is_due(START_NS + 5_000_000, is_sure=False)


def test_the_share_can_be_chosen():
    half_as_much, usual = (
        last_limit_s(crossing(400.0), config=ContourConfig(frame_motion=share)) for share in (0.02, 0.04)
    )
    assert half_as_much == pytest.approx(usual / 2)


def test_the_fastest_of_several_targets_decides():
    alone = last_limit_s(crossing(400.0))
    assert last_limit_s(crossing(400.0), add=[("still", Box(10, 10, 30, 30))]) == alone


def test_frames_may_last_as_they_like_before_a_target_starts():
    assert MultiTracker(WIDTH, HEIGHT, contours=ContourConfig()).longest_frame_s() == math.inf
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig())
    tracker.start("thing", Box(10, 10, 30, 30), START_NS)
    assert tracker.longest_frame_s() == math.inf


def test_a_target_that_stands_still_asks_for_nothing():
    asked = limits_s(scene_of(Waypoint(0.0, 100.0, 90.0), Waypoint(0.5, 100.0, 90.0), duration_s=0.5))
    assert {limit_s for _, _, limit_s in asked.values()} == {math.inf}


def test_a_target_asks_for_nothing_while_its_start_measures_its_motion():
    # The first look is after 5 ms; a start lasts for 3 px.
    scene = scene_of(Waypoint(0.0, 80.0, 90.0), Waypoint(0.2, 120.0, 90.0), duration_s=0.2)
    asked = limits_s(scene)
    at_first = [limit_s for time_s, (_, _, limit_s) in asked.items() if time_s < 0.012]
    assert len(at_first) > 3
    assert set(at_first) == {math.inf}
    assert list(asked.values())[-1][2] < math.inf


def limits_while_looks_fail(speed_px_s):
    """What is asked for at first while a target goes behind a pillar."""
    until_s = 150 / speed_px_s
    ways = Waypoint(0.0, 60.0, 90.0), Waypoint(until_s, 210.0, 90.0)
    scene = scene_of(*ways, duration_s=until_s, cover=(pillar(150),))
    failing = [limit for state, score, limit in limits_s(scene).values() if 0 < score < 0.5 and state is TRACKING]
    assert len(failing) >= 4
    return failing[:4]


@pytest.mark.parametrize("speed_px_s", [200.0, 600.0])
def test_a_target_asks_for_nothing_while_looks_fail(speed_px_s):
    assert set(limits_while_looks_fail(speed_px_s)) == {math.inf}


def test_a_very_fast_target_is_to_move_on_in_short_frames_while_looks_fail():
    assert max(limits_while_looks_fail(1000.0)) < 0.005


def test_a_target_that_is_lost_asks_for_nothing():
    asked = limits_s(scene_of(Waypoint(0.0, 150.0, 90.0), Waypoint(0.4, 300.0, 90.0), duration_s=0.9))
    assert any(limit_s < math.inf for _, _, limit_s in asked.values())
    lost = [limit_s for state, _, limit_s in asked.values() if state in {TargetState.RECOVERING, TargetState.LOST}]
    assert lost
    assert set(lost) == {math.inf}


def test_frames_are_never_to_be_shorter_than_three_tenths_of_a_millisecond():
    tiny_steps = ContourConfig(frame_motion=0.001)
    assert min(limit_s for _, _, limit_s in limits_s(crossing(800.0), config=tiny_steps).values()) == 0.0003


def test_targets_on_proposals_ask_for_nothing():
    tracker = MultiTracker(WIDTH, HEIGHT, TrackerConfig())
    tracker.start("thing", Box(10, 10, 30, 30), 0)
    assert tracker.longest_frame_s() == math.inf
