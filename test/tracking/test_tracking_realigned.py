"""Own targets whose boxes no longer fit what is seen to move there."""

import pytest

from etd_ros.boxes import Box
from etd_ros.tracking.auto_candidates import Candidate
from etd_ros.tracking.clusters import Sighting
from etd_ros.tracking.own_targets import OwnTarget
from etd_ros.tracking.realigned import Realigned

LOOK_NS, LOOKS = 30_000_000, 12
SEEN = Box(100, 60, 40, 90)


def own_target(box, name="auto_1"):
    return OwnTarget(name, box, 2.0, {0: box.center})


def realigned(own, seen=lambda _: [SEEN], others=(), looks=LOOKS):
    """What the looks say to boxes that stay where they are."""
    rule, said = Realigned(240, 180), []
    for look in range(looks):
        stamp_ns = look * LOOK_NS
        candidates = [Candidate(Sighting(box, (0.0, 0.0), 1.0), stamp_ns, 0, box.center) for box in seen(look)]
        said += rule.take(stamp_ns, candidates, own, others)
    return said


@pytest.mark.parametrize("drifted", [Box(80, 30, 90, 150), Box(100, 110, 40, 40), Box(115, 75, 16, 30)])
def test_a_box_that_is_off_for_long_goes_on_with_what_is_seen_there(drifted):
    assert realigned([own_target(drifted)])[0] == ("auto_1", SEEN)


def test_parts_that_are_seen_one_by_one_are_taken_together():
    limbs = [Box(100, 60, 40, 30), Box(105, 95, 30, 55)]
    assert realigned([own_target(Box(70, 30, 110, 150))], seen=lambda _: limbs)[0] == ("auto_1", Box(100, 60, 40, 90))


def test_a_box_that_fits_stays():
    assert not realigned([own_target(Box(95, 55, 48, 96))])


def test_a_box_that_is_off_for_a_moment_only_stays():
    seen = [Box(100, 60, 40, 90), Box(100, 60, 40, 20)]
    assert not realigned([own_target(SEEN)], seen=lambda look: [seen[look in (4, 5, 6)]])


def test_a_box_stays_where_what_is_seen_is_each_time_something_else():
    seen = [Box(90, 50, 12, 12), Box(130, 60, 12, 30), Box(100, 120, 30, 12)]
    assert not realigned([own_target(Box(80, 40, 80, 110))], seen=lambda look: [seen[look % 3]])


def test_a_box_does_not_follow_what_is_seen_beyond_the_sensor():
    assert not realigned([own_target(Box(215, 60, 60, 90))], seen=lambda _: [Box(238, 70, 20, 40)])


@pytest.mark.parametrize("is_own", [True, False])
def test_a_box_stays_where_what_is_seen_may_be_another_targets(is_own):
    drifted, beside = Box(80, 30, 90, 150), Box(120, 60, 30, 90)
    own = [own_target(drifted), *([own_target(beside, "auto_2")] if is_own else [])]
    said = realigned(own, others=() if is_own else [beside])
    assert "auto_1" not in dict(said)
