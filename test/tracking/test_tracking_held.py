"""What has no events for a moment stands still, unless it was so fast that it moves on."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from tracked_scenes import (
    HEIGHT,
    START_NS,
    WIDTH,
    ForgetfulRecovery,
    frames_without_it,
    overlap,
    scene_of,
    tracked,
)

from etd_ros.boxes import Box
from etd_ros.recovery import Found
from etd_ros.simulation import Waypoint
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState, turns
from etd_ros.tracking.body import Body
from etd_ros.tracking.contour_search import ContourSearch
from etd_ros.tracking.held import MOVES_ON_S, Held, moving_on
from etd_ros.tracking.image_search import ImageSearch
from etd_ros.tracking.surface import TimeSurface

SEEN_UNTIL_S = 0.08
EMPTY = np.zeros((HEIGHT, WIDTH, 2), np.uint8)


def crossing(speed_px_s, duration_s=0.14):
    return scene_of(Waypoint(0.0, 40.0, 90.0), Waypoint(1.0, 40.0 + speed_px_s, 90.0), duration_s=duration_s)


def test_the_box_of_a_fast_target_moves_on_without_events_and_is_followed_when_they_are_back():
    scene = crossing(900.0)
    found = tracked(scene, frames=frames_without_it(scene, SEEN_UNTIL_S, SEEN_UNTIL_S + 0.02))
    unseen = [(report, truth) for _, report, truth in found if report.score == 0.0]
    assert unseen
    assert all(report.state is TargetState.TRACKING for report, _ in unseen)
    assert min(overlap(report, truth) for report, truth in unseen) > 0.7
    last_seen, first_unseen = next(
        pair for pair in pairwise(report.box.center for _, report, _ in found) if pair[1] == unseen[0][0].box.center
    )
    assert 0 < first_unseen[0] - last_seen[0] < 900.0 * 0.006
    _, report, truth = found[-1]
    assert report.score > 0
    assert overlap(report, truth) > 0.7


def test_a_slow_target_without_events_stands_still():
    scene = crossing(150.0, duration_s=0.5)
    found = tracked(scene, frames=frames_without_it(scene, 0.3))
    boxes = [report.box for _, report, _ in found if report.score == 0.0]
    assert boxes
    assert set(boxes) == {boxes[0]}
    assert boxes[0].center == pytest.approx(scene.box("thing", 0.3).center, abs=3.0)


def test_a_fast_target_that_stays_without_events_is_said_to_be_where_it_was_seen_surely():
    scene = crossing(900.0, duration_s=SEEN_UNTIL_S + 2 * MOVES_ON_S)
    found = tracked(scene, frames=frames_without_it(scene, SEEN_UNTIL_S))
    _, last, _ = found[-1]
    assert last.state is TargetState.TRACKING
    assert last.box.center == pytest.approx(scene.box("thing", SEEN_UNTIL_S).center, abs=4.0)


def test_a_box_moves_on_as_long_as_that_is_believed_and_on_the_sensor():
    surface = TimeSurface(WIDTH, HEIGHT)
    stopped, moving = Box(50, 50, 20, 20), Box(60, 50, 20, 20)
    held = Held(stopped, (moving, 1000.0, -100.0), START_NS, surface)
    assert held.box_at(START_NS) == moving
    assert held.box_at(START_NS + 50_000_000) == Box(110, 45, 20, 20)
    assert held.box_at(START_NS + round(MOVES_ON_S * 1e9) + 1) == stopped
    over_the_border = Held(stopped, (moving, 2000.0, 0.0), START_NS, surface)
    assert over_the_border.box_at(START_NS + 80_000_000) == Box(220, 50, 20, 20)
    assert over_the_border.box_at(START_NS + 90_000_000) == stopped
    assert Held(stopped, None, START_NS, surface).box_at(START_NS + 50_000_000) == stopped


def test_a_box_that_was_moving_on_stays_where_it_was_when_the_clock_goes_back():
    scene = crossing(900.0, duration_s=SEEN_UNTIL_S + 0.05)
    frames = frames_without_it(scene, SEEN_UNTIL_S)
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig())
    tracker.start("thing", scene.box("thing", 0.0))
    for frame in frames:
        (before,) = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
    assert before.score == 0.0
    boxes = [tracker.update(START_NS + 5_000_000 * k, EMPTY)[0].box for k in range(1, 40)]
    assert set(boxes) == {boxes[0]}
    # It is held where it was before its last sure look: two of them, 2 ms each, and a frame of 1 ms ago.
    assert boxes[0].center == pytest.approx(scene.box("thing", SEEN_UNTIL_S).center, abs=900.0 * 0.005)


def test_only_what_moves_by_eight_times_its_size_in_a_second_moves_on():
    body = Body(Box(50, 50, 20, 20), START_NS)
    body.velocity = 0.0, 159.0
    assert moving_on(body, START_NS + 10_000_000) is None
    body.velocity = 0.0, 200.0
    assert moving_on(body, START_NS + 10_000_000) == (Box(50, 52, 20, 20), 0.0, 200.0)


class Watching(ForgetfulRecovery):
    """Recovery that sees on images where a square is, and is asked where one that is followed may be elsewhere."""

    def __init__(self, scene):
        self.scene, self.time_s = scene, 0.0

    def watch(self):
        return self

    def search(self, image, last_box):
        return Found(self.scene.box("thing", self.time_s), 0.9)


@pytest.mark.parametrize("is_watched", [True, False])
def test_what_is_held_and_is_seen_elsewhere_on_images_is_followed_there(monkeypatch, is_watched):
    monkeypatch.setattr(turns, "WATCH_NS", 50_000_000 if is_watched else 10_000_000_000)
    # What is lost would be found, too.
    monkeypatch.setattr(ImageSearch, "found", lambda *_: None)
    monkeypatch.setattr(ContourSearch, "found", lambda *_: False)
    scene = scene_of(Waypoint(0.0, 30.0, 90.0), Waypoint(1.9, 220.0, 90.0), duration_s=1.9)
    recovery = Watching(scene)
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig(refine_gain=0.0), recovery_factory=lambda: recovery)
    tracker.start("thing", scene.box("thing", 0.0), START_NS)
    states = set()
    for frame in frames_without_it(scene, 0.3, 1.4):
        recovery.time_s = (frame.stamp_ns - START_NS) * 1e-9
        (report,) = tracker.update(frame.stamp_ns, frame.data, np.zeros((HEIGHT, WIDTH), np.uint8), frame.start_ns)
        states.add(report.state)
    assert states == {TargetState.TRACKING}
    assert (overlap(report, scene.box("thing", recovery.time_s)) > 0.7) == is_watched
