"""What lies in the box of another target is taken for that one's."""

from __future__ import annotations

import numpy as np
import pytest
from tracked_scenes import HEIGHT, START_NS, WIDTH, ForgetfulRecovery, all_at_the_end, frames_of, scene_of

from etd_ros.boxes import Box
from etd_ros.recovery import Found
from etd_ros.simulation import Path, Scene, Sprite, Waypoint
from etd_ros.simulation.textures import checks, smooth_noise
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState
from etd_ros.tracking.contour_kernels import AGE, X, Y
from etd_ros.tracking.look import Look
from etd_ros.tracking.other_targets import CHECK_S, FREE_MIN, OtherBoxes, OtherTargets, Place, keep_outside

OWN = Box(100.0, 100.0, 40.0, 20.0)


class Placed:
    """A target that says where it is."""

    def __init__(self, box, velocity=(0.0, 0.0)):
        self.box, self.velocity, self.others = box, velocity, OtherBoxes()
        self.is_beginning, self.has_events = False, True

    def begins(self, _stamp_ns):
        return self.is_beginning

    def place(self, _stamp_ns):
        return None if self.box is None else Place(self.box, self.velocity, self.has_events)


def noted(*boxes, velocities=None, own=OWN):
    """What a target knows of others with these boxes."""
    velocities = [(0.0, 0.0)] * len(boxes) if velocities is None else velocities
    targets = [Placed(own), *(Placed(Box(*box), velocity) for box, velocity in zip(boxes, velocities, strict=True))]
    OtherTargets().take(START_NS, targets)
    return targets[0].others


def points_at(*places, age_s=0.0):
    return np.array([(x, y, age_s, 1) for x, y in places], np.float32)


@pytest.mark.parametrize("since_s", [0.0, 0.01])
def test_points_are_kept_that_lie_in_no_box_as_it_moves(since_s):
    rng = np.random.default_rng(3)
    points = np.asarray(rng.random((500, 4)) * (100, 100, 0.05, 1), np.float32)
    moving = np.array([[10.0, 20.0, 30.0, 40.0, 300.0, -200.0], [60.0, 50.0, 20.0, 30.0, 0.0, 100.0]])
    at_s = since_s - points[:, AGE, None].astype(np.float64)
    across = points[:, X, None] - moving[:, 4] * at_s - moving[:, 0]
    down = points[:, Y, None] - moving[:, 5] * at_s - moving[:, 1]
    is_inside = (across > 0) & (across < moving[:, 2]) & (down > 0) & (down < moving[:, 3])
    expected = points[~is_inside.any(1)]
    assert 0 < len(expected) < len(points)
    kept = keep_outside(points, len(points), moving, since_s)
    np.testing.assert_array_equal(points[:kept], expected)


def test_points_beyond_the_count_are_not_looked_at():
    points = points_at((0, 0), (5, 5), (0, 0))
    assert keep_outside(points, 2, np.array([[4.0, 4.0, 2.0, 2.0, 0.0, 0.0]]), 0.0) == 1


def test_where_there_are_no_others_all_events_are_its_own():
    others = OtherBoxes()
    assert others.free == 1
    assert others.leave_out(points_at((110, 110), (120, 110)), 2, START_NS) == 2


def test_the_events_in_the_box_of_another_target_are_left_out():
    others = noted((130, 100, 40, 20))
    assert others.free == pytest.approx(0.75)
    points = points_at((110, 110), (135, 110))
    assert others.leave_out(points, 2, START_NS) == 1
    assert tuple(points[0, :2]) == (110, 110)


def test_an_event_is_of_another_target_where_that_was_then():
    others = noted((130, 100, 40, 20), velocities=[(1000.0, 0.0)])
    assert others.leave_out(points_at((135, 110)), 1, START_NS) == 0
    assert others.leave_out(points_at((135, 110)), 1, START_NS + 10_000_000) == 1
    assert others.leave_out(points_at((125, 110), age_s=0.01), 1, START_NS) == 0


def test_a_target_that_does_not_reach_into_the_box_is_left_out_beside_it():
    others = noted((150, 100, 40, 20))
    assert others.free == 1
    assert others.leave_out(points_at((160, 110)), 1, START_NS) == 0


