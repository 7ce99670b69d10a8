"""What stands still in what a camera slides past goes the way of all that; what moves by itself is not held to it."""

import math

import pytest

from etd_ros.boxes import Box
from etd_ros.tracking.body import Body, Standing
from etd_ros.tracking.camera_slide import Slide
from etd_ros.tracking.slid_past import BEFORE_S, FAR_PX, GROWS_PER_S, SHARE, SlidPast, parts_of

WAY = math.cos(0.5), math.sin(0.5)
SLIDE = Slide(WAY, 0)
STEP_S = 0.004


class Target:
    """A target that is where looks find it, and what is known of it."""

    def __init__(self):
        self.slid_past = SlidPast()
        self.body = Body(Box(50.0, 40.0, 30.0, 20.0), 0)
        self._stamp_ns = 0

    def go(self, along_px_s, across_px_s, *, slide=SLIDE, for_s=0.6):
        """Move at these speeds along WAY and to its right for a time (s)."""
        for _ in range(round(for_s / STEP_S)):
            self._stamp_ns += round(STEP_S * 1e9)
            x, y, _, _ = self.body.pose
            (right, down), along_px, across_px = WAY, along_px_s * STEP_S, across_px_s * STEP_S
            x += along_px * right - across_px * down
            y += along_px * down + across_px * right
            self.slid_past.take(x, y, self._stamp_ns, self.body, slide)
            self.body.go_to(x, y, self._stamp_ns, 1.0)
        return self

    def look(self, across_px):
        """A look finds it so far to the right of WAY from where it is."""
        self._stamp_ns += round(STEP_S * 1e9)
        x, y, _, _ = self.body.pose
        self.slid_past.take(x - across_px * WAY[1], y + across_px * WAY[0], self._stamp_ns, self.body, SLIDE)


def test_what_goes_the_way_of_all_stands_in_what_the_camera_slides_past():
    assert Target().go(60.0, 0.0).slid_past.direction == WAY


@pytest.mark.parametrize(
    ("along_px_s", "across_px_s"), [(60.0, 20.0), (60.0, -20.0), (-60.0, 0.0), (0.0, 60.0), (2.0, 0.0)]
)
def test_what_goes_another_way_or_hardly_does_so_by_itself(along_px_s, across_px_s):
    assert Target().go(along_px_s, across_px_s).slid_past.direction is None


def test_what_goes_nearly_that_way_is_held_to_it_only_if_it_was_before():
    nearly = 60.0, 60.0 * math.tan(math.radians(5)) + 1.5
    assert Target().go(60.0, 20.0).go(*nearly).slid_past.direction is None
    assert Target().go(60.0, 0.0).go(*nearly).slid_past.direction == WAY


def test_what_turns_into_that_way_and_on_is_not_held_to_it():
    target = Target().go(60.0, 60.0)
    for across_px_s in (30.0, -30.0, -60.0):
        assert target.go(60.0, across_px_s, for_s=0.2).slid_past.direction is None


def test_nothing_is_held_where_no_direction_is_known():
    target = Target().go(60.0, 0.0).go(60.0, 0.0, slide=None, for_s=2 * STEP_S)
    assert target.slid_past.direction is None
    assert target.slid_past.held((3.0, 4.0)) == (3.0, 4.0)


def test_of_what_looks_say_across_little_is_believed():
    target = Target().go(60.0, 0.0)
    target.look(0.0)
    assert parts_of(target.slid_past.held((3.0, 4.0)), WAY) == pytest.approx(
        (parts_of((3.0, 4.0), WAY)[0], SHARE * parts_of((3.0, 4.0), WAY)[1])
    )


def test_what_looks_find_far_across_has_set_off_by_itself():
    target = Target().go(60.0, 0.0)
    target.look(FAR_PX)
    assert target.slid_past.held((3.0, 4.0)) == pytest.approx((3.0, 4.0))


def started(*, stamp_ns=0):
    """A target whose start has just ended, where nothing is known of a slide yet."""
    target = Target()
    target.slid_past.begin(Standing(stamp_ns, target.body.pose, (0.0, 0.0)), None)
    return target


def off_its_way_px(target):
    x, y = target.body.box.center
    return parts_of((x - 65.0, y - 50.0), WAY)[1]


def strayed(target, *, across_px=1.5, grown=-0.06):
    """The target goes the way of all for a while, and comes off it and shrinks by that, as long as it is not known."""
    target.go(60.0, across_px / 0.4, slide=None, for_s=0.4)
    target.body.grow(grown)
    return target.go(60.0, 0.0)


def test_what_strayed_before_the_direction_was_known_is_put_right():
    target = strayed(started())
    assert off_its_way_px(target) == pytest.approx(0.0, abs=0.1)
    assert (target.body.box.w, target.body.box.h) == pytest.approx((30.0, 20.0))


def test_it_is_put_right_once():
    target = strayed(started())
    target.go(60.0, 0.0, slide=None, for_s=0.1)
    assert off_its_way_px(strayed(target)) == pytest.approx(1.5, abs=0.1)


def test_what_started_before_the_direction_is_known_to_have_been_may_have_gone_another_way():
    for before_s, off_px in ((0.9 * BEFORE_S, 0.0), (1.1 * BEFORE_S, 1.5)):
        assert off_its_way_px(strayed(started(stamp_ns=round(-before_s * 1e9)))) == pytest.approx(off_px, abs=0.1)


def test_what_has_come_far_off_its_way_has_gone_another_one():
    assert off_its_way_px(strayed(started(), across_px=12.0)) == pytest.approx(12.0, abs=0.1)


def test_what_is_known_to_grow_has_done_so():
    target = started()
    target.body.growing.per_s = rate = -1.1 * GROWS_PER_S
    assert strayed(target).body.box.w == pytest.approx(30.0 * math.exp(rate * 1.0 - 0.06), rel=0.01)


def test_what_goes_with_all_from_its_start_on_has_nothing_to_put_right():
    target = Target()
    target.slid_past.begin(Standing(0, target.body.pose, (60.0 * WAY[0], 60.0 * WAY[1])), SLIDE)
    assert target.slid_past.direction == WAY
    assert off_its_way_px(strayed(target)) == pytest.approx(1.5, abs=0.1)
