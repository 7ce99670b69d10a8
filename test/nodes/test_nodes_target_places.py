"""Who a node follows, before there is a tracker and beside it."""

import pytest

from etd_ros.boxes import Box
from etd_ros.nodes.target_limits import LOST_MIN_S
from etd_ros.nodes.target_places import TargetPlaces, first_of_each
from etd_ros.targets import TargetStart
from etd_ros.tracking import Click, ContourConfig, MultiTracker, TargetReport, TargetState

BOX = Box(20.0, 10.0, 12.0, 9.0)
LOST_NS = round(LOST_MIN_S * 1e9)


def start(name, class_id=""):
    return TargetStart(name, BOX, class_id=class_id)


def tracker_of(*names):
    tracker = MultiTracker(64, 48, contours=ContourConfig())
    for name in names:
        tracker.start(name, BOX)
    return tracker


def followed(places, *names, lost=()):
    """The places after a frame of a tracker that follows these targets, and lost some of them."""
    reports = [
        TargetReport(name, TargetState.LOST if name in lost else TargetState.TRACKING, BOX, 1.0) for name in names
    ]
    for stamp_ns in (0, LOST_NS):
        places.note(stamp_ns, tracker_of(*names), reports)
    places.has_begun = True
    return places


def test_configured_targets_count_before_there_is_a_tracker():
    places = TargetPlaces([start("ball")])
    places.new["drum"] = start("drum")
    assert len(places) == 2
    assert places.has_any


def test_once_there_is_a_tracker_what_it_follows_counts():
    assert len(followed(TargetPlaces([start("ball"), start("drum")]), "ball")) == 1


def test_nobody_is_asked_for_where_nothing_is_configured():
    assert not TargetPlaces([]).has_any


def test_what_is_new_starts_with_all_others_on_a_new_tracker():
    places = TargetPlaces([start("ball")])
    places.new["drum"] = start("drum")
    assert places.begin() == {"drum"}
    assert set(places.targets) == {"ball", "drum"}
    assert not places.new


def test_a_target_that_is_followed_and_stopped_is_told_to_the_tracker():
    places = followed(TargetPlaces([start("ball")]), "ball")
    places.stop("ball")
    assert places.stopped == {"ball"}
    assert not places.has_any


def test_a_target_that_never_began_is_forgotten_without_a_word_to_the_tracker():
    places = TargetPlaces([])
    places.new["ball"] = start("ball")
    places.clicks.append(Click("point_1", 5.0, 5.0))
    places.stop("ball")
    places.stop("point_1")
    assert not places.stopped
    assert not places.has_any


@pytest.mark.parametrize(("new", "known"), [("", "person"), ("car", "car")])
def test_a_target_is_what_its_newest_start_says(new, known):
    places = TargetPlaces([start("somebody", "person")])
    if new:
        places.new["somebody"] = start("somebody", new)
    assert places.class_of("somebody") == known
    assert places.class_of("nobody") == ""


def test_what_is_lost_for_long_makes_room_but_not_what_was_configured():
    places = followed(TargetPlaces([start("configured")]), "configured", "sent", "seen", lost=("configured", "sent"))
    assert list(places.leaving(set())) == ["sent"]


def test_what_no_sensor_holds_makes_room_first():
    places = followed(TargetPlaces([]), "lost", lost=("lost",))
    places.targets["nowhere"] = start("nowhere")
    assert list(places.leaving(set())) == ["nowhere", "lost"]
    assert list(places.leaving({"nowhere"})) == ["lost"]


def test_names_that_are_held_are_not_given_again():
    places = followed(TargetPlaces([]), "target_1")
    places.clicks.append(Click("target_2", 5.0, 5.0))
    assert places.held() == {"target_1", "target_2"}
    assert [places.next_name("target", places.held()) for _ in range(2)] == ["target_3", "target_4"]
    assert places.next_name("point", places.held()) == "point_1"


def test_of_boxes_with_one_name_in_a_message_the_first_counts_and_the_same_again_is_nothing_new():
    other = Box(1.0, 2.0, 5.0, 5.0)
    ball, drum = [start("ball"), TargetStart("ball", other)], [start("drum"), start("drum")]
    starts = [*ball, *drum, start(""), TargetStart("", other)]
    kept, repeated = first_of_each(starts)
    assert kept == [starts[0], starts[2], starts[4], starts[5]]
    assert repeated == ["ball"]
