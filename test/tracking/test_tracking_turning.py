"""What turns in place or on its way is followed from its start on, by a box that turns with it."""

import math
from itertools import takewhile

import numpy as np
import pytest
from tracked_scenes import HEIGHT, START_NS, WIDTH, frames_of, overlap, scene_of, tracked

from etd_ros.boxes import Box
from etd_ros.engine import track
from etd_ros.evaluation import read_boxes
from etd_ros.evaluation.scoring import label_overlaps
from etd_ros.evaluation.tracks import TrackRow
from etd_ros.recordings import open_recording
from etd_ros.simulation import Path, Scene, Sprite, Waypoint
from etd_ros.simulation.things import ball, dartboard
from etd_ros.targets import TargetStart
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState, contours
from etd_ros.tracking.body import Body
from etd_ros.tracking.contour_kernels import ANGLE
from etd_ros.tracking.edge_flow import EdgeFlow, EdgeFlows
from etd_ros.tracking.growth import START_MOVED_PX
from etd_ros.tracking.turning import (
    BEGINS_ERRORS,
    ERROR_MAX_RAD_S,
    KNOWN_MIN,
    MEASURE_S,
    BeginningTurn,
    Turned,
    TurningByFlow,
    turning_at_start,
)
from etd_ros.tracking.turning_trial import TurningTrial

DURATION_S = 0.8
X, Y = 120.0, 90.0
BOX = Box(100, 70, 40, 40)
PLACE = np.array(BOX.center)


def turning(angle_of, *, moves_px_s=0.0):
    """A square that is turned as a function of the time (s) says."""
    times_s = np.linspace(0, DURATION_S, 41).tolist()
    start_x = X - moves_px_s * DURATION_S / 2
    waypoints = [Waypoint(t, start_x + moves_px_s * t, Y, 1.0, angle_of(t)) for t in times_s]
    return scene_of(*waypoints, duration_s=DURATION_S)


def overlaps_at_the_end(scene):
    found = tracked(scene, start_s=0.02)
    assert {report.state for _, report, _ in found} == {TargetState.TRACKING}
    return [overlap(report, truth) for time_s, report, truth in found if time_s > DURATION_S / 2]


@pytest.mark.parametrize("rad_s", [-2.0, 1.0, 4.0, 7.0])
def test_what_turns_in_place_keeps_its_box(rad_s):
    assert np.mean(overlaps_at_the_end(turning(lambda t: rad_s * t))) > 0.8


def test_what_turns_on_its_way_keeps_its_box():
    assert np.mean(overlaps_at_the_end(turning(lambda t: 3 * t, moves_px_s=80.0))) > 0.7


LATER_S, FOR_S = 0.4, 0.5


def test_what_lies_behind_one_half_of_a_target_does_not_make_it_turn(data):
    """A ball that a camera slides past, and books behind its upper half, which go by more slowly."""
    folder = data / "slider_depth"
    labels = read_boxes(folder / "boxes.csv")["tennis_ball"]
    begins_ns = labels[0].stamp_ns + round(LATER_S * 1e9)
    labels = [label for label in labels if 0 <= label.stamp_ns - begins_ns <= FOR_S * 1e9]
    start = TargetStart("ball", labels[0].box, labels[0].stamp_ns)
    with open_recording(folder / "slider_depth.bag") as recording:
        steps = track(recording.streams(), [start], threads=False)
        before = takewhile(lambda step: step.frame.stamp_ns <= labels[-1].stamp_ns, steps)
        reports = [(step.frame.stamp_ns, report) for step in before for report in step.reports]
    rows = [TrackRow(stamp_ns, "ball", report.box, report.score, report.state.value) for stamp_ns, report in reports]
    assert np.mean(label_overlaps(rows, labels[1:])) > 0.9


def test_what_swings_keeps_its_box():
    assert np.mean(overlaps_at_the_end(turning(lambda t: 0.9 * math.sin(2 * math.pi * 0.8 * t)))) > 0.7


def test_the_box_of_a_disc_stays_as_it_is_while_it_turns():
    scene = turning(lambda t: 4 * t)
    texture, opacity = dartboard(np.random.default_rng(3), 40)
    disc = Sprite("thing", texture, opacity, scene.sprites[0].path)
    assert min(overlaps_at_the_end(Scene(scene.width, scene.height, DURATION_S, scene.background, (disc,)))) > 0.8


