"""What comes nearer or goes away is followed by a box that grows and shrinks with it."""

import math

import cv2
import numpy as np
import pytest
from tracked_scenes import frames_of, overlap, scene_of, tracked

from etd_ros.boxes import Box
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite, Waypoint
from etd_ros.tracking import ContourConfig, TargetState
from etd_ros.tracking.contours import Contours
from etd_ros.tracking.edge_flow import EdgeFlow
from etd_ros.tracking.growth import (
    ERROR_MAX_PER_S,
    MEASURE_S,
    RING_SCALE,
    START_MOVED_PX,
    SURE_PER_S,
    GrowthByFlow,
    arm_px,
    growth_trust,
)
from etd_ros.tracking.known_growth import GROWING_PER_S, NEW_AGREEING, NEW_GROWING_PER_S, NEW_S, NEW_SURE_PER_S

DURATION_S = 0.7
NEARS_S = 1.5
X, Y = 120, 90
BOX = Box(100, 70, 40, 40)
PLACE = BOX.center


def scaled(*, nears, moves_px_s=0.0, duration_s=DURATION_S):
    """A square that comes nearer at constant speed to touch the camera after NEARS_S, or the same backwards."""
    waypoints = []
    for time_s in np.linspace(0, duration_s, 15).tolist():
        scale = 1 / (1 - (time_s if nears else duration_s - time_s) / NEARS_S)
        waypoints.append(Waypoint(time_s, X + moves_px_s * time_s, Y, scale))
    return scene_of(*waypoints, duration_s=duration_s)


def disc_that_nears():
    """A bright disc without texture."""
    rows, columns = np.mgrid[:24, :24]
    mask = (np.hypot(columns - 11.5, rows - 11.5) < 12).astype(float)
    scene = scaled(nears=True)
    (square,) = scene.sprites
    disc = Sprite("thing", np.full((24, 24), 0.9), mask, square.path)
    return Scene(scene.width, scene.height, scene.duration_s, scene.background, (disc,))


def last_overlaps(found):
    """The IoU in the last tenth of a second."""
    return [overlap(report, truth) for time_s, report, truth in found if time_s > DURATION_S - 0.1]


@pytest.mark.parametrize(("nears", "moves_px_s"), [(True, 30.0), (False, 0.0), (False, 30.0)])
def test_what_comes_nearer_or_goes_away_is_followed(nears, moves_px_s):
    found = tracked(scaled(nears=nears, moves_px_s=moves_px_s), start_s=0.02)
    assert {report.state for _, report, _ in found} == {TargetState.TRACKING}
    assert np.mean(last_overlaps(found)) > 0.7


def test_what_has_no_texture_is_followed_too():
    assert np.mean(last_overlaps(tracked(disc_that_nears(), start_s=0.02))) > 0.7


def test_a_box_whose_size_is_kept_does_not_grow():
    found = tracked(scaled(nears=True), config=ContourConfig(refine_gain=0.0, scale_gain=0.0, angle_gain=0.0))
    sides = {round(report.box.w, 6) for _, report, _ in found if report.box}
    assert len(sides) == 1


def test_what_moves_along_is_not_taken_to_grow():
    scene = scene_of(Waypoint(0, 60, Y), Waypoint(DURATION_S, 60 + 100 * DURATION_S, Y), duration_s=DURATION_S)
    sides = [report.box.w / truth.w for _, report, truth in tracked(scene)]
    assert 0.9 < min(sides) <= max(sides) < 1.1


def flow(growing_per_s, error=0.05, *, by_edge=2 * SURE_PER_S):
    """One whose edges do not all agree, unless that is said."""
    return EdgeFlow(np.zeros(2), growing_per_s, error, growing_error_by_edge=by_edge)


def sure(growing_per_s):
    return flow(growing_per_s, by_edge=SURE_PER_S)


def test_a_start_believes_a_flow_by_how_sure_it_is():
    share = growth_trust(flow(1.5), 20.0, 0.1)
    assert 0.7 < share < 1
    assert 0 < growth_trust(flow(1.5, 0.3), 20.0, 0.1) < share


def test_a_start_takes_a_flow_that_is_unsure_or_of_hardly_any_motion_for_none():
    assert growth_trust(flow(1.5, 0.5), 20.0, 0.1) == 0
    assert growth_trust(flow(1.5), 20.0, START_MOVED_PX / 20 / 1.6) == 0
    assert growth_trust(flow(10.0, 2.0), 20.0, 0.1) == 0


