"""Targets that start by a click or by themselves, on simulated scenes whose truth is exact."""

import numpy as np
import pytest

from etd_ros.boxes import Box, iou
from etd_ros.engine import FrameSource, make_tracker
from etd_ros.events import concatenate
from etd_ros.settings import Settings
from etd_ros.simulation import SUITE, Path, Scene, Sprite, Waypoint, simulate
from etd_ros.simulation.textures import checks, smooth_noise
from etd_ros.simulation.things import car
from etd_ros.tracking import Click, DiscoveryConfig, TargetState, TrackingError, method_named
from etd_ros.tracking.doubts import Doubts
from etd_ros.tracking.starter import Starter
from etd_ros.tracking.target import TargetReport

START_NS = 1_700_000_000_000_000_000


def frames_of(name: str, until_s: float, method: str = "etd-plus"):
    """The scene, and the frames of its first seconds."""
    sequence = SUITE[name]
    scene = sequence.scene()
    batches = []
    for batch in sequence.events(scene, start_ns=START_NS):
        batches.append(batch)
        if len(batch) and batch.t[-1] > START_NS + until_s * 1e9:
            break
    source = FrameSource(method_named(method).conversion, sequence.width, sequence.height, Settings())
    return scene, list(source.frames(concatenate(batches)))


@pytest.fixture(scope="module")
def ball():
    return frames_of("ball", 0.7)


def tracker_of(scene, method: str = "etd-plus", **discovery):
    settings = Settings(discovery=DiscoveryConfig(**discovery))
    return make_tracker(method, scene.width, scene.height, settings, auto=True)


def clicking_tracker(scene, method: str = "etd-plus", **discovery):
    settings = Settings(discovery=DiscoveryConfig(**discovery))
    return make_tracker(method, scene.width, scene.height, settings, clicks=True)


def seconds(stamp_ns: int) -> float:
    return (stamp_ns - START_NS) / 1e9


def overlap(box: Box, truth: Box) -> float:
    return float(iou(np.array([box]), truth)[0])


@pytest.mark.parametrize("method", ["etd-plus", "etd-nr"])
def test_what_moves_becomes_one_target_soon_and_with_a_tight_box(method):
    scene, frames = frames_of("ball", 0.7, method)
    tracker = tracker_of(scene, method)
    first = None
    for frame in frames:
        for report in tracker.update(frame.stamp_ns, frame.data):
            first = first or (seconds(frame.stamp_ns), report)
    assert list(tracker.targets) == ["auto_1"]
    assert first[0] < 0.3
    assert first[1].state is TargetState.TRACKING
    assert overlap(first[1].box, scene.box("ball_1", first[0])) > 0.7


def test_what_is_a_target_already_is_not_started_again(ball):
    scene, frames = ball
    tracker = tracker_of(scene)
    tracker.start("mine", scene.box("ball_1", 0.05), START_NS + 50_000_000)
    for frame in frames:
        tracker.update(frame.stamp_ns, frame.data)
    assert list(tracker.targets) == ["mine"]


def test_no_more_targets_start_by_themselves_than_are_allowed():
    scene, frames = frames_of("crowd", 0.25)
    tracker = tracker_of(scene, max_targets=3)
    for frame in frames:
        tracker.update(frame.stamp_ns, frame.data)
    assert list(tracker.targets) == ["auto_1", "auto_2", "auto_3"]


def test_nothing_starts_by_itself_where_others_have_taken_all_places():
    scene, frames = frames_of("crowd", 0.25)
    tracker = tracker_of(scene)
    tracker.targets_max = 3
    tracker.start("mine", Box(2, 2, 10, 10), frames[-1].stamp_ns)
    tracker.click(Click("clicked", 5, 5, frames[-1].stamp_ns))
    for frame in frames[:-1]:
        tracker.update(frame.stamp_ns, frame.data)
    assert list(tracker.targets) == ["mine", "auto_1"]


def test_a_target_that_has_left_is_dropped():
    scene, frames = frames_of("exit", 1.9)
    tracker = tracker_of(scene, gone_s=0.1)
    had = set()
    for frame in frames:
        tracker.update(frame.stamp_ns, frame.data)
        had |= set(tracker.targets)
    stamp_ns = frames[-1].stamp_ns
    for step in range(1, 40):
        tracker.update(stamp_ns + step * 20_000_000, np.zeros_like(frames[0].data))
    assert had
    assert not tracker.targets


