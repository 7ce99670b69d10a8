"""A target's pose, motion and box."""

import math

import pytest

from etd_ros.boxes import Box
from etd_ros.tracking.body import FLIES_ON_MAX, SCALE_LIMITS, Body, Standing, nearer
from etd_ros.tracking.look_pace import FAST_SIZES_PER_S

START_NS = 1_000_000_000
BOX = Box(10.0, 10.0, 20.0, 50.0)


@pytest.fixture
def body():
    return Body(BOX, START_NS)


def test_a_target_loses_overlap_by_its_motion_in_parts_of_its_width_and_of_its_height():
    body = Body(Box(10.0, 10.0, 20.0, 50.0), START_NS)
    assert body.sizes_per_s == 0
    body.velocity = -200.0, 100.0
    assert body.sizes_per_s == pytest.approx(200 / 20 + 100 / 50)


def test_what_moves_by_many_of_its_sizes_a_second_is_fast(body):
    body.velocity = (FAST_SIZES_PER_S - 0.1) * BOX.w, 0.0
    assert not body.is_fast
    body.velocity = (FAST_SIZES_PER_S + 0.1) * BOX.w, 0.0
    assert body.is_fast


@pytest.mark.parametrize(
    ("sizes_per_s", "changed_share", "flies_on"),
    [(30.0, FLIES_ON_MAX - 0.01, True), (30.0, FLIES_ON_MAX + 0.01, False), (FAST_SIZES_PER_S / 2, 0.0, False)],
    ids=["as it did", "otherwise", "slow"],
)
def test_what_is_fast_flies_on_while_it_moves_about_as_it_did(body, sizes_per_s, changed_share, flies_on):
    speed_px_s = sizes_per_s * BOX.w
    body.velocity = speed_px_s, 0.0
    then = Standing(START_NS, body.pose, (speed_px_s, changed_share * speed_px_s))
    assert body.flies_on_from(then) == flies_on


def test_a_body_goes_on_moving_turning_and_growing(body):
    body.velocity = 100.0, -40.0
    body.turning.per_s, body.growing.per_s = 2.0, 0.5
    later_ns = START_NS + 50_000_000
    assert body.predicted(later_ns) == pytest.approx((25.0, 33.0))
    assert body.changed(later_ns) == pytest.approx((math.exp(0.025), 0.1))
    assert body.motion.tolist() == [100.0, -40.0, 2.0, 0.5]


def test_the_velocity_follows_the_way_to_a_place_by_what_that_is_believed(body):
    stamp_ns = START_NS + 50_000_000
    whole = body.velocity_to(30.0, 35.0, stamp_ns)
    assert whole == pytest.approx((100.0, 0.0))
    body.go_to(30.0, 35.0, stamp_ns, 0.25)
    assert body.velocity == pytest.approx((0.25 * whole[0], 0.25 * whole[1]))
    assert body.pose[:2] == (30.0, 35.0)
    assert body.stamp_ns == stamp_ns


def test_no_velocity_is_told_where_no_time_has_passed(body):
    body.velocity = 7.0, 8.0
    assert body.velocity_to(99.0, 99.0, START_NS) == (7.0, 8.0)


def test_a_velocity_that_comes_nearer_to_another_goes_a_share_of_the_way():
    assert nearer((100.0, -40.0), (0.0, 60.0), 0.25) == pytest.approx((75.0, -15.0))
    assert nearer((100.0, -40.0), (0.0, 60.0), 0.0) == (100.0, -40.0)
    assert nearer((100.0, -40.0), (0.0, 60.0), 1.0) == (0.0, 60.0)


def test_a_body_that_goes_on_as_usual_neither_turns_nor_grows(body):
    body.turning.per_s, body.growing.per_s = 2.0, 0.5
    body.go_on_at((60.0, 0.0), 0.5)
    assert body.motion.tolist() == [30.0, 0.0, 0.0, 0.0]


def test_a_body_that_is_elsewhere_is_as_large_and_turned_as_before(body):
    body.pose = 20.0, 35.0, 1.5, 0.3
    body.be_at(60.0, 70.0)
    assert body.pose == (60.0, 70.0, 1.5, 0.3)


def test_a_body_that_is_turned_is_as_large_and_where_it_was_before(body):
    body.pose = 20.0, 35.0, 1.5, 0.3
    body.turn_to(-0.4)
    assert body.pose == (20.0, 35.0, 1.5, -0.4)


def test_a_pose_is_not_changed_in_place(body):
    with pytest.raises(TypeError):
        body.pose[0] = 60.0


def test_the_scale_stays_within_limits(body):
    body.grow(10.0)
    assert body.pose[2] == SCALE_LIMITS[1]
    body.grow(-10.0)
    assert body.pose[2] == SCALE_LIMITS[0]


def test_what_has_changed_since_a_pose_is_counted_from_there(body):
    at_first = body.pose
    for time_s in (0.1, 0.2):
        body.change_since(at_first, 0.5, -1.0, time_s)
        assert body.pose[2:] == pytest.approx((math.exp(0.5 * time_s), -time_s))
    assert body.motion.tolist() == [0.0, 0.0, -1.0, 0.5]


def test_a_body_that_appears_in_a_box_is_as_large_as_that_and_lies_in_it(body):
    body.correct_box(3.0, -2.0, 0.1, 0.2)
    body.appear(Box(100.0, 60.0, 40.0, 100.0), 0.0, START_NS + 5)
    assert body.box == pytest.approx(Box(100.0, 60.0, 40.0, 100.0))
    assert body.stamp_ns == START_NS + 5


def test_a_corrected_box_leaves_the_pose_and_the_size_at_first(body):
    pose = body.pose
    body.correct_box(3.0, -2.0, math.log(1.1), 0.0)
    assert body.box == pytest.approx(Box(23.0 - 11.0, 33.0 - 25.0, 22.0, 50.0))
    assert body.size_at_first == (20.0, 50.0)
    assert body.pose == pose


def test_where_a_body_stood_stays_when_it_moves_on(body):
    body.velocity = 100.0, 0.0
    stood = Standing.of(body)
    body.go_to(80.0, 90.0, START_NS + 10_000_000, 1.0)
    assert stood.predicted(START_NS + 10_000_000) == pytest.approx((21.0, 35.0))
