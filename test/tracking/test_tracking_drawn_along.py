"""Of two targets that pass each other one is not drawn along by the other."""

from __future__ import annotations

import numpy as np
import pytest
from tracked_scenes import HEIGHT, START_NS, WIDTH, all_at_the_end, frames_of

from etd_ros.boxes import Box
from etd_ros.simulation import Path, Scene, Sprite, Waypoint
from etd_ros.simulation.textures import checks, smooth_noise
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState
from etd_ros.tracking.body import Standing
from etd_ros.tracking.drawn_along import GIVE_UP_S, MET_S, SEEN_MIN, SEEN_SHARE, DrawnAlong
from etd_ros.tracking.last_clear import LastClear

STEP_S = 0.01


def crossing(speed_px_s, other_px_s, duration_s):
    """Two squares along a row, one before the other in the middle of the time."""
    rng = np.random.default_rng(0)
    wall = 0.5 + 0.05 * smooth_noise(rng, HEIGHT, WIDTH)
    sprites = []
    for name, speed in (("back", speed_px_s), ("front", other_px_s)):
        surface = checks(rng, 34, 34, cell=8)
        reach = speed * duration_s / 2
        path = Path((Waypoint(0, WIDTH / 2 - reach, 90), Waypoint(duration_s, WIDTH / 2 + reach, 90)))
        sprites.append(Sprite(name, surface, np.ones(surface.shape), path))
    return Scene(WIDTH, HEIGHT, duration_s, wall, tuple(sprites))


@pytest.mark.parametrize(("speed_px_s", "other_px_s"), [(100.0, -100.0), (120.0, -40.0)])
def test_the_target_that_another_one_hides_while_they_pass_is_found_on_its_own_way(monkeypatch, speed_px_s, other_px_s):
    scene = crossing(speed_px_s, other_px_s, 150 / abs(speed_px_s - other_px_s))
    frames = frames_of(scene)
    assert min(all_at_the_end(scene, frames).values()) > 0.85
    monkeypatch.setattr(DrawnAlong, "take", lambda *_: None)
    monkeypatch.setattr(LastClear, "has_strayed", False)
    drawn = all_at_the_end(scene, frames)
    assert drawn["front"] > 0.85
    assert drawn["back"] < 0.1


class Walker:
    """What is followed at a place, with a velocity along a row.

    Attributes:
        seen_as: how surely it is seen where it is, by what it looked like; else 1.0 as it looks now, .2 otherwise.
        seen_elsewhere: how surely it is seen where it is not.
    """

    def __init__(self, name, x, speed_px_s, y=65.0):
        self.name = name
        self.x, self.y, self.speed_px_s = x, y, speed_px_s
        self.is_followed = self.is_sure = True
        self.stamp_ns = self.followed_since_ns = START_NS
        self.impression = f"{name} at first"
        self.went_back = []
        self.seen_as = {}
        self.seen_elsewhere = 0.2

    def confidence_as(self, impression, place):
        if place.pose[1] != self.y:
            return self.seen_elsewhere
        return self.seen_as.get(impression, 0.2 if impression != self.impression else 1.0)

    @property
    def last_box(self):
        return Box(self.x, 50.0, 30.0, 30.0)

    @property
    def standing(self):
        return Standing(self.stamp_ns, (self.x, self.y, 1.0, 0.0), (self.speed_px_s, 0.0))

    def go_back(self, stamp_ns, standing, impression):
        self.went_back.append((stamp_ns, standing, impression))


class Walk:
    """Walkers, and what watches them."""

    def __init__(self, *walkers):
        self.walkers = walkers
        self.watch = DrawnAlong()
        self.stamp_ns = START_NS

    def go(self, duration_s):
        for _ in range(round(duration_s / STEP_S)):
            self.stamp_ns += round(STEP_S * 1e9)
            for walker in self.walkers:
                walker.x += walker.speed_px_s * STEP_S
                walker.stamp_ns = self.stamp_ns
            self.watch.take(self.stamp_ns, self.walkers)


def met():
    """Two that have been clear of each other, and that meet now: `hidden` moves as the other one does from here on."""
    hidden, other = Walker("hidden", 50.0, 60.0), Walker("other", 120.0, -60.0, y=66.0)
    walk = Walk(hidden, other)
    walk.go(0.3)
    hidden.x, hidden.speed_px_s = other.x, other.speed_px_s
    hidden.impression = "hidden as the other one"
    return walk, hidden, other


def test_the_one_that_looks_otherwise_now_goes_back_to_where_and_what_it_was_when_it_was_clear():
    walk, hidden, other = met()
    clear_ns = walk.stamp_ns
    walk.go(MET_S)
    assert not hidden.went_back
    walk.go(2 * STEP_S)
    ((stamp_ns, standing, impression),) = hidden.went_back
    assert stamp_ns > clear_ns + MET_S * 1e9
    assert standing.stamp_ns == clear_ns
    assert standing.pose[0] == pytest.approx(50.0 + 0.3 * 60.0)
    assert standing.velocity[0] == pytest.approx(60.0)
    assert impression == "hidden at first"
    assert not other.went_back