@pytest.mark.parametrize(("is_held", "said"), [(False, TargetState.RECOVERING), (True, TargetState.TRACKING)])
def test_what_vanished_behind_something_is_dropped_also_where_it_is_held(monkeypatch, is_held, said):
    if is_held:
        # As what is fast, or stops at once.
        monkeypatch.setattr(Doubts, "has_gone_behind", False)
    rng = np.random.default_rng(5)
    wall = 0.5 + 0.05 * smooth_noise(rng, 180, 240)
    way = Path([Waypoint(0, 40, 90), Waypoint(0.6, 160, 90), Waypoint(0.9, 160, 90)])
    thing = Sprite("thing", checks(rng, 24, 24, cell=6), np.ones((24, 24)), way)
    panel = Sprite("panel", np.full((180, 80), 0.5), np.ones((180, 80)), Path([Waypoint(0, 175, 90)]), is_target=False)
    scene = Scene(240, 180, 0.9, wall, (thing, panel))
    tracker = tracker_of(scene, gone_s=0.1)
    seen, unseen = set(), set()
    for frame in FrameSource("atsltd_fine", 240, 180, Settings()).frames(concatenate(list(simulate(scene, seed=1)))):
        reports = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
        seen |= {report.name for report in reports}
        unseen |= {report.state for report in reports if report.score == 0}
    assert seen == {"auto_1"}
    assert unseen == {said}
    assert not tracker.targets


def test_a_car_whose_part_was_seen_first_has_one_target_with_all_of_it():
    rng = np.random.default_rng(7)
    wall = 0.5 + 0.05 * smooth_noise(rng, 180, 240)
    texture, opacity = car(rng, 80)
    way = Path([Waypoint(0, -40, 90), Waypoint(1.0, 143, 90)])
    scene = Scene(240, 180, 1.0, wall, (Sprite("car", texture, opacity, way),))
    tracker = tracker_of(scene)
    first = None
    for frame in FrameSource("atsltd_fine", 240, 180, Settings()).frames(concatenate(list(simulate(scene, seed=1)))):
        reports = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
        if reports and first is None:
            first = overlap(reports[0].box, scene.box("car", frame.stamp_ns * 1e-9))
    [last] = reports
    assert first < 0.2
    assert last.name == "auto_1"
    assert overlap(last.box, scene.box("car", frame.stamp_ns * 1e-9)) > 0.8


@pytest.mark.parametrize("is_given", [True, False])
def test_a_swollen_box_goes_on_from_what_is_seen_unless_it_was_given(ball, is_given):
    scene, frames = ball
    starter = Starter(scene.width, scene.height, DiscoveryConfig(), auto=True)
    (ball_name,) = scene.targets
    names, again = ["given"] if is_given else [], []
    for frame in frames:
        truth = scene.box(ball_name, seconds(frame.stamp_ns))
        reports = [TargetReport(name, TargetState.TRACKING, truth.scaled(2.0), 1.0) for name in names]
        changes = starter.take(frame.stamp_ns, frame.data, reports)
        names += [name for name, _ in changes.starts]
        again += [(name, overlap(box, truth)) for name, box in changes.again]
    assert names == ["given" if is_given else "auto_1"]
    assert bool(again) != is_given
    assert all(name == "auto_1" and fit > 0.7 for name, fit in again)


def test_names_of_clicks_that_wait_are_not_given_to_anything_else(ball):
    scene, frames = ball
    tracker = make_tracker("etd-plus", scene.width, scene.height, Settings(), auto=True)
    tracker.click(Click("auto_1", 235, 170))
    with pytest.raises(TrackingError, match="'auto_1' waits for what moves at a click"):
        tracker.start("auto_1", Box(10, 10, 20, 20))
    for frame in frames:
        tracker.update(frame.stamp_ns, frame.data)
    assert list(tracker.targets) == ["auto_2"]
    assert tracker.waiting_clicks == ["auto_1"]


def test_what_started_by_itself_is_forgotten_when_time_goes_back(ball):
    scene, frames = ball
    tracker = tracker_of(scene)
    for frame in frames:
        tracker.update(frame.stamp_ns, frame.data)
    assert tracker.targets
    assert tracker.update(frames[0].stamp_ns, frames[0].data) == ()
    assert not tracker.targets


def test_noise_starts_nothing():
    tracker = make_tracker("etd-plus", 120, 90, Settings(), auto=True)
    rng = np.random.default_rng(5)
    for step in range(60):
        levels = rng.integers(1, 256, (90, 120, 2)) * (rng.random((90, 120, 2)) < 0.01)
        assert tracker.update((step + 1) * 20_000_000, levels.astype(np.uint8)) == ()


def test_a_panning_camera_starts_nothing_but_what_moves_otherwise():
    scene, frames = frames_of("exit-pan", 0.8)
    tracker = tracker_of(scene)
    started = {}
    for frame in frames:
        tracker.update(frame.stamp_ns, frame.data)
        for name, target in tracker.targets.items():
            started.setdefault(name, (seconds(frame.stamp_ns), target.start_box))
    assert started
    for time_s, box in started.values():
        assert max(overlap(box, scene.box(name, time_s)) for name in scene.targets) > 0.4


def test_a_textured_picture_that_moves_as_a_whole_starts_nothing():
    texture = np.random.default_rng(1).random((120, 160)) < 0.05
    tracker = make_tracker("etd-plus", 160, 120, Settings(), auto=True)
    for step in range(60):
        moved = np.roll(texture, step, axis=1)
        frame = np.repeat(moved[:, :, None], 2, axis=2).astype(np.uint8) * 255
        tracker.update((step + 1) * 10_000_000, frame)
        assert not tracker.targets


