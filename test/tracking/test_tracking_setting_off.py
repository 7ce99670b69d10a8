"""What rests in its start box and sets off later is followed from there; so is what has moved on before its box came,
and what stopped on its way."""

import numpy as np
import pytest
from tracked_scenes import (
    HEIGHT,
    START_NS,
    WIDTH,
    ForgetfulRecovery,
    all_at_the_end,
    frames_of,
    overlap,
    scene_of,
    tracked,
)

from etd_ros.boxes import Box
from etd_ros.recovery import Found
from etd_ros.simulation import Path, Scene, Sprite, Waypoint
from etd_ros.simulation.textures import checks, smooth_noise
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState
from etd_ros.tracking.set_off import SetOff
from etd_ros.tracking.start_up import StartUp

X, Y, SETS_OFF_S, SPEED_PX_S = 70, 90, 0.4, 120


def resting(duration_s=0.7):
    """A square that rests until it moves to the right."""
    ways = (
        Waypoint(0, X, Y),
        Waypoint(SETS_OFF_S, X, Y),
        Waypoint(duration_s, X + SPEED_PX_S * (duration_s - SETS_OFF_S), Y),
    )
    return scene_of(*ways, duration_s=duration_s)


@pytest.mark.parametrize("noise_rate_hz", [0.0, 1_000.0, 20_000.0])
def test_what_sets_off_after_it_has_rested_is_followed(noise_rate_hz):
    scene = resting()
    found = tracked(scene, start_s=0.05, frames=frames_of(scene, noise_rate_hz=noise_rate_hz))
    moving = [(report, truth) for time_s, report, truth in found if time_s > SETS_OFF_S + 0.1]
    assert {report.state for report, _ in moving} == {TargetState.TRACKING}
    assert min(overlap(report, truth) for report, truth in moving) > 0.85


def test_noise_leaves_a_start_box_where_it_is():
    scene = scene_of(Waypoint(0, X, Y), Waypoint(1, X, Y))
    found = tracked(scene, frames=frames_of(scene, noise_rate_hz=20_000.0))
    assert {report.state for _, report, _ in found} == {TargetState.TRACKING}
    assert min(overlap(report, truth) for _, report, truth in found) > 0.95


@pytest.mark.parametrize(("speed_px_s", "late_s"), [(40, 0.2), (100, 0.2), (150, 0.1)])
def test_a_box_that_comes_late_starts_what_has_moved_on_from_it(speed_px_s, late_s):
    start_s = 0.1
    scene = scene_of(Waypoint(0, 50, 70), Waypoint(0.7, 50 + 0.7 * speed_px_s, 70), duration_s=0.7)
    tracker = MultiTracker(240, 180, contours=ContourConfig(refine_gain=0.0))
    for frame in frames_of(scene):
        time_s = (frame.stamp_ns - START_NS) * 1e-9
        if time_s >= start_s + late_s and not tracker.targets:
            tracker.start("thing", scene.box("thing", start_s), START_NS + round(start_s * 1e9))
        reports = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
    assert overlap(reports[0], scene.box("thing", time_s)) > 0.75


STOPS_S, PASSES_S, LEAVES_S, UNTIL_S = 0.1, 0.2, 0.7, 1.2


def stopping(*cover):
    """A square that goes down a little, stops at once, and leaves to the left later."""

    def way(t):
        return 140 - 150 * np.clip(t - LEAVES_S, 0, None), 70 + 8 * np.clip(t / STOPS_S, 0, 1)

    surface = checks(np.random.default_rng(0), 36, 36, cell=9)
    wall = 0.5 + 0.05 * smooth_noise(np.random.default_rng(5), HEIGHT, WIDTH)
    thing = Sprite("thing", surface, np.ones(surface.shape), Path.of(way, UNTIL_S))
    return Scene(WIDTH, HEIGHT, UNTIL_S, wall, (thing, *cover))


def test_what_stood_and_sets_off_another_way_is_followed_though_its_model_knows_no_edge_along_it(monkeypatch):
    scene = stopping()
    frames = frames_of(scene)
    (_, report, truth) = tracked(scene, frames=frames)[-1]
    assert report.state is TargetState.TRACKING
    assert overlap(report, truth) > 0.85
    monkeypatch.setattr(SetOff, "take", lambda *_: False)
    (_, report, truth) = tracked(scene, frames=frames)[-1]
    assert overlap(report, truth) < 0.1


def passing(size_px=24):
    """A square that passes before it while it stands."""

    def way(t):
        return 20 + 500 * np.clip(t - PASSES_S, 0, None), 74 + 0 * t

    surface = checks(np.random.default_rng(3), size_px, size_px, cell=6)
    return Sprite("passing", surface, np.ones((size_px, size_px)), Path.of(way, UNTIL_S), is_target=False)


