"""What looks usually say, and how far a look is like them."""

import pytest

from etd_ros.tracking.look import Look
from etd_ros.tracking.usual_looks import UsualLooks


def look(score=2.0, events=400.0, motion=1.0, scale=1.0):
    return Look(10.0, 20.0, score, events, motion, (1.0, 0.0), scale)


def usual_of(*looks):
    usual = UsualLooks()
    for each in looks:
        usual.learn(each)
    return usual


def test_before_a_look_was_believed_every_look_is_as_usual():
    assert UsualLooks().confidence(look(0.1, 1.0)) == 1.0


@pytest.mark.parametrize(("seen", "share"), [((1.0, 400.0), 0.5), ((2.0, 100.0), 0.25), ((3.0, 800.0), 1.5)])
def test_a_look_is_as_sure_as_the_lesser_of_its_score_and_its_events(seen, share):
    assert usual_of(look()).confidence(look(*seen)) == pytest.approx(share)


def test_a_slow_target_with_few_events_is_as_sure_as_a_fast_one():
    assert usual_of(look()).confidence(look(1.0, 100.0, motion=0.25)) == pytest.approx(1.0)


def test_a_target_that_has_shrunk_has_as_many_fewer_events():
    usual = usual_of(look())
    assert usual.confidence(look(2.0, 200.0, scale=0.5)) == pytest.approx(1.0)
    assert usual.confidence(look(2.0, 400.0, scale=2.0)) == pytest.approx(0.5)
    assert usual.confidence_of_lost(look(2.0, 200.0, scale=0.5)) == pytest.approx(1.0)


def test_few_events_do_not_count_for_many_where_the_motion_of_a_lost_target_is_not_known():
    usual = usual_of(*[look()] * 50)
    slow = look(1.0, 100.0, motion=0.25)
    assert usual.confidence_of_lost(slow) == pytest.approx(0.25)
    assert usual.confidence(slow) == pytest.approx(1.0)


def test_looks_of_misjudged_motion_hardly_move_what_is_usual():
    usual = usual_of(*[look()] * 50, *[look(2.0, 40_000.0)] * 3)
    assert usual.confidence(look()) > 0.85