def test_a_target_that_is_far_away_is_nothing_to_it():
    others = noted((181, 100, 40, 20))
    assert others.leave_out(points_at((190, 110)), 1, START_NS) == 1


def test_where_others_would_leave_too_little_all_events_are_its_own():
    covered = 40 * (1 - FREE_MIN) + 1
    others = noted((100, 100, covered, 20))
    assert others.free == 1
    assert others.leave_out(points_at((110, 110)), 1, START_NS) == 1


def test_targets_are_told_where_the_others_are_and_not_where_they_are_themselves():
    one, unknown, other = Placed(OWN), Placed(None), Placed(Box(130.0, 100.0, 40.0, 20.0))
    OtherTargets().take(START_NS, (one, unknown, other))
    assert one.others.free == other.others.free == pytest.approx(0.75)
    assert unknown.others.free == 1


def test_who_stands_is_told_of_the_others_and_nothing_to_them():
    passing, standing = Placed(OWN), Placed(Box(130.0, 100.0, 40.0, 20.0))
    standing.has_events = False
    OtherTargets().take(START_NS, (passing, standing))
    assert standing.others.free == pytest.approx(0.75)
    assert passing.others.leave_out(points_at((135, 110)), 1, START_NS) == 1


def test_who_stands_is_told_of_the_others_that_stand():
    one, other = Placed(OWN), Placed(Box(130.0, 100.0, 40.0, 20.0))
    one.has_events = other.has_events = False
    OtherTargets().take(START_NS, (one, other))
    assert one.others.free == other.others.free == pytest.approx(0.75)


@pytest.mark.parametrize("begins", [False, True])
def test_targets_are_compared_now_and_then_and_where_one_begins(begins):
    one, other = Placed(OWN), Placed(Box(130.0, 100.0, 40.0, 20.0))
    watch = OtherTargets()
    watch.take(START_NS, (one, other))
    other.box, other.is_beginning = Box(120.0, 100.0, 40.0, 20.0), begins
    watch.take(START_NS + 1_000_000, (one, other))
    assert one.others.free == pytest.approx(0.5 if begins else 0.75)
    watch.take(START_NS + 1_000_000 + round(CHECK_S * 1e9), (one, other))
    assert one.others.free == pytest.approx(0.5)


def test_where_time_went_back_targets_are_compared_at_once():
    one, other = Placed(OWN), Placed(Box(130.0, 100.0, 40.0, 20.0))
    watch = OtherTargets()
    watch.take(START_NS, (one, other))
    other.box = Box(120.0, 100.0, 40.0, 20.0)
    watch.take(START_NS - 1_000_000, (one, other))
    assert one.others.free == pytest.approx(0.5)


def test_a_target_that_is_left_alone_has_all_of_its_box_to_itself():
    one, other = Placed(OWN), Placed(Box(130.0, 100.0, 40.0, 20.0))
    watch = OtherTargets()
    watch.take(START_NS, (one, other))
    watch.take(START_NS, (one,))
    assert one.others.free == 1


def test_a_target_whose_start_is_still_to_come_is_nothing_to_others():
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig(refine_gain=0.0))
    tracker.start("now", Box(100.0, 60.0, 40.0, 40.0), START_NS)
    tracker.start("later", Box(120.0, 60.0, 40.0, 40.0), START_NS + 20_000_000)
    nothing = np.zeros((HEIGHT, WIDTH, 2), np.uint8)
    tracker.update(START_NS + 10_000_000, nothing)
    assert tracker.targets["now"].others.free == tracker.targets["later"].others.free == 1
    tracker.update(START_NS + 25_000_000, nothing)
    assert tracker.targets["now"].others.free == tracker.targets["later"].others.free == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("box", "since_s", "is_other"),
    [
        ((130.0, 100.0, 40.0, 20.0), 0.0, True),
        ((140.0, 100.0, 40.0, 20.0), 0.0, True),
        ((150.0, 100.0, 40.0, 20.0), 0.0, False),
        ((150.0, 100.0, 40.0, 20.0), 0.1, True),
        ((130.0, 100.0, 40.0, 20.0), 0.1, False),
    ],
)
def test_what_is_found_where_another_target_is_by_then_is_that_one(box, since_s, is_other):
    lost, followed, standing = Placed(None), Placed(Box(130.0, 100.0, 40.0, 20.0), (200.0, 0.0)), Placed(OWN)
    standing.has_events = False
    OtherTargets().take(START_NS, (lost, followed, standing))
    stamp_ns = START_NS + round(since_s * 1e9)
    assert lost.others.has(Box(*box), stamp_ns) == is_other
    assert not lost.others.has(OWN, stamp_ns)
    OtherTargets().take(START_NS, (lost,))
    assert not lost.others.has(Box(*box), stamp_ns)