def test_what_passes_before_a_target_that_stands_is_not_the_target_that_sets_off():
    scene = stopping(passing())
    standing = [(report, truth) for time_s, report, truth in tracked(scene) if time_s < LEAVES_S]
    assert {report.state for report, _ in standing} == {TargetState.TRACKING}
    assert min(overlap(report, truth) for report, truth in standing) > 0.7


class Recovery(ForgetfulRecovery):
    """Sees a target in a box on every image that it is asked about, and notes when that was."""

    def __init__(self, seen):
        self.seen, self.time_s, self.asked_at_s = seen, 0.0, []

    def search(self, image, last_box):
        self.asked_at_s.append(self.time_s)
        return Found(self.seen, 0.9)


@pytest.mark.parametrize("seen", [Box(122, 60, 36, 36), Box(20, 120, 36, 36)], ids=["where it stands", "elsewhere"])
def test_what_stands_is_looked_for_on_images_once_something_has_moved_there(seen):
    scene, recovery, image = stopping(passing()), Recovery(seen), np.zeros((HEIGHT, WIDTH), np.uint8)
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig(refine_gain=0.0), recovery_factory=lambda: recovery)
    tracker.start("thing", scene.box("thing", 0.0), START_NS)
    for frame in frames_of(scene):
        recovery.time_s = (frame.stamp_ns - START_NS) * 1e-9
        if recovery.time_s < LEAVES_S:
            (report,) = tracker.update(frame.stamp_ns, frame.data, image, frame.start_ns)
    assert min(recovery.asked_at_s) > PASSES_S
    assert report.state is TargetState.TRACKING
    # Where it would be elsewhere, none of its events are: images alone are not believed.
    assert overlap(report, scene.box("thing", PASSES_S)) > 0.6


def test_no_start_is_tried_where_something_moves_round_what_stands(monkeypatch):
    tried_at_s, take = [], StartUp.take

    def noted(start_up, surface, new_events):
        tried_at_s.append((surface.stamp_ns - START_NS) * 1e-9)
        return take(start_up, surface, new_events)

    monkeypatch.setattr(StartUp, "take", noted)
    tracked(stopping(passing(90)))
    # It passes at 500 pixels/s, and its events are round the box for .1 s more.
    passed_s = PASSES_S + (140 - 20) / 500
    assert any(STOPS_S + 0.05 < time_s < PASSES_S for time_s in tried_at_s)
    assert not any(passed_s < time_s < passed_s + 0.1 for time_s in tried_at_s)


def test_what_stood_sets_off_while_another_target_passes_beside_it():
    beside = Sprite(
        "beside",
        checks(np.random.default_rng(3), 24, 24, cell=6),
        np.ones((24, 24)),
        Path.of(lambda t: (174 + 0 * t, 20 + 120 * t), UNTIL_S),
    )
    scene = stopping(beside)
    assert min(all_at_the_end(scene, frames_of(scene)).values()) > 0.8


def test_the_score_of_what_stands_fades_and_is_back_when_it_moves():
    scene = resting(duration_s=1.4)
    found = [(time_s, report.score) for time_s, report, _ in tracked(scene, start_s=0.05)]
    assert min(score for time_s, score in found if time_s < SETS_OFF_S) < 0.8
    assert found[-1][1] > 0.85


def test_a_box_on_an_empty_wall_loses_its_score_and_stays():
    scene = scene_of(Waypoint(0, X, Y), Waypoint(1.5, X, Y), duration_s=1.5)
    empty = Box(150, 20, 30, 30)
    (_, report, _) = tracked(scene, empty, frames=frames_of(scene, noise_rate_hz=5_000.0))[-1]
    assert report.box == empty
    assert report.state is TargetState.TRACKING
    assert 0 < report.score < 0.3


def test_a_box_that_starts_with_the_next_frame_has_its_score_from_the_first():
    scene = scene_of(Waypoint(0, X, Y), Waypoint(0.5, X + 60, Y), duration_s=0.5)
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig(refine_gain=0.0))
    tracker.start("thing", scene.box("thing", 0.0))
    frame = frames_of(scene)[0]
    (report,) = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
    assert report.score == 1.0


def test_what_is_held_sets_off_after_the_stream_has_started_again(monkeypatch):
    monkeypatch.setattr("etd_ros.tracking.multi_tracker.starts_again", lambda *_: False)
    scene, later_ns = stopping(), 5_000_000_000
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig(refine_gain=0.0))
    tracker.start("thing", scene.box("thing", 0.0), START_NS + later_ns)
    frames = frames_of(scene)
    for frame in frames:
        if frame.stamp_ns < START_NS + LEAVES_S * 1e9:
            tracker.update(frame.stamp_ns + later_ns, frame.data, start_ns=frame.start_ns + later_ns)
    for frame in frames:
        if frame.stamp_ns > START_NS + (STOPS_S + 0.2) * 1e9:
            (report,) = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
    assert overlap(report, scene.box("thing", UNTIL_S)) > 0.8