@pytest.mark.parametrize("moves_px_s", [40.0, 80.0])
def test_the_box_of_what_is_found_to_turn_later_is_that_of_the_shape_seen_at_its_start(moves_px_s):
    assert np.mean(overlaps_at_the_end(turning(lambda t: 0.8 * t, moves_px_s=moves_px_s))) > 0.8


@pytest.mark.parametrize(("width", "strides"), [(36, False), (20, True)])
def test_turning_is_doubted_of_what_is_as_high_as_somebody_who_strides(monkeypatch, width, strides):
    made = []

    class Noted(TurningTrial):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            made.append(self)

    monkeypatch.setattr(contours, "TurningTrial", Noted)
    scene = turning(lambda t: 0.8 * t, moves_px_s=40.0)
    (square,) = scene.sprites
    thing = Sprite("thing", square.texture[:, :width], np.ones((36, width)), square.path)
    tracked(Scene(scene.width, scene.height, DURATION_S, scene.background, (thing,)), start_s=0.02)
    assert bool(made) == strides


def test_a_model_that_is_kept_upright_does_not_turn():
    config = ContourConfig(refine_gain=0.0, angle_gain=0.0, scale_gain=0.0)
    found = tracked(turning(lambda t: 0.5 * t), start_s=0.02, config=config)
    assert len({round(report.box.w, 6) for _, report, _ in found if report.box}) == 1


def flows(rate, error=0.1, *, spread_px_s=2.0, along_px_s=20.0):
    still = np.zeros(2)
    return EdgeFlows(EdgeFlow(still, 0.0, 0.1, along_px_s), EdgeFlow(still, 0.0, 0.1, spread_px_s, rate, error))


def test_a_start_believes_a_flow_that_is_sure_to_turn():
    assert turning_at_start(flows(3.0), 20.0, 0.1) == 3.0


@pytest.mark.parametrize(
    ("seen", "time_s"),
    [
        (flows(3.0, 0.6), 0.1),
        (flows(3.0), START_MOVED_PX / 20 / 3.1),
        (flows(3.0, spread_px_s=15.0), 0.1),
    ],
    ids=["unsure", "hardly any motion", "its edges go as well along"],
)
def test_a_start_takes_other_flows_for_no_turning(seen, time_s):
    assert turning_at_start(seen, 20.0, time_s) == 0.0


def test_what_has_turned_and_moved_is_brought_back_to_its_start():
    velocity, rate, growing = np.array([60.0, -30.0]), 5.0, 0.8
    at_first = np.random.default_rng(1).uniform(-20, 20, (50, 2))
    times_s = np.linspace(0, 0.15, 50)
    cos, sin, size = np.cos(rate * times_s), np.sin(rate * times_s), np.exp(growing * times_s)
    x, y = at_first.T
    turned = np.stack([cos * x - sin * y, sin * x + cos * y], axis=1) * size[:, None]
    places = PLACE + np.outer(times_s, velocity) + turned
    events = np.column_stack([places, -times_s, np.ones(50)]).astype(np.float32)
    undone = Turned(velocity, rate, growing).undone(events, PLACE)
    assert undone[:, :2] == pytest.approx(PLACE + at_first, abs=1e-3)
    np.testing.assert_array_equal(undone[:, 2:], events[:, 2:])
    assert Turned(velocity, rate, growing).from_middle(events, PLACE) == pytest.approx(at_first, abs=1e-3)


def test_the_velocity_is_that_of_the_middle_wherever_the_flow_was_measured():
    velocity, rate, time_s = np.array([60.0, -30.0]), 5.0, 0.05
    middle, place = PLACE + velocity * time_s, PLACE + np.array([7.0, -4.0])
    right, below = place - middle
    there = EdgeFlow(velocity + rate * np.array([-below, right]), 0.0, 0.1, 1.0, rate, 0.1)
    assert Turned.of_flow(there, 0.0, PLACE, place, time_s).velocity == pytest.approx(velocity)


