"""A target's box on its model: it moves, turns and grows with it, and is put right on it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.tracking.model_box import OFFSET_MAX, RATIO_MAX, ModelBox
from etd_ros.tracking.shape import DIRECTIONS

WIDTH, HEIGHT = 40.0, 30.0
ANGLES = np.arange(DIRECTIONS) * 2 * math.pi / DIRECTIONS


def pose(scale=1.0, angle_rad=0.0):
    return 100.0, 80.0, scale, angle_rad


def at(box, pose):
    return box.at(100.0, 80.0, pose)


def test_the_box_grows_with_the_model():
    assert at(ModelBox(WIDTH, HEIGHT), pose(scale=2.0)) == Box(60, 50, 80, 60)


def test_a_quarter_turn_swaps_width_and_height():
    assert at(ModelBox(WIDTH, HEIGHT), pose(angle_rad=math.pi / 2)) == pytest.approx(Box(85, 60, 30, 40))


def test_a_turned_box_lies_between_an_ellipse_and_a_rectangle():
    box = at(ModelBox(WIDTH, WIDTH), pose(angle_rad=math.pi / 4))
    assert WIDTH < box.w < WIDTH * math.sqrt(2)
    assert box.h == pytest.approx(box.w)


def test_a_box_whose_shape_is_known_is_that_of_the_turned_shape():
    box = ModelBox(WIDTH, WIDTH)
    corners = np.abs(np.cos(ANGLES)) + np.abs(np.sin(ANGLES))
    box.take_shape(corners)
    assert at(box, pose(2.0, math.pi / 4)).w == pytest.approx(2 * WIDTH * math.sqrt(2), rel=0.01)
    assert box.size_at_first(pose(2.0, math.pi / 4)) == pytest.approx([2 * WIDTH * math.sqrt(2)] * 2, rel=0.01)
    box.take_shape(np.ones(DIRECTIONS))
    assert at(box, pose(2.0, math.pi / 4)) == pytest.approx(Box(60, 40, 80, 80))


def test_a_shape_that_is_not_the_same_all_round_moves_its_box():
    box, reach = ModelBox(WIDTH, WIDTH), np.ones(DIRECTIONS)
    reach[DIRECTIONS // 8] = math.sqrt(2)
    box.take_shape(reach)
    turned = at(box, pose(1.0, math.pi / 4))
    assert turned.center == pytest.approx((100, 80 + (math.sqrt(2) - 1) * WIDTH / 4))


@pytest.mark.parametrize("angle_rad", [0.0, 0.4, math.pi / 2, -2.0])
@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_a_correction_moves_the_box_as_it_says_however_the_model_lies(angle_rad, scale):
    box, here = ModelBox(WIDTH, HEIGHT), pose(scale, angle_rad)
    before = at(box, here)
    box.correct(2.0, -1.0, 0.0, 0.0, here)
    after = at(box, here)
    assert np.subtract(after.center, before.center) == pytest.approx((2.0, -1.0))
    assert (after.w, after.h) == pytest.approx((before.w, before.h))


@pytest.mark.parametrize("angle_rad", [0.0, math.pi / 2, math.pi])
def test_it_becomes_wider_and_higher_as_told_on_the_sensor(angle_rad):
    box, here = ModelBox(WIDTH, HEIGHT), pose(1.5, angle_rad)
    before = at(box, here)
    box.correct(0.0, 0.0, math.log(1.2), math.log(0.9), here)
    after = at(box, here)
    assert (after.w, after.h) == pytest.approx((1.2 * before.w, 0.9 * before.h))
    assert after.center == pytest.approx(before.center)


def test_what_was_put_right_turns_and_grows_with_the_model():
    box = ModelBox(WIDTH, HEIGHT)
    box.correct(4.0, 0.0, 0.0, 0.0, pose())
    assert at(box, pose(2.0, math.pi / 2)).center == pytest.approx((100.0, 88.0))


def test_the_size_at_first_is_without_what_was_put_right():
    box, here = ModelBox(WIDTH, HEIGHT), pose(2.0)
    box.correct(0.0, 0.0, 0.2, 0.2, here)
    assert box.size_at_first(here) == (2 * WIDTH, 2 * HEIGHT)
    assert at(box, here).w > 2 * WIDTH


def test_it_stays_on_its_model():
    box, here = ModelBox(WIDTH, HEIGHT), pose()
    for _ in range(20):
        box.correct(5.0, -5.0, 0.1, -0.1, here)
    found = at(box, here)
    assert found.center == pytest.approx((100 + OFFSET_MAX * WIDTH, 80 - OFFSET_MAX * HEIGHT))
    assert (found.w, found.h) == pytest.approx((WIDTH * RATIO_MAX, HEIGHT / RATIO_MAX))


def test_after_a_reset_it_lies_as_at_the_start():
    box, here = ModelBox(WIDTH, HEIGHT), pose()
    box.correct(3.0, 2.0, 0.1, 0.0, here)
    box.reset()
    assert at(box, here) == Box(80, 65, WIDTH, HEIGHT)
