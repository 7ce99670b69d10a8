"""For how long a target's looks have failed, and where it stood before that."""

import math

import pytest

from etd_ros.boxes import Box
from etd_ros.tracking.body import Body, Standing
from etd_ros.tracking.doubts import (
    FAILING_S,
    GONE_BEHIND_SURE,
    LEAVING_S,
    OVERSHOT_MAX_PX,
    SURE_AGE_NS,
    SURE_S,
    Doubts,
)
from etd_ros.tracking.surface import TimeSurface

WIDTH, HEIGHT, SIZE = 240, 180, 40.0
START_NS = 1_000_000_000
MIDDLE = Box(100.0, 70.0, SIZE, SIZE)
AT_THE_RIGHT = Box(WIDTH - SIZE, 70.0, SIZE, SIZE)


def doubts_about(box=MIDDLE, velocity=(100.0, 0.0)):
    body = Body(box, START_NS)
    body.velocity = velocity
    return body, Doubts(body, TimeSurface(WIDTH, HEIGHT))


def move_on(body, time_s):
    x, y = body.predicted(body.stamp_ns + round(time_s * 1e9))
    body.go_to(x, y, body.stamp_ns + round(time_s * 1e9), 1.0)


@pytest.mark.parametrize(
    ("box", "velocity", "may_fail_s"),
    [
        (MIDDLE, (100.0, 0.0), FAILING_S),
        (AT_THE_RIGHT, (100.0, 0.0), LEAVING_S),
        (AT_THE_RIGHT, (-100.0, 0.0), FAILING_S),
    ],
    ids=["inside", "moving out", "moving in"],
)
def test_looks_may_fail_for_less_time_where_a_target_is_leaving(box, velocity, may_fail_s):
    _, doubts = doubts_about(box, velocity)
    doubts.doubt(may_fail_s)
    assert not doubts.is_lost
    doubts.doubt(0.001)
    assert doubts.is_lost


def test_a_target_that_was_led_off_the_sensor_is_lost():
    body, doubts = doubts_about()
    body.be_at(WIDTH + 1, body.pose[1])
    assert doubts.is_lost


def test_good_looks_make_up_for_failing_ones_in_less_time():
    _, doubts = doubts_about()
    doubts.doubt(0.1)
    doubts.believe(0.02)
    assert doubts.failing_s == pytest.approx(0.06)
    doubts.believe(1.0)
    assert doubts.failing_s == 0


def test_a_target_goes_back_to_where_it_stood_before_the_first_look_that_failed():
    body, doubts = doubts_about()
    pose, velocity = body.pose, body.velocity
    for _ in range(3):
        doubts.doubt(0.01)
        move_on(body, 0.01)
        body.velocity = 300.0, 50.0
    doubts.go_back()
    assert (body.pose, body.velocity) == (pose, velocity)
    assert body.stamp_ns == START_NS


@pytest.mark.parametrize(("age_ns", "is_sure"), [(SURE_AGE_NS - 1_000_000, True), (SURE_AGE_NS + 1_000_000, False)])
def test_it_goes_back_to_where_it_was_seen_surely_unless_that_was_long_ago(age_ns, is_sure):
    body, doubts = doubts_about()
    doubts.note_sure(0.01)
    move_on(body, age_ns * 1e-9)
    doubts.doubt(0.01)
    assert (doubts.before is doubts.sure) == is_sure
    assert (doubts.seen_surely is doubts.sure) == is_sure


@pytest.mark.parametrize(("velocity", "is_sure"), [((1000.0, 0.0), False), ((1000.0, 600.0), True)])
def test_what_is_fast_goes_back_to_where_it_was_seen_surely_only_if_it_moves_otherwise_since(velocity, is_sure):
    body, doubts = doubts_about(velocity=(1000.0, 0.0))
    doubts.note_sure(0.01)
    move_on(body, 0.02)
    body.velocity = velocity
    doubts.doubt(0.01)
    assert (doubts.before is doubts.sure) == is_sure
    assert doubts.seen_surely is doubts.sure


def test_what_is_found_and_lost_again_at_once_is_not_where_it_was_before():
    body, doubts = doubts_about()
    doubts.note_sure(0.01)
    move_on(body, 0.2)
    doubts.begin_anew()
    stood = body.pose
    doubts.doubt(0.01)
    doubts.go_back()
    assert body.pose == stood


def test_the_velocity_of_what_is_seen_surely_is_an_average():
    body, doubts = doubts_about(velocity=(100.0, 0.0))
    doubts.note_sure(0.01)
    body.velocity = 200.0, 0.0
    doubts.note_sure(SURE_S)
    assert doubts.sure.velocity[0] == pytest.approx(200 - 100 / math.e)


@pytest.mark.parametrize(
    ("moved_share", "has_gone"), [(GONE_BEHIND_SURE - 0.02, False), (GONE_BEHIND_SURE + 0.02, True)]
)
def test_what_moved_on_while_it_was_no_longer_seen_surely_has_gone_behind_something(moved_share, has_gone):
    body, doubts = doubts_about()
    assert not doubts.has_gone_behind, "it was never seen surely"
    doubts.note_sure(0.01)
    doubts.note_usual()
    body.be_at(body.pose[0] + moved_share * SIZE, body.pose[1])
    assert doubts.has_gone_behind == has_gone


def test_what_was_seen_as_usual_just_now_has_not_gone_behind_anything():
    body, doubts = doubts_about()
    doubts.note_sure(0.01)
    body.be_at(body.pose[0] + SIZE, body.pose[1])
    doubts.note_usual()
    assert not doubts.has_gone_behind


@pytest.mark.parametrize(("too_far_px", "is_moved"), [(1.9, True), (2.1, False)])
def test_what_slowed_down_unseen_is_half_way_back_unless_that_is_far(too_far_px, is_moved):
    body, doubts = doubts_about()
    doubts.doubt(0.1)
    x, y, *_ = body.pose
    body.be_at(x + too_far_px * OVERSHOT_MAX_PX, y)
    doubts.come_less_far()
    assert body.pose[0] == pytest.approx(x + too_far_px * OVERSHOT_MAX_PX / (2 if is_moved else 1))
    assert (doubts.failing_s == 0) == is_moved


def test_a_target_that_is_said_to_be_drawn_along_has_failed_since_it_stood_elsewhere():
    body, doubts = doubts_about()
    stood = Standing.of(body)
    move_on(body, 0.2)
    doubts.fail_from(stood)
    assert doubts.failing_s == FAILING_S
    doubts.doubt(0.0)
    doubts.go_back()
    assert body.pose == stood.pose
