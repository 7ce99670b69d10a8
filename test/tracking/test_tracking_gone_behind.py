"""What loses its events edge by edge has gone behind something; what loses all of them at once has stopped."""

from __future__ import annotations

import pytest
from tracked_scenes import SIZE, frames_of, overlap, pillar, scene_of, tracked

from etd_ros.simulation import Waypoint
from etd_ros.tracking import TargetState
from etd_ros.tracking.doubts import Doubts

PILLAR_X, PILLAR_W = 120, 60


def passing(speed_px_s, duration_s):
    """A square that passes behind a pillar; the time from which on less than a tenth of it can be seen."""
    ways = Waypoint(0.0, 40.0, 90.0), Waypoint(1.0, 40.0 + speed_px_s, 90.0)
    gone_s = (PILLAR_X - PILLAR_W / 2 + 0.4 * SIZE - 40) / speed_px_s
    return scene_of(*ways, duration_s=duration_s, cover=(pillar(PILLAR_X),)), gone_s


@pytest.fixture(scope="module")
def hidden():
    """A square that passes behind a pillar at 160 px/s, its frames, and the time at which it is gone."""
    scene, gone_s = passing(160.0, 0.85)
    return scene, frames_of(scene), gone_s


def test_what_goes_behind_a_pillar_is_said_to_be_gone_at_once(hidden):
    scene, frames, gone_s = hidden
    states = [report.state for time_s, report, _ in tracked(scene, frames=frames) if time_s < gone_s + 0.2]
    assert states[-1] is TargetState.RECOVERING


def test_it_is_found_when_it_comes_out(hidden):
    scene, frames, _ = hidden
    _, report, truth = tracked(scene, frames=frames)[-1]
    assert report.state is TargetState.TRACKING
    assert overlap(report, truth) > 0.9


def test_without_that_its_box_would_stay_at_the_edge(hidden, monkeypatch):
    scene, frames, gone_s = hidden
    monkeypatch.setattr(Doubts, "has_gone_behind", False)
    behind = [report for time_s, report, _ in tracked(scene, frames=frames) if gone_s < time_s < gone_s + 0.2]
    assert {report.state for report in behind} == {TargetState.TRACKING}


@pytest.mark.parametrize("speed_px_s", [60.0, 160.0])
def test_what_stops_at_once_keeps_its_box(speed_px_s):
    stops_s = 80 / speed_px_s
    ways = Waypoint(0.0, 40.0, 90.0), Waypoint(stops_s, 120.0, 90.0), Waypoint(9.0, 120.0, 90.0)
    scene = scene_of(*ways, duration_s=stops_s + 0.3)
    found = tracked(scene, frames=frames_of(scene))
    assert {report.state for _, report, _ in found} == {TargetState.TRACKING}
    assert overlap(*found[-1][1:]) > 0.85


def test_what_is_fast_is_held_as_it_may_have_stopped_within_as_much_motion():
    scene, gone_s = passing(400.0, 0.21)
    behind = [report for time_s, report, _ in tracked(scene) if time_s > gone_s]
    assert {(report.state, report.score) for report in behind} >= {(TargetState.TRACKING, 0.0)}
    assert all(report.state is TargetState.TRACKING for report in behind)