@pytest.mark.parametrize("method", ["etd-plus", "etd-nr"])
@pytest.mark.parametrize("off", [(0.0, 0.0), (0.3, -0.2)])
def test_the_object_round_a_click_is_tracked(method, off):
    scene, frames = frames_of("ball", 0.6, method)
    tracker = clicking_tracker(scene, method)
    box = scene.box("ball_1", 0.3)
    x, y = box.center
    tracker.click(Click("mine", x + off[0] * box.w, y + off[1] * box.h, START_NS + 300_000_000))
    first = None
    for frame in frames:
        for report in tracker.update(frame.stamp_ns, frame.data):
            first = first or (seconds(frame.stamp_ns), report)
    assert list(tracker.targets) == ["mine"]
    assert 0.3 <= first[0] < 0.5
    assert overlap(first[1].box, scene.box("ball_1", first[0])) > 0.5
    assert tracker.take_notices() == []


def test_a_thing_at_rest_before_a_moving_camera_is_tracked_from_a_click():
    scene, frames = frames_of("slide", 0.7)
    tracker = clicking_tracker(scene)
    clicked = list(scene.targets)
    for name in clicked:
        tracker.click(Click(name, *scene.box(name, 0.4).center, START_NS + 400_000_000))
    first = {}
    for frame in frames:
        for report in tracker.update(frame.stamp_ns, frame.data):
            first.setdefault(report.name, (seconds(frame.stamp_ns), report.box))
    assert sorted(first) == sorted(clicked)
    assert np.mean([overlap(box, scene.box(name, time_s)) > 0.5 for name, (time_s, box) in first.items()]) > 0.7
    assert all(0.4 < time_s < 0.6 for time_s, _ in first.values())


def test_clicks_amid_things_that_move_but_on_none_of_them_start_nothing():
    scene, frames = frames_of("crowd", 0.5)
    tracker = clicking_tracker(scene, click_wait_s=0.15)
    boxes = [scene.box(name, 0.3).scaled(1.5) for name in scene.targets]
    beside = [
        click
        for x in range(20, scene.width - 20, 20)
        for y in range(20, scene.height - 20, 20)
        if min((click := Click(f"at {x} {y}", x, y, START_NS + 300_000_000)).distance(box) for box in boxes) > 10
    ]
    for click in beside:
        tracker.click(click)
    notices = []
    for frame in frames:
        tracker.update(frame.stamp_ns, frame.data)
        notices += tracker.take_notices()
    assert len(beside) > 20
    assert len(tracker.targets) <= 0.05 * len(beside)
    assert len(notices) == len(beside) - len(tracker.targets)


def test_a_click_on_a_tracked_target_does_nothing_but_say_so(ball):
    scene, frames = ball
    tracker = clicking_tracker(scene)
    tracker.start("mine", scene.box("ball_1", 0.05), START_NS + 50_000_000)
    tracker.click(Click("again", *scene.box("ball_1", 0.4).center, START_NS + 400_000_000))
    for frame in frames:
        tracker.update(frame.stamp_ns, frame.data)
    assert list(tracker.targets) == ["mine"]
    [notice] = tracker.take_notices()
    assert notice.endswith("is on target 'mine', which is tracked already")
    assert tracker.take_notices() == []


def test_a_click_where_nothing_moves_says_so_after_its_wait(ball):
    scene, frames = ball
    tracker = clicking_tracker(scene, click_wait_s=0.2)
    tracker.click(Click("nothing", 235, 170, START_NS + 100_000_000))
    said = {}
    for frame in frames:
        tracker.update(frame.stamp_ns, frame.data)
        for notice in tracker.take_notices():
            said[notice] = seconds(frame.stamp_ns)
    assert not tracker.targets
    [(notice, at_s)] = said.items()
    assert "'nothing' at (235, 170): nothing has moved there" in notice
    assert 0.29 < at_s < 0.4


def test_a_click_that_waits_can_be_taken_back(ball):
    scene, frames = ball
    tracker = clicking_tracker(scene)
    tracker.click(Click("mine", *scene.box("ball_1", 0.3).center, START_NS + 300_000_000))
    assert tracker.waiting_clicks == ["mine"]
    tracker.stop("mine")
    for frame in frames:
        tracker.update(frame.stamp_ns, frame.data)
    assert not tracker.targets


@pytest.mark.parametrize(
    "click",
    [Click("a", -1, 5), Click("a", 5, 180), Click("a", float("nan"), 5), Click("a", 5, 5, -1), Click("a,b", 5, 5)],
)
def test_a_click_off_the_sensor_or_with_an_unusable_name_or_stamp_is_refused(ball, click):
    with pytest.raises(TrackingError):
        clicking_tracker(ball[0]).click(click)


def test_a_tracker_without_a_starter_takes_no_clicks():
    with pytest.raises(TrackingError, match="starts no targets by clicks"):
        make_tracker("etd-nr", 20, 20, Settings()).click(Click("a", 1, 1))
