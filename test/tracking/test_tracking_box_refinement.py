"""What is seen of how far a target's box is off puts it right, bit by bit and as far as that is sure."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tracked_scenes import HEIGHT, START_NS, WIDTH, frames_of, overlap, scene_of

from etd_ros.boxes import Box
from etd_ros.simulation import Waypoint
from etd_ros.tracking import BoxMisfit, ContourConfig, MultiTracker, TargetState
from etd_ros.tracking.box_refinement import ANSWERS_NS, MOTION_PX, SLOW_MARGIN_PX, TIME_S, BoxRefinement
from etd_ros.tracking.contours import Contours
from etd_ros.tracking.following import Following

DURATION_S = 0.4
WAY = Waypoint(0, 40, 80), Waypoint(DURATION_S, 200, 90)
SPEED_PX_S = np.hypot(400, 25)
RIGHT = BoxMisfit(np.zeros(4, np.float32), np.full(4, 0.01, np.float32))


@pytest.fixture(scope="module")
def scene():
    return scene_of(*WAY, duration_s=DURATION_S)


@pytest.fixture(scope="module")
def frames(scene):
    return frames_of(scene)


@pytest.fixture(scope="module")
def slow():
    return scene_of(Waypoint(0, 60, 80), Waypoint(0.6, 132, 80), duration_s=0.6)


@pytest.fixture(scope="module")
def slow_frames(slow):
    return frames_of(slow)


def followed(scene, frames, corrector, *, gain=1.0, start=None, **settings):
    """Reports and truths of all frames, boxes being put right by a corrector."""
    config = ContourConfig(refine_gain=gain, **settings)
    tracker = MultiTracker(WIDTH, HEIGHT, contours=config, corrector=corrector)
    tracker.start("thing", start or scene.box("thing", 0), START_NS)
    found = []
    for frame in frames:
        (report,) = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
        if report.state is not TargetState.IDLE:
            found.append((report, scene.box("thing", (frame.stamp_ns - START_NS) * 1e-9)))
    return found


def misfit(*offsets, spread=0.01):
    return BoxMisfit(np.array(offsets, np.float32), np.full(4, spread, np.float32))


def asked(scene, frames, **settings):
    views = []

    def corrector(view):
        # The next look takes the place of these.
        views.append(dataclasses.replace(view, points=view.points.copy()))
        return RIGHT

    followed(scene, frames, corrector, **settings)
    return views


def test_it_is_asked_after_some_motion_and_not_before(scene, frames):
    views = asked(scene, frames)
    gaps_s = np.diff([view.stamp_ns for view in views]) * 1e-9
    assert len(views) > 20
    assert (gaps_s >= min(TIME_S, MOTION_PX / SPEED_PX_S) * 0.8).all()


def test_a_view_is_of_the_target_where_it_is_and_as_it_moves(scene, frames):
    views = asked(scene, frames)
    for view in views[5:]:
        truth = scene.box("thing", (view.stamp_ns - START_NS) * 1e-9)
        assert view.target == "thing"
        assert view.box.center == pytest.approx(truth.center, abs=3)
        assert np.hypot(*view.velocity) == pytest.approx(SPEED_PX_S, rel=0.3)
        assert 0 < view.age_s < 1
        assert (view.points[:, 2] <= view.span_s * 1.001).all()
        assert view.sensor == (WIDTH, HEIGHT)


def test_it_is_shown_what_the_target_looked_like_at_first_all_the_time(scene, frames):
    views = asked(scene, frames)
    assert all(view.first.any() for view in views)
    likeness = np.corrcoef(views[0].first[2].ravel(), views[-1].first[2].ravel())[0, 1]
    assert likeness > 0.9


def test_events_are_seen_as_far_as_twice_the_box(scene, frames):
    view = asked(scene, frames)[-1]
    offsets = np.abs(view.points[:, :2] - view.box.center) / (view.box.w, view.box.h)
    assert offsets.max() > 0.7


def test_a_box_that_is_told_to_be_right_stays_as_it_is(scene, frames):
    with_it = followed(scene, frames, lambda view: RIGHT)
    without = followed(scene, frames, lambda view: RIGHT, gain=0.0)
    assert [report.box for report, _ in with_it] == [report.box for report, _ in without]


def test_a_start_box_that_is_too_large_is_put_right(scene, frames):
    """As a corrector that sees the truth would have it."""

    def corrector(view):
        truth = scene.box("thing", (view.stamp_ns - START_NS) * 1e-9)
        (x, y), (true_x, true_y) = view.box.center, truth.center
        sizes = np.log((truth.w / view.box.w, truth.h / view.box.h))
        return misfit((true_x - x) / view.box.w, (true_y - y) / view.box.h, *sizes)

    start = Box(*scene.box("thing", 0)).scaled(1.2)
    ends = {gain: followed(scene, frames, corrector, gain=gain, start=start)[-1] for gain in (0.0, 0.25)}
    assert overlap(*ends[0.0]) < 0.75
    assert overlap(*ends[0.25]) > 0.93


@pytest.mark.parametrize(
    ("speed", "spread", "grows"), [("fast", 0.01, True), ("fast", 0.2, False), ("slow", 0.01, False)]
)
def test_the_model_of_a_fast_target_grows_by_what_is_surely_off(speed, spread, grows, request):
    """And goes on at that, which looks have to agree about for long."""
    scene, frames = (
        request.getfixturevalue(name) for name in (("scene", "frames"), ("slow", "slow_frames"))[speed == "slow"]
    )
    drawn, rates = [], []

    def corrector(view):
        drawn.append(np.count_nonzero(view.usual[2]) * view.box.w * view.box.h)
        rates.append(view.growing_per_s)
        return misfit(0, 0, 0.15, 0.15, spread=spread) if len(rates) == 1 else RIGHT

    # Looks change the size no further.
    followed(scene, frames, corrector, gain=0.5, scale_gain=1e-9)
    assert (rates[1] > 0.3) == grows
    assert (drawn[1] > 1.15 * drawn[0]) == grows


def test_a_size_that_is_to_be_kept_is_kept(scene, frames):
    """`scale_gain` 0: the box is moved only."""
    config = ContourConfig(scale_gain=0, angle_gain=0, refine_gain=1.0)
    tracker = MultiTracker(WIDTH, HEIGHT, contours=config, corrector=lambda view: misfit(0.002, 0, 0.1, -0.1))
    start = scene.box("thing", 0)
    tracker.start("thing", start, START_NS)
    for frame in frames:
        (report,) = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
    assert (report.box.w, report.box.h) == pytest.approx((start.w, start.h))


@pytest.mark.parametrize(("spread", "taken"), [(0.0, 1.0), (0.08, 1 / 3), (1.0, 0.0)])
def test_what_is_less_sure_counts_less(spread, taken, scene, frames):
    views = []

    def corrector(view):
        views.append(view)
        return misfit(0.1, 0, 0, 0, spread=spread) if len(views) == 1 else RIGHT

    plain = asked(scene, frames)
    followed(scene, frames, corrector, gain=0.5)
    moved = views[1].box.center[0] - plain[1].box.center[0]
    assert moved / views[0].box.w == pytest.approx(0.5 * taken * 0.1, abs=0.003)


def test_nobody_is_asked_about_what_lies_over_the_border_and_about_a_fast_target_until_then():
    scene = scene_of(Waypoint(0, 60, 80), Waypoint(0.5, 270, 80), duration_s=0.5)
    views = asked(scene, frames_of(scene))
    assert len(views) > 20
    assert WIDTH - SLOW_MARGIN_PX < max(view.box.x + view.box.w for view in views) <= WIDTH


def test_the_box_of_what_is_covered_is_left_alone(scene, frames, monkeypatch):
    monkeypatch.setattr(Contours, "covered", property(lambda self: 1.0))
    told = followed(scene, frames, lambda view: misfit(0.2, 0.2, 0.2, 0.2))
    not_told = followed(scene, frames, lambda view: RIGHT)
    assert [report.box for report, _ in told] == [report.box for report, _ in not_told]


def test_it_goes_on_being_asked_when_time_goes_back(scene, frames):
    views = []

    def corrector(view):
        views.append(view)
        return RIGHT

    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig(), corrector=corrector)
    tracker.start("thing", scene.box("thing", 0))
    half = len(frames) // 2
    back_ns = 10_000_000_000
    for number, frame in enumerate(frames):
        offset_ns = 0 if number < half else -back_ns
        tracker.update(back_ns + frame.stamp_ns + offset_ns, frame.data, start_ns=back_ns + frame.start_ns + offset_ns)
    seen_before = sum(view.stamp_ns > back_ns for view in views)
    assert seen_before > 5
    assert len(views) > 1.5 * seen_before
    assert all(view.age_s >= 0 for view in views)


@pytest.mark.parametrize(("speed_px_s", "is_asked"), [(4.0, False), (6.0, True)])
def test_nobody_is_asked_about_what_hardly_moves(speed_px_s, is_asked, slow, slow_frames, monkeypatch):
    """It is as slow as that only where it is asked: its looks are as sure as ever."""
    monkeypatch.setattr(BoxRefinement, "take", at_speed(speed_px_s, BoxRefinement.take))
    assert bool(asked(slow, slow_frames)) == is_asked


def at_speed(speed_px_s, take):
    def taken(refinement, contours, surface, patience):
        velocity = contours.body.velocity
        contours.body.velocity = speed_px_s, 0.0
        take(refinement, contours, surface, patience)
        contours.body.velocity = velocity

    return taken


@pytest.mark.parametrize(
    ("offset", "refine_sizes_per_s", "taken"),
    [(0.1, 8.0, 0.06), (-0.1, 8.0, -0.06), (0.03, 8.0, 0.0), (0.03, 0.0, 0.03)],
)
def test_of_a_slow_box_what_is_off_beyond_the_spread_is_put_right(offset, refine_sizes_per_s, taken, slow, slow_frames):
    views = []

    def corrector(view):
        views.append(view)
        return misfit(offset, 0, 0, 0, spread=0.04) if len(views) == 1 else RIGHT

    plain = asked(slow, slow_frames, refine_sizes_per_s=refine_sizes_per_s)
    followed(slow, slow_frames, corrector, gain=0.5, refine_sizes_per_s=refine_sizes_per_s)
    moved, wider = (views[1].box.center[0] - plain[1].box.center[0], views[1].box.w / plain[1].box.w)
    assert moved / views[0].box.w == pytest.approx(0.5 * taken / 1.5, abs=0.002)
    assert wider == pytest.approx(1, abs=0.002)


def test_a_slow_box_is_left_alone_beside_the_border():
    to_the_border = scene_of(Waypoint(0, 60, 80), Waypoint(1, 220, 80))
    views = asked(to_the_border, frames_of(to_the_border))
    assert len(views) > 10
    assert max(view.box.x + view.box.w for view in views) <= WIDTH - SLOW_MARGIN_PX


@pytest.mark.parametrize("speed", ["fast", "slow"])
def test_the_network_that_ships_keeps_a_box_that_is_right(speed, scene, frames, slow, slow_frames):
    scene, frames = (scene, frames) if speed == "fast" else (slow, slow_frames)
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig())
    tracker.start("thing", scene.box("thing", 0), START_NS)
    overlaps = []
    for frame in frames:
        (report,) = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
        if report.state is not TargetState.IDLE:
            overlaps.append(overlap(report, scene.box("thing", (frame.stamp_ns - START_NS) * 1e-9)))
    # The start has its own errors.
    assert min(overlaps[len(overlaps) // 2 :]) > 0.88


def test_what_is_slow_is_put_right_on_the_frame_after_its_look(slow, slow_frames, monkeypatch):
    """Looks and the network take turns, so that no frame takes the time of both."""
    looked_ns, asked_ns = [], []
    follow = Following.take

    def followed_at(following, stamp_ns):
        looked_ns.append(stamp_ns)
        return follow(following, stamp_ns)

    monkeypatch.setattr(Following, "take", followed_at)
    tracker = MultiTracker(
        WIDTH, HEIGHT, contours=ContourConfig(), corrector=lambda _: asked_ns.append(now_ns) or RIGHT
    )
    tracker.start("thing", slow.box("thing", 0))
    for frame in slow_frames:
        now_ns = frame.stamp_ns
        tracker.update(now_ns, frame.data, start_ns=frame.start_ns)
    assert len(asked_ns) > 5
    assert not set(asked_ns) & set(looked_ns)


@pytest.mark.parametrize(("later_ns", "is_asked"), [(0, True), (ANSWERS_NS, False)])
def test_what_was_seen_too_long_ago_puts_nothing_right(later_ns, is_asked, slow, slow_frames, monkeypatch):
    answer = BoxRefinement.answer

    def answered(refinement, contours, stamp_ns):
        answer(refinement, contours, stamp_ns + later_ns)

    monkeypatch.setattr(BoxRefinement, "answer", answered)
    assert bool(asked(slow, slow_frames)) == is_asked