def test_the_one_that_changed_its_motion_stays_where_it_is_the_other_that_looks_otherwise():
    walk, hidden, other = met()
    hidden.seen_as["hidden at first"], other.seen_as["other at first"] = 1.0, 0.5
    walk.go(2 * MET_S)
    assert other.went_back
    assert not hidden.went_back


@pytest.mark.parametrize("seen", [(SEEN_MIN, 1.0), (0.5, 0.5 / SEEN_SHARE)], ids=["both are seen", "as well"])
def test_two_that_are_seen_as_they_looked_when_they_were_clear_are_left_alone(seen):
    walk, hidden, other = met()
    hidden.seen_as["hidden at first"], other.seen_as["other at first"] = seen
    walk.go(0.5)
    assert not hidden.went_back + other.went_back


def test_of_two_that_look_alike_the_one_that_changed_its_motion_goes_back():
    walk, hidden, other = met()
    hidden.seen_as["hidden at first"] = other.seen_as["other at first"] = other.seen_elsewhere = 1.0
    walk.go(2 * MET_S)
    assert hidden.went_back
    assert not other.went_back


def test_two_that_walk_together_from_the_start_are_left_alone():
    one, other = Walker("one", 50.0, 60.0), Walker("other", 55.0, 60.0)
    Walk(one, other).go(0.5)
    assert not one.went_back + other.went_back


def test_two_that_come_together_slowly_are_left_alone():
    one, other = Walker("one", 50.0, 60.0), Walker("other", 90.0, 45.0)
    walk = Walk(one, other)
    walk.go(0.3)
    one.x, one.speed_px_s = other.x, other.speed_px_s
    walk.go(0.5)
    assert not one.went_back + other.went_back


def test_two_that_pass_each_other_at_their_own_speeds_are_left_alone():
    one, other = Walker("one", 50.0, 60.0), Walker("other", 120.0, -60.0)
    Walk(one, other).go(1.5)
    assert not one.went_back + other.went_back


def test_what_is_found_with_the_other_again_and_again_for_a_second_stays_with_it():
    walk, hidden, _ = met()
    walk.go(GIVE_UP_S + 0.1)
    gone_back = len(hidden.went_back)
    assert gone_back > 5
    walk.go(GIVE_UP_S)
    assert len(hidden.went_back) == gone_back


def test_what_was_given_up_counts_anew_once_it_has_been_clear_of_the_other():
    walk, hidden, other = met()
    walk.go(GIVE_UP_S + 0.1)
    gone_back = len(hidden.went_back)
    hidden.x, hidden.speed_px_s = other.x - 80.0, 60.0
    walk.go(0.3)
    hidden.x, hidden.speed_px_s = other.x, other.speed_px_s
    hidden.impression = "hidden as the other one again"
    walk.go(2 * MET_S)
    assert len(hidden.went_back) > gone_back


def forget(walk):
    walk.watch.forget("hidden")


def go_back_in_time(walk):
    walk.stamp_ns = START_NS // 2
    walk.watch.time_went_back(walk.stamp_ns)


@pytest.mark.parametrize("interrupt", [forget, go_back_in_time])
def test_where_a_target_was_before_it_started_again_or_time_went_back_does_not_count(interrupt):
    walk, hidden, _ = met()
    interrupt(walk)
    walk.go(0.5)
    assert not hidden.went_back


@pytest.mark.parametrize("what", ["is_followed", "is_sure"])
def test_where_it_was_lost_or_doubted_it_was_not_clear(what):
    one, other = Walker("one", 50.0, 60.0), Walker("other", 120.0, -60.0)
    walk = Walk(one, other)
    setattr(one, what, False)
    walk.go(0.3)
    setattr(one, what, True)
    one.x, one.speed_px_s = other.x, other.speed_px_s
    walk.go(0.5)
    assert not one.went_back + other.went_back


def test_a_target_that_goes_back_is_looked_for_from_there():
    scene = crossing(100.0, -100.0, 0.3)
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig(refine_gain=0.0))
    tracker.start("back", scene.box("back", 0.0), START_NS)
    for frame in frames_of(scene):
        tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
    target = tracker.targets["back"]
    standing, impression = target.standing, target.impression
    target.go_back(frame.stamp_ns + 1, standing, impression)
    assert target.state is TargetState.RECOVERING
    assert not target.is_followed
    assert target.standing.pose == standing.pose


def test_what_has_started_again_since_does_not_go_back_to_before_that():
    walk, hidden, other = met()
    hidden.followed_since_ns = walk.stamp_ns
    walk.go(2 * MET_S)
    assert not hidden.went_back
    assert not other.went_back