class FlowingSurface:
    """Has this flow with turning, whatever it is asked."""

    def __init__(self, seen):
        self._seen, self.stamp_ns = seen, round(MEASURE_S * 1e9)

    def flow(self, window, duration_s, x, y, *, may_turn):
        return self._seen.turning if may_turn and self._seen else None

    def window(self, box, margin):
        return 0, 0, 0, 0


def correction(seen, rate, filtered=None):
    return (filtered or TurningByFlow()).correction(FlowingSurface(seen), BOX, BOX.center, 50.0, rate)


def test_the_rate_of_what_turns_back_is_put_right():
    assert -6.0 < correction(flows(-3.0), 3.0) < -3.0


@pytest.mark.parametrize(
    "seen",
    [flows(3.0 / 0.7), flows(-3.0, ERROR_MAX_RAD_S + 0.1), None],
    ids=["as fast as flows may be wrong by", "unsure", "few edges"],
)
def test_other_flows_leave_the_rate_as_it_is(seen):
    assert correction(seen, 3.0) == 0.0


def test_a_rate_is_measured_now_and_then():
    filtered = TurningByFlow()
    assert correction(flows(-3.0), 3.0, filtered) != 0.0
    assert correction(flows(-3.0), 3.0, filtered) == 0.0


def trust_in(turned, seen=None, known=KNOWN_MIN):
    return BeginningTurn().trust(FlowingSurface(seen), Body(BOX, 0), 50.0, turned, known)


@pytest.mark.parametrize(
    ("known", "trust"), [(0.0, 0.0), (KNOWN_MIN, 0.0), (1 - (1 - KNOWN_MIN) / 4, 0.75), (1.1, 1.0)]
)
def test_a_look_begins_a_turn_by_how_well_the_direction_of_motion_is_known(known, trust):
    assert trust_in(0.1, known=known) == pytest.approx(trust)


def test_a_look_begins_a_turn_that_the_flow_sees_as_well():
    seen = flows(0.1 * BEGINS_ERRORS + 0.01)
    assert trust_in(0.1, seen) == 1.0
    assert trust_in(-0.1, seen) == 0.0


@pytest.mark.parametrize("seen", [flows(0.1 * BEGINS_ERRORS - 0.01), None], ids=["unsure", "few edges"])
def test_other_flows_begin_no_turn(seen):
    assert trust_in(0.1, seen) == 0.0


def test_the_flow_is_asked_whether_a_turn_begins_now_and_then():
    beginning = BeginningTurn()
    assert beginning.trust(FlowingSurface(flows(3.0)), Body(BOX, 0), 50.0, 0.1, 0.0) == 1.0
    assert beginning.trust(FlowingSurface(None), Body(BOX, 0), 50.0, 0.1, 0.0) == 1.0


@pytest.mark.parametrize(("patience", "is_asked"), [(1.0, True), (3.0, False)])
def test_of_many_targets_the_flow_is_asked_less_often(patience, is_asked):
    beginning, body = BeginningTurn(), Body(BOX, 0)
    surface = FlowingSurface(flows(3.0))
    surface.stamp_ns = round(10 * MEASURE_S * 1e9)
    assert beginning.trust(surface, body, 50.0, 0.1, 0.0, patience) == 1.0
    later = FlowingSurface(None)
    later.stamp_ns = surface.stamp_ns + round(2 * MEASURE_S * 1e9)
    assert beginning.trust(later, body, 50.0, 0.1, 0.0, patience) == (0.0 if is_asked else 1.0)


def test_what_goes_round_without_turning_does_not_begin_to_turn(monkeypatch):
    def way(t):
        return X + 70 * np.cos(1.5 * t), Y + 40 * np.sin(1.5 * t)

    duration_s = 2.0
    thing = Sprite("thing", *ball(np.random.default_rng(5), 36), Path.of(way, duration_s))
    scene = Scene(WIDTH, HEIGHT, duration_s, scene_of(Waypoint(0, X, Y)).background, (thing,))

    def turned_rad():
        tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig(refine_gain=0.0))
        tracker.start("thing", scene.box("thing", 0.0), START_NS)
        angles = []
        for frame in frames_of(scene):
            tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
            angles.append(abs(tracker.targets["thing"].standing.pose[ANGLE]))
        return max(angles)

    found = turned_rad()
    monkeypatch.setattr(BeginningTurn, "trust", lambda *_: 1.0)
    assert found < 0.5 * turned_rad()
