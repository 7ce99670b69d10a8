"""What `etd-plus` makes of knowing what a target is: people stay upright."""

from __future__ import annotations

import numpy as np
import pytest
from tracked_scenes import HEIGHT, START_NS, WIDTH, frames_of, scene_of, tracked

from etd_ros.simulation import Waypoint
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState

TURNS = scene_of(*(Waypoint(t, 60 + 100 * t, 90, 1.0, 2.0 * t) for t in np.arange(0, 1.01, 0.05)))
"""A square that turns by 2 rad/s on its way."""
CONTOURS = ContourConfig(refine_gain=0.0)


def sizes_of(reports):
    return [(report.box.w, report.box.h) for report in reports]


@pytest.fixture(scope="module")
def frames():
    return frames_of(TURNS)


@pytest.mark.parametrize("class_id", ["person", "Pedestrian", " PERSON "])
def test_a_class_is_that_of_people_in_capitals_or_not(class_id):
    assert ContourConfig().for_class(class_id) != ContourConfig()
    assert ContourConfig().for_class(class_id).angle_gain == 0


@pytest.mark.parametrize("class_id", ["", " ", "car", "people"])
def test_what_is_of_no_such_class_is_followed_as_the_parameters_say(class_id):
    assert ContourConfig().for_class(class_id) == ContourConfig()


def test_the_classes_of_people_can_be_chosen():
    config = ContourConfig(person_classes=("0", "walker"))
    assert config.for_class("0").angle_gain == 0
    assert config.for_class("person") == config


def test_without_classes_of_people_none_is_and_a_target_without_a_class_is_not():
    for names in ((), ("",)):
        config = ContourConfig(person_classes=names)
        assert config.for_class("person") == config.for_class("") == config


def test_a_person_stays_upright_where_a_thing_turns(frames):
    of_things = sizes_of(report for _, report, _ in tracked(TURNS, frames=frames))
    of_people = sizes_of(report for _, report, _ in tracked(TURNS, frames=frames, class_id="person"))
    assert max(of_things)[0] > 1.3 * of_things[0][0]
    assert np.ptp(np.divide(*np.transpose(of_people))) == pytest.approx(0)


def test_a_person_that_starts_again_or_whose_stream_does_stays_one(frames):
    tracker = MultiTracker(WIDTH, HEIGHT, contours=CONTOURS)
    tracker.start("thing", TURNS.box("thing", 0.0))
    tracker.start_again("thing", TURNS.box("thing", 0.0), START_NS, "person")
    middle = len(frames) // 2
    proportions = []
    for frame in (*frames[:middle], *frames):
        (report,) = tracker.update(frame.stamp_ns, frame.data)
        if report.box is not None and report.state is not TargetState.IDLE:
            proportions.append(report.box.w / report.box.h)
    assert len(proportions) > middle
    assert np.ptp(proportions) == pytest.approx(0)


def test_methods_without_contours_take_a_class_and_make_nothing_of_it():
    tracker = MultiTracker(WIDTH, HEIGHT)
    tracker.start("thing", TURNS.box("thing", 0.0), class_id="person")
    assert list(tracker.targets) == ["thing"]
