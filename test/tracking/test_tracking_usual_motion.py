"""What a target usually does tells how far a look may find it from where it should be."""

import pytest

from etd_ros.tracking.usual_motion import JUMP_MIN_PX, JUMPS, UsualMotion


def learnt(jump_px):
    motion = UsualMotion()
    for _ in range(200):
        motion.learn_jump(jump_px)
    return motion


def test_small_jumps_are_plausible_and_larger_ones_the_less_the_farther():
    motion = UsualMotion()
    assert motion.plausible(JUMP_MIN_PX, 0.0, 0.0) == 1.0
    assert motion.plausible(4 * JUMPS * JUMP_MIN_PX, 0.0, 0.0) == pytest.approx(0.25)


def test_a_target_that_never_jumps_is_not_believed_to_do_so():
    assert learnt(0.05).plausible(2.0, 0.0, 0.0) == pytest.approx(JUMP_MIN_PX / 2.0)
    assert learnt(9.0).plausible(JUMPS * JUMP_MIN_PX, 0.0, 0.0) == pytest.approx(1.0), "one jump makes no habit"


def test_what_is_fast_or_was_so_until_lately_may_be_far_when_it_was_not_seen_for_long():
    motion = UsualMotion()
    motion.learn_speed(100.0, 10.0)
    assert motion.speed_px_s == pytest.approx(100.0)
    assert motion.plausible(20.0, 0.0, 0.1) == 1.0
    assert motion.plausible(20.0, 0.0, 0.01) < 0.3
    assert UsualMotion().plausible(20.0, 100.0, 0.1) == 1.0
