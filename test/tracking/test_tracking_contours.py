"""Targets of `etd-plus` on simulated sequences: moving, standing still, turning back, hidden, leaving."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tracked_scenes import (
    HEIGHT,
    SIZE,
    START_NS,
    WIDTH,
    events_of,
    frames_from,
    frames_of,
    overlap,
    pillar,
    scene_of,
    tracked,
)

from etd_ros.boxes import Box
from etd_ros.conversion import AtsltdConfig
from etd_ros.engine import FrameSource
from etd_ros.events import Events
from etd_ros.settings import Settings
from etd_ros.simulation import Flicker, Path, Recipe, Sprite, Waypoint, make_scene
from etd_ros.simulation.textures import checks
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState, coherent_motions, steady_motion
from etd_ros.tracking.contour_drawing import climbed
from etd_ros.tracking.contours import Contours
from etd_ros.tracking.errors import TrackingError
from etd_ros.tracking.last_clear import LastClear


def test_a_target_is_followed_from_the_start():
    found = tracked(scene_of(Waypoint(0, 50, 60), Waypoint(1, 190, 120)))
    assert min(overlap(report, truth) for _, report, truth in found) > 0.75
    assert np.mean([overlap(report, truth) for _, report, truth in found]) > 0.85
    assert {report.state for _, report, _ in found} == {TargetState.TRACKING}
    assert {type(report.score) for _, report, _ in found} == {float}, "written as a number everywhere"


def test_a_target_that_turns_back_is_followed():
    found = tracked(
        scene_of(Waypoint(0, 60, 90), Waypoint(0.5, 140, 90), Waypoint(1, 60, 90), duration_s=1.0),
    )
    assert min(overlap(report, truth) for _, report, truth in found) > 0.7


def test_a_target_that_stands_still_keeps_its_box_and_state():
    ways = [Waypoint(t, 60 + 100 * min(t, 0.4), 90) for t in np.arange(0, 1.01, 0.05)]
    found = tracked(scene_of(*ways))
    time_s, report, truth = found[-1]
    assert time_s > 0.9
    assert report.state is TargetState.TRACKING
    assert overlap(report, truth) > 0.85


def test_a_target_that_shrinks_and_grows_keeps_a_fitting_box():
    found = tracked(
        scene_of(Waypoint(0, 60, 60, 1.0), Waypoint(1, 160, 100, 0.7), Waypoint(2, 80, 100, 1.2), duration_s=2.0)
    )
    assert np.mean([overlap(report, truth) for _, report, truth in found]) > 0.8


def test_a_target_that_turns_does_not_drag_its_box_away():
    ways = [Waypoint(t, 60 + 100 * t, 90, 1.0, 2.0 * t) for t in np.arange(0, 1.01, 0.05)]
    found = tracked(scene_of(*ways))
    _, report, truth = found[-1]
    assert max(truth.w for _, _, truth in found) > 1.35 * SIZE
    assert np.hypot(*np.subtract(report.box.center, truth.center)) < 2.0
    upright = tracked(scene_of(*ways), config=ContourConfig(angle_gain=0.0))
    assert np.hypot(*np.subtract(upright[-1][1].box.center, truth.center)) > 5.0


def test_the_box_of_a_long_target_turns_with_it():
    rng = np.random.default_rng(5)
    ways = [Waypoint(t, 60 + 100 * t, 90, 1.0, 1.6 * t) for t in np.arange(0, 1.01, 0.05)]
    scene = scene_of(*ways)
    thing = Sprite("thing", checks(rng, 24, 56, cell=8), np.ones((24, 56)), Path(ways))
    found = tracked(replace(scene, sprites=(thing,)))
    _, report, truth = found[-1]
    assert truth.h > 2 * truth.w
    assert overlap(report, truth) > 0.75


def test_a_target_that_does_not_turn_keeps_the_proportions_of_its_box():
    found = tracked(scene_of(Waypoint(0, 50, 60), Waypoint(1, 190, 120)), Box(32, 44, 36, 30))
    assert all(report.box.w / report.box.h == pytest.approx(1.2, rel=0.05) for _, report, _ in found)


def test_a_target_that_passes_behind_a_pillar_is_found_again_with_its_name():
    scene = scene_of(Waypoint(0, 30, 90), Waypoint(1.2, 210, 90), duration_s=1.2, cover=(pillar(125),))
    found = tracked(scene)
    hidden = [time_s for time_s, _, _ in found if scene.visible_share("thing", time_s) < 0.1]
    after = [(report, truth) for time_s, report, truth in found if time_s > max(hidden) + 0.25]
    assert hidden
    assert after
    assert all(overlap(report, truth) > 0.5 for report, truth in after)


def test_a_target_that_leaves_is_lost_within_a_fifth_of_a_second():
    scene = scene_of(Waypoint(0, 140, 90), Waypoint(1.0, 340, 90), duration_s=1.4)
    found = tracked(scene)
    gone_s = next(time_s for time_s in np.arange(0, 1.4, 0.005) if scene.box("thing", time_s).x >= WIDTH)
    assert all(report.box is None for time_s, report, _ in found if time_s > gone_s + 0.2)
    assert found[-1][1].state in (TargetState.LOST, TargetState.RECOVERING)


def test_a_target_that_left_comes_back_over_the_border():
    ways = [Waypoint(0, 140, 90), Waypoint(0.5, 290, 90), Waypoint(0.8, 290, 90), Waypoint(1.3, 140, 90)]
    scene = scene_of(*ways, duration_s=1.3)
    found = tracked(scene)
    inside = [time_s for time_s, _, truth in found if time_s > 0.8 and truth.x + truth.w < WIDTH - 2]
    back = [(report, truth) for time_s, report, truth in found if time_s > inside[0] + 0.1]
    assert all(overlap(report, truth) > 0.5 for report, truth in back)


@pytest.mark.parametrize("gap_s", [0.04, 0.09, 0.15])
def test_a_target_that_turns_while_frames_are_missing_is_found_again(gap_s):
    ways = [
        Waypoint(t, WIDTH / 2 + 50 * np.cos(2 * np.pi * t), HEIGHT / 2 + 50 * np.sin(2 * np.pi * t))
        for t in np.arange(0, 1.31, 0.01)
    ]
    found = tracked(scene_of(*ways, duration_s=1.3), unseen_s=(0.8, 0.8 + gap_s))
    after = [overlap(report, truth) for time_s, report, truth in found if time_s > 0.8 + gap_s + 0.1]
    assert min(after) > 0.7


def test_a_lost_target_is_looked_for_on_long_frames_too():
    scene = scene_of(Waypoint(0, 30, 90), Waypoint(1.2, 210, 90), duration_s=1.2, cover=(pillar(125),))
    settings = Settings(atsltd=AtsltdConfig(fine_max_duration_s=0.03, fine_min_duration_s=0.025))
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig())
    tracker.start("thing", scene.box("thing", 0.0), START_NS)
    for frame in FrameSource("atsltd_fine", WIDTH, HEIGHT, settings).frames(events_of(scene)):
        (report,) = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
    assert overlap(report, scene.box("thing", (frame.stamp_ns - START_NS) * 1e-9)) > 0.5


def test_a_frame_that_starts_after_its_end_is_refused():
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig())
    with pytest.raises(TrackingError, match="after its end"):
        tracker.update(5, np.zeros((HEIGHT, WIDTH, 2), np.uint8), start_ns=6)


def test_a_target_with_no_stamp_that_is_lost_is_looked_for_when_time_goes_back():
    scene = scene_of(Waypoint(0, 30, 90), Waypoint(1.2, 210, 90), duration_s=1.2, cover=(pillar(125),))
    frames = frames_of(scene)
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig())
    tracker.start("thing", scene.box("thing", 0.0))
    hidden = [frame for frame in frames if (frame.stamp_ns - START_NS) * 1e-9 < 0.78]
    for frame in hidden:
        (report,) = tracker.update(frame.stamp_ns, frame.data)
    assert scene.visible_share("thing", 0.7) < 0.5
    assert report.score == 0.0
    # The thing comes out of the pillar, at times that are ten seconds earlier.
    after = [
        (
            tracker.update(frame.stamp_ns - 10_000_000_000, frame.data)[0],
            scene.box("thing", (frame.stamp_ns - START_NS) * 1e-9),
        )
        for frame in frames[len(hidden) :]
    ]
    assert overlap(*after[-1]) > 0.5


def test_a_target_starts_where_it_was_at_its_stamp_not_where_the_first_frame_finds_it():
    scene = scene_of(Waypoint(0, 40, 60), Waypoint(0.5, 200, 60), duration_s=0.5)
    found = tracked(scene, start_s=0.1)
    assert np.mean([overlap(report, truth) for _, report, truth in found]) > 0.88


def test_a_target_whose_light_flickers_starts_where_it_is(monkeypatch):
    scene = scene_of(Waypoint(0, 60, 90), Waypoint(1, 120, 90), duration_s=0.4)
    scene = replace(scene, sprites=(replace(scene.sprites[0], flicker=Flicker(100.0, 0.2)),))
    frames = frames_of(scene)

    def mean_overlap():
        return np.mean([overlap(report, truth) for _, report, truth in tracked(scene, start_s=0.1, frames=frames)])

    assert mean_overlap() > 0.9
    monkeypatch.setattr(coherent_motions, "climbed", lambda *given: (*climbed(*given)[:3], 1.0))
    assert mean_overlap() < 0.5, "some velocity is the best, though none is right"


def with_restless_pixels(events, box, *, pixels, period_us):
    """The events, and those of pixels in the box that fire all the time, each at its own moments."""
    rng = np.random.default_rng(3)
    t = np.arange(START_NS, START_NS + 200_000_000, period_us * 1000 // pixels)
    which = np.arange(len(t)) % pixels
    x, y = (
        rng.integers(low, high, pixels)[which].astype(np.uint16)
        for low, high in ((box.x, box.x + box.w), (box.y, box.y + box.h))
    )
    both = [
        np.concatenate(pair)
        for pair in ((events.t, t), (events.x, x), (events.y, y), (events.p, np.ones(len(t), events.p.dtype)))
    ]
    order = np.argsort(both[0], kind="stable")
    return Events(*(field[order] for field in both), WIDTH, HEIGHT)


def test_pixels_that_fire_again_and_again_do_not_slow_a_start(monkeypatch):
    scene = scene_of(Waypoint(0, 60, 90), Waypoint(1, 160, 90), duration_s=0.3)
    events = with_restless_pixels(events_of(scene), scene.box("thing", 0.0), pixels=100, period_us=4000)
    frames = frames_from(events)

    def mean_overlap():
        found = tracked(scene, frames=frames)
        return np.mean([overlap(report, truth) for time_s, report, truth in found if time_s > 0.1])

    assert mean_overlap() > 0.96
    monkeypatch.setattr(coherent_motions, "shares_of_pixels", lambda events: np.ones(len(events), np.float32))
    assert mean_overlap() < 0.95


def test_a_look_farther_away_than_the_target_can_be_is_not_followed(monkeypatch):
    scene = scene_of(Waypoint(0, 60, 90), Waypoint(1, 160, 90), duration_s=0.4)
    look, away_s = Contours.look, (0.2, 0.204)

    def look_away(self, surface, *, any_motion=False):
        seen = look(self, surface, any_motion=any_motion)
        is_away = away_s[0] < (surface.stamp_ns - START_NS) * 1e-9 < away_s[1]
        return replace(seen, y=seen.y + 4.0) if is_away else seen

    monkeypatch.setattr(Contours, "look", look_away)
    found = tracked(scene)
    off_px = [abs(report.box.center[1] - truth.center[1]) for time_s, report, truth in found if time_s > away_s[0]]
    assert max(off_px) < 2.0


def test_what_covers_a_target_that_moved_steadily_does_not_draw_its_box_along(monkeypatch):
    rng = np.random.default_rng(8)
    still, passing = Waypoint(0, 220, 90), (Waypoint(1.2, 220, 90), Waypoint(2.4, 20, 90))
    cover = Sprite("cover", checks(rng, 110, 16, cell=6), np.ones((110, 16)), Path((still, *passing)))
    scene = scene_of(Waypoint(0, 180, 90), Waypoint(2.4, 60, 90), duration_s=2.4, cover=(cover,))
    frames = frames_of(scene)

    def overlap_at_the_end():
        _, report, truth = tracked(scene, frames=frames)[-1]
        return overlap(report, truth)

    # What was drawn along is found again: this is about what is not drawn along.
    monkeypatch.setattr(LastClear, "has_strayed", False)
    assert overlap_at_the_end() > 0.45
    monkeypatch.setattr(steady_motion, "STEADY_S", np.inf)
    assert overlap_at_the_end() < 0.1


def test_a_target_that_moved_steadily_and_turns_then_is_followed():
    found = tracked(
        scene_of(Waypoint(0, 50, 50), Waypoint(1.3, 140, 50), Waypoint(2.2, 150, 130), duration_s=2.2),
    )
    assert min(overlap(report, truth) for _, report, truth in found) > 0.7
    assert {report.state for _, report, _ in found} == {TargetState.TRACKING}


def test_time_that_goes_back_starts_the_target_again():
    scene = scene_of(Waypoint(0, 50, 60), Waypoint(1, 190, 120))
    frames = frames_of(scene)
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig())
    tracker.start("thing", scene.box("thing", 0.1), START_NS + 100_000_000)
    rounds = [[tracker.update(frame.stamp_ns, frame.data) for frame in frames] for _ in range(2)]
    assert rounds[0][-1][0].box == rounds[1][-1][0].box
    assert rounds[1][0][0].state is TargetState.IDLE


def test_a_clock_that_is_set_back_throws_no_target_back_to_its_start():
    scene = scene_of(Waypoint(0, 40, 90), Waypoint(2, 200, 90), duration_s=2.0)
    frames, back_ns, before = frames_of(scene), 200_000_000, START_NS + 1_000_000_000
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig())
    tracker.start("thing", scene.box("thing", 0.1), START_NS + 100_000_000)
    for frame in frames:
        since_ns = back_ns if frame.start_ns > before else 0
        (report,) = tracker.update(frame.stamp_ns - since_ns, frame.data, start_ns=frame.start_ns - since_ns)
    assert report.state is TargetState.TRACKING
    assert overlap(report, scene.box("thing", 2.0)) > 0.8


def test_a_target_without_a_stamp_is_followed_on_when_time_goes_back():
    ways = (Waypoint(0, 100, 90), Waypoint(1, 112, 90))
    frames = frames_of(scene_of(*ways))
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig())
    tracker.start("thing", scene_of(*ways).box("thing", 0.0), 0)
    for _ in range(3):
        for frame in frames:
            (report,) = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
    assert report.state is TargetState.TRACKING
    assert overlap(report, scene_of(*ways).box("thing", 1.0)) > 0.6


def test_targets_do_not_influence_one_another():
    scene = make_scene(Recipe(("ball", "dartboard"), "wall", targets=2), WIDTH, HEIGHT, np.random.default_rng(3))
    frames = frames_of(scene)
    boxes = {name: scene.box(name, 0.0) for name in scene.targets}

    def run(names):
        tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig())
        for name in names:
            tracker.start(name, boxes[name])
        return [{report.name: report for report in tracker.update(frame.stamp_ns, frame.data)} for frame in frames]

    together, alone = run(scene.targets), {name: run([name]) for name in scene.targets}
    for index, reports in enumerate(together):
        assert reports == {name: alone[name][index][name] for name in scene.targets}


@pytest.mark.parametrize("noise_rate_hz", [100.0, 50_000.0])
def test_an_empty_or_noisy_scene_does_no_harm(noise_rate_hz):
    scene = replace(scene_of(Waypoint(0, 60, 90)), duration_s=0.3)
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig())
    tracker.start("nothing", Box(100, 100, 20, 20))
    for frame in frames_of(scene, noise_rate_hz=noise_rate_hz):
        (report,) = tracker.update(frame.stamp_ns, frame.data)
        assert report.box is None or np.isfinite(report.box).all()