def test_a_start_takes_growth_that_a_single_edge_decides_for_none():
    assert growth_trust(flow(1.5, by_edge=0.3), 20.0, 0.1) == growth_trust(sure(1.5), 20.0, 0.1)
    assert growth_trust(flow(1.5, by_edge=0.5), 20.0, 0.1) == 0


def triangle_moving(velocity_px_s):
    """A dark one, of three edges."""
    mask = np.zeros((24, 24))
    cv2.fillPoly(mask, [np.array([(12, 0), (23, 23), (0, 23)])], 1.0)
    right, down = velocity_px_s
    way = [Waypoint(0, 100, 80), Waypoint(0.5, 100 + 0.5 * right, 80 + 0.5 * down)]
    triangle = Sprite("thing", np.full((24, 24), 0.1), mask, Path(way))
    return Scene(240, 180, 0.5, np.full((180, 240), 0.8), (triangle,))


@pytest.mark.parametrize("velocity_px_s", [(50, 0), (25, 43)])
def test_what_has_three_edges_and_moves_along_is_not_taken_to_grow(velocity_px_s):
    sides = [report.box.w / truth.w for _, report, truth in tracked(triangle_moving(velocity_px_s), start_s=0.02)]
    assert 0.95 < min(sides) <= max(sides) < 1.1


class FlowingSurface:
    """Has these flows one after the other, and so many events in a box and round it."""

    def __init__(self, flows, *, inside=400, around=0):
        self._flows, self._counts = iter(flows), (inside, inside + around)
        self.stamp_ns = 0

    def flow(self, window, duration_s, x, y, *, by_edge):
        assert by_edge
        return next(self._flows)

    def window(self, box, margin):
        return 0, round(box.h + 2 * margin), 0, round(box.w + 2 * margin)

    def count(self, window, duration_s):
        return self._counts[window[1] > RING_SCALE * BOX.h + 1]


def corrections(surface, growing_per_s=0.0, *, times=2, step_s=MEASURE_S, covered=0.0, grows=True):
    growth, found = GrowthByFlow(grows=grows), []
    for _ in range(times):
        surface.stamp_ns += round(step_s * 1e9)
        found.append(growth.correction(surface, BOX, PLACE, 50.0, growing_per_s, covered))
    return found


def test_a_rate_is_put_right_by_the_lesser_of_two_flows():
    first, second = corrections(FlowingSurface([flow(2.0), flow(1.0)]))
    assert first == 0.0
    assert 0.3 < second < 1.0


@pytest.mark.parametrize(
    ("flows", "growing_per_s"),
    [
        ([flow(2.0), flow(-1.0)], 0.0),
        ([flow(2.0), flow(1.0)], 1.5),
        ([flow(2.0), None], 0.0),
        ([None, flow(2.0)], 0.0),
        ([flow(2.0), flow(2.0, ERROR_MAX_PER_S + 0.01)], 0.0),
        ([flow(0.02), flow(0.02)], 0.0),
    ],
    ids=["disagree", "on both sides of it", "none now", "none before", "unsure", "hardly any motion"],
)
def test_other_flows_change_nothing(flows, growing_per_s):
    assert corrections(FlowingSurface(flows), growing_per_s) == [0.0, 0.0]


def test_a_flow_amid_other_things_changes_nothing_unless_all_its_edges_agree():
    assert corrections(FlowingSurface([flow(2.0), flow(2.0)], around=200)) == [0.0, 0.0]
    alone = corrections(FlowingSurface([flow(2.0), flow(2.0)]))
    assert corrections(FlowingSurface([sure(2.0), sure(2.0)], around=200)) == alone


def test_what_something_covers_is_not_taken_to_shrink_unless_all_edges_agree():
    covered = corrections(FlowingSurface([flow(-2.0), flow(-2.0)]), covered=1.0)
    assert covered == [0.0, 0.0]
    free = corrections(FlowingSurface([flow(-2.0), flow(-2.0)]))
    assert corrections(FlowingSurface([sure(-2.0), sure(-2.0)]), covered=1.0) == free


def test_what_is_not_known_to_grow_is_not_measured():
    assert corrections(FlowingSurface([]), grows=False) == [0.0, 0.0]
    slowly = GROWING_PER_S - 0.1
    assert corrections(FlowingSurface([]), slowly, grows=False) == [0.0, 0.0]
    assert corrections(FlowingSurface([]), GROWING_PER_S, grows=False, covered=0.1) == [0.0, 0.0]