class SeesTheNext(ForgetfulRecovery):
    """Recovery that finds on images what follows, as that looks like what has left."""

    def __init__(self, scene):
        self.scene, self.time_s = scene, 0.0

    def search(self, image, last_box):
        return Found(self.scene.box("next", self.time_s), 0.9)


@pytest.mark.parametrize("is_told", [True, False])
def test_what_has_left_is_not_found_again_where_another_target_is_followed(monkeypatch, is_told):
    if not is_told:
        monkeypatch.setattr(OtherBoxes, "has", lambda *_: False)
    rng = np.random.default_rng(2)
    wall, surface = 0.5 + 0.05 * smooth_noise(rng, HEIGHT, WIDTH), checks(rng, 34, 34, cell=8)
    paths = {name: Path((Waypoint(0, x, 80), Waypoint(1, x + 150, 80))) for name, x in (("first", 180), ("next", 90))}
    scene = Scene(WIDTH, HEIGHT, 0.9, wall, tuple(Sprite(n, surface, np.ones((34, 34)), p) for n, p in paths.items()))
    recovery = SeesTheNext(scene)
    contours = ContourConfig(refine_gain=0.0)
    tracker = MultiTracker(WIDTH, HEIGHT, contours=contours, recovery_factory=lambda: recovery)
    for name in paths:
        tracker.start(name, scene.box(name, 0.0), START_NS)
    states = set()
    for frame in frames_of(scene):
        recovery.time_s = (frame.stamp_ns - START_NS) * 1e-9
        image = np.zeros((HEIGHT, WIDTH), np.uint8)
        first, following = tracker.update(frame.stamp_ns, frame.data, image, frame.start_ns)
        if recovery.time_s > 0.6:
            states.add(first.state)
    assert following.state is TargetState.TRACKING
    assert (TargetState.TRACKING not in states) == is_told


def beside_each_other():
    """A square that another one covers a part of from the start on, and moves away from it."""
    rng = np.random.default_rng(0)
    wall = 0.5 + 0.05 * smooth_noise(rng, HEIGHT, WIDTH)
    sprites = []
    for name, (x, y), (right, down) in (("back", (100, 70), (60, 25)), ("front", (122, 64), (0, 150))):
        surface = checks(rng, 34, 34, cell=8)
        path = Path((Waypoint(0, x, y), Waypoint(0.5, x + right / 2, y + down / 2)))
        sprites.append(Sprite(name, surface, np.ones(surface.shape), path))
    return Scene(WIDTH, HEIGHT, 0.5, wall, tuple(sprites))


def test_of_two_that_overlap_when_they_start_none_is_drawn_along_by_the_other(monkeypatch):
    scene = beside_each_other()
    frames = frames_of(scene)
    assert min(all_at_the_end(scene, frames).values()) > 0.8
    monkeypatch.setattr(OtherTargets, "take", lambda *_: None)
    assert all_at_the_end(scene, frames)["back"] < 0.5


def confidence_of_a_look(*, is_covered):
    """That of one and the same look, at a square that moved by itself or half in the box of another target."""
    scene = scene_of(Waypoint(0, 60, 90), Waypoint(1, 160, 90))
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig(refine_gain=0.0))
    box = scene.box("thing", 0.0)
    tracker.start("thing", box, START_NS)
    if is_covered:
        tracker.start("upper half", box._replace(y=box.y - box.h / 2), START_NS)
    for frame in frames_of(scene):
        tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
    thing = tracker.targets["thing"]
    assert (thing.others.free < 0.7) == is_covered
    return thing._following.usual.confidence(Look(0, 0, 1e6, 100.0, 1.0, (1.0, 0.0)))


def test_what_is_usual_stays_that_of_the_whole_box_while_another_target_reaches_into_it():
    assert confidence_of_a_look(is_covered=True) == pytest.approx(confidence_of_a_look(is_covered=False), rel=0.2)
