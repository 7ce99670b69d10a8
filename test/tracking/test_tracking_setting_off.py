"""What rests in its start box and sets off later is followed from there; what has moved on before its box came, too."""

import pytest
from tracked_scenes import START_NS, frames_of, overlap, scene_of, tracked

from etd_ros.simulation import Waypoint
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState

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