def corrections_of_what_is_new(flows, step_s=MEASURE_S, is_new=True):
    growth, surface, found = GrowthByFlow(is_new=is_new), FlowingSurface(flows), []
    for _ in flows:
        surface.stamp_ns += round(step_s * 1e9)
        found.append(growth.correction(surface, BOX, PLACE, 50.0, 0.0, 0.0))
    return found


def test_what_is_new_grows_where_sure_flows_in_a_row_agree():
    agree = [flow(2.0, by_edge=NEW_SURE_PER_S)] * NEW_AGREEING
    *early, last = corrections_of_what_is_new([flow(-2.0), *agree, sure(2.0)])
    assert early[:-1] == [0.0] * NEW_AGREEING
    assert last > 0
    assert not any(corrections_of_what_is_new([*agree, sure(2.0)], is_new=False))


@pytest.mark.parametrize(
    "between", [flow(-2.0, by_edge=0.0), sure(2.0), flow(NEW_GROWING_PER_S - 0.01, by_edge=0.0), None]
)
def test_what_is_new_does_not_grow_where_one_flow_of_them_does_not_agree(between):
    agrees = flow(2.0, by_edge=NEW_SURE_PER_S)
    assert not any(corrections_of_what_is_new([agrees, agrees, between, agrees]))


def test_what_is_no_longer_new_has_to_grow_by_its_looks():
    agrees = flow(2.0, by_edge=NEW_SURE_PER_S)
    assert not any(corrections_of_what_is_new([agrees] * 4, step_s=NEW_S / 2))


def test_what_grows_by_its_looks_is_measured_from_then_on():
    growth, surface = GrowthByFlow(), FlowingSurface([sure(-2.0)] * 2)
    for growing_per_s, covered in ((GROWING_PER_S, 0.0), (0.4, 1.0)):
        surface.stamp_ns += round(MEASURE_S * 1e9)
        correction = growth.correction(surface, BOX, PLACE, 50.0, growing_per_s, covered)
    assert correction < -0.5


def test_edges_of_what_is_known_to_grow_pass_over_pixels_by_that_as_well():
    contours = Contours(BOX, 0, ContourConfig())
    contours.change_since(contours.body.pose, 0.0, 0.0, 0.1)
    contours.body.velocity = 30.0, 0.0
    contours.body.growing.per_s = 2.0
    assert contours.sweep_px_s == 30.0, "it is not known to"
    contours.change_since(contours.body.pose, 2.0, 0.0, 0.1)
    assert contours.sweep_px_s > 35.0


def breathing_disc():
    """A half bright, half dark disc that grows, turns its way, and shrinks again."""
    rows, columns = np.mgrid[:48, :48]
    mask = (np.hypot(columns - 23.5, rows - 23.5) < 24).astype(float)
    picture = np.where(columns + 0.3 * rows > 31, 0.9, 0.2)
    waypoints = []
    for time_s in np.linspace(0, 2.4, 49).tolist():
        turned, scale = 2.2 * time_s, 0.8 * math.exp(0.5 * math.sin(2.0 * time_s))
        waypoints.append(Waypoint(time_s, X + 30 * math.sin(turned), Y + 22 * (1 - math.cos(turned)), scale))
    rows, columns = np.mgrid[:180, :240]
    cloudy = 0.5 + 0.35 * np.sin(columns / 31) * np.sin(rows / 23)
    return Scene(240, 180, 2.4, cloudy, (Sprite("thing", picture, mask, Path(waypoints)),))


def test_what_grows_and_shrinks_again_is_not_taken_to_be_covered():
    found = tracked(breathing_disc(), start_s=0.02)
    overlaps = [overlap(report, truth) for _, report, truth in found]
    assert np.mean(overlaps) > 0.85


def test_flows_are_not_measured_more_often_than_they_change():
    assert corrections(FlowingSurface([flow(2.0)]), times=2, step_s=0.6 * MEASURE_S)[0] == 0.0


def test_a_known_rate_is_changed_less_than_an_unknown_one():
    found = corrections(FlowingSurface([flow(2.0)] * 6), times=6)
    assert found[1] > found[-1] > 0


def test_the_outline_is_half_a_side_from_the_middle():
    assert arm_px(40, 20) == 15


def test_noise_makes_nothing_grow():
    scene = scene_of(Waypoint(0, X, Y), Waypoint(1, X, Y), duration_s=0.5)
    found = tracked(scene, frames=frames_of(scene, noise_rate_hz=SensorConfig().noise_rate_hz * 10))
    assert max(abs(report.box.w / truth.w - 1) for _, report, truth in found) < 0.05
