"""What to track."""

import pytest

from etd_ros.boxes import Box
from etd_ros.targets import (
    TargetError,
    TargetStart,
    check_start,
    late_starts,
    parse_click,
    parse_target,
    targets_from_file,
    unique_targets,
)
from etd_ros.tracking import Click


def test_a_target_is_read_from_text():
    assert parse_target("my ball:1,2.5,30,40@17") == TargetStart("my ball", Box(1, 2.5, 30, 40), 17)
    assert parse_target("a:b:1,2,3,4") == TargetStart("a:b", Box(1, 2, 3, 4), 0)


def test_a_class_may_follow_a_target_in_text():
    assert parse_target("a=b:1,2,3,4@17=traffic sign") == TargetStart("a=b", Box(1, 2, 3, 4), 17, "traffic sign")
    assert parse_target("anna:1,2,3,4= person ") == TargetStart("anna", Box(1, 2, 3, 4), 0, "person")


def test_an_empty_class_is_refused():
    with pytest.raises(TargetError, match="empty class: give NAME:X,Y,W,H=CLASS"):
        parse_target("anna:1,2,3,4=")


@pytest.mark.parametrize(
    "text", ["ball", "ball:1,2,3", "ball:1,2,3,x", "ball:1,2,3,4@soon", ":1,2,3,4", "b:1,2,3,4@-5"]
)
def test_text_of_another_form_is_refused(text):
    with pytest.raises(TargetError, match="NAME:X,Y,W,H"):
        parse_target(text)


def test_targets_start_at_the_first_row_of_each_name(tmp_path):
    path = tmp_path / "boxes.csv"
    path.write_text("target,stamp_ns,x,y,w,h\na,10,1,2,3,4\na,20,5,6,7,8\nb,20,1,1,1,1\n")
    assert targets_from_file(path) == [TargetStart("a", Box(1, 2, 3, 4), 10), TargetStart("b", Box(1, 1, 1, 1), 20)]


def test_a_file_may_say_what_each_target_is_where_it_starts(tmp_path):
    path = tmp_path / "boxes.csv"
    path.write_text("target,stamp_ns,x,y,w,h,class\na,20,5,6,7,8,\na,10,1,2,3,4, Person \nb,20,1,1,1,1,\n")
    assert [(target.name, target.stamp_ns, target.class_id) for target in targets_from_file(path)] == [
        ("a", 10, "Person"),
        ("b", 20, ""),
    ]


def test_a_name_given_twice_is_refused():
    with pytest.raises(TargetError, match="'a' is given twice"):
        unique_targets([parse_target("a:1,2,3,4"), parse_target("a:5,6,7,8")])


def test_a_start_long_before_the_first_event_is_refused_and_a_little_before_is_not():
    target = parse_target("a:1,2,3,4@1000000000")
    target.check_start(1_450_000_000)
    with pytest.raises(TargetError, match="before the first event"):
        target.check_start(1_600_000_000)


def test_starts_beyond_either_end_of_a_recording_are_told_alike():
    start, early = parse_target("a:1,2,3,4@9"), parse_target("b:1,2,3,4@1000000000")
    assert late_starts([start, early], 9) == [
        "target 'b' starts at 1000000000 ns, after the last frame at 9 ns, and is not tracked: give a stamp on the "
        "events' clock"
    ]
    with pytest.raises(TargetError) as refused:
        early.check_start(2_000_000_000)
    assert str(refused.value) == (
        "target 'b' starts at 1000000000 ns, before the first event at 2000000000 ns: give a stamp on the events' clock"
    )


def test_a_click_is_read_from_text():
    assert parse_click("my ball:1,2.5@17") == Click("my ball", 1, 2.5, 17)
    assert parse_click("a:b:1,2") == Click("a:b", 1, 2, 0)


@pytest.mark.parametrize("text", ["ball", "ball:1", "ball:1,2,3,4", "ball:1,x", "ball:1,2@soon", ":1,2", "b:1,2@-5"])
def test_text_that_is_no_click_is_refused(text):
    with pytest.raises(TargetError, match="NAME:X,Y"):
        parse_click(text)


def test_a_click_long_before_the_first_event_is_refused():
    with pytest.raises(TargetError, match="'a' starts at"):
        check_start(Click("a", 1, 2, 1_000_000_000), 1_600_000_000)


def test_a_click_may_not_have_a_targets_name():
    with pytest.raises(TargetError, match="'a' is given twice"):
        unique_targets([parse_target("a:1,2,3,4"), parse_click("a:5,6")])
