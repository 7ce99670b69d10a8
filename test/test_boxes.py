"""Boxes and their overlap."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd_ros.boxes import Box, BoxError, OffSensorError, iou, ious, shared_areas, shared_sides

boxes = st.builds(Box, *(st.floats(-100, 100),) * 2, *(st.floats(0.5, 100),) * 2)


@given(boxes, boxes)
def test_overlap_is_symmetric_and_between_0_and_1(a, b):
    one, other = float(iou(np.array([a]), b)[0]), float(iou(np.array([b]), a)[0])
    assert one == pytest.approx(other, abs=1e-9)
    assert 0 <= one <= 1 + 1e-9


@given(boxes)
def test_a_box_overlaps_itself_fully(box):
    assert float(iou(np.array([box]), box)[0]) == pytest.approx(1)


def test_half_overlapping_squares_share_a_third():
    np.testing.assert_allclose(iou(np.array([(5, 0, 10, 10), (20, 0, 10, 10)], float), Box(0, 0, 10, 10)), [1 / 3, 0])


def shared_part(box, other):
    across = min(box.x + box.w, other.x + other.w) - max(box.x, other.x)
    down = min(box.y + box.h, other.y + other.h) - max(box.y, other.y)
    shared = max(across, 0.0) * max(down, 0.0)
    return shared / (box.w * box.h + other.w * other.h - shared)


@given(st.lists(boxes, min_size=1, max_size=4), st.lists(boxes, min_size=1, max_size=3))
def test_every_pair_of_boxes_shares_what_the_two_share(first, second):
    expected = [[shared_part(box, other) for other in second] for box in first]
    np.testing.assert_allclose(ious(np.array(first, float), np.array(second, float)), expected)
    np.testing.assert_allclose([[box.iou(other) for other in second] for box in first], expected)


def test_how_far_boxes_reach_into_others_is_below_0_by_the_gap_between_them():
    boxes, others = np.array([[0.0, 0.0, 10.0, 6.0]]), np.array([[4.0, -2.0, 10.0, 5.0], [13.0, 1.0, 2.0, 2.0]])
    np.testing.assert_array_equal(shared_sides(boxes, others), [[[6.0, -3.0]], [[3.0, 2.0]]])
    np.testing.assert_array_equal(shared_areas(boxes, others), [[18.0, 0.0]])


@given(boxes, st.floats(0.1, 5))
def test_scaling_keeps_the_centre(box, factor):
    scaled = box.scaled(factor)
    np.testing.assert_allclose(scaled.center, box.center, atol=1e-9)
    assert scaled.w == pytest.approx(box.w * factor)


@pytest.mark.parametrize(
    ("box", "words"),
    [
        (Box(0, 0, 0, 5), "no area"),
        (Box(0, 0, 5, -1), "no area"),
        (Box(100, 0, 5, 5), "off the 100x80 sensor"),
        (Box(0, -5, 5, 5), "off the 100x80 sensor"),
        (Box(float("nan"), 0, 5, 5), "not finite"),
        (Box(-1.5e307, 0, 1.7e308, 30), "impossible: give numbers up to 1e\\+06 pixels"),
        (Box(0, 0, 1e155, 30), "impossible"),
    ],
)
def test_boxes_that_hold_no_object_are_refused(box, words):
    with pytest.raises(BoxError, match=words):
        box.check(100, 80)


def test_a_box_over_the_border_is_accepted():
    Box(-3, 70, 20, 20).check(100, 80)


def test_only_the_sensor_is_to_blame_for_a_box_that_lies_off_it():
    with pytest.raises(OffSensorError):
        Box(100, 0, 5, 5).check(100, 80)
    with pytest.raises(BoxError) as refusal:
        Box(100, 0, 0, 5).check(100, 80)
    assert not isinstance(refusal.value, OffSensorError)


@pytest.mark.parametrize("box", [Box(10, 10, 1e-9, 1e-9), Box(10, 10, 30, 1.9), Box(10, 10, 1.9, 30)])
def test_no_target_starts_at_a_box_that_is_too_thin_to_be_followed(box):
    box.check(100, 80)
    with pytest.raises(BoxError, match="too small to be followed: width and height must be 2 pixels or more"):
        box.check_start()
    grown = box.at_least(2)
    grown.check_start()
    assert grown.center == pytest.approx(box.center)
    assert grown.at_least(2) == grown


@pytest.mark.parametrize("box", [Box(-1, -1, 102, 82), Box(0, 0, 100, 80)])
def test_a_box_that_covers_the_whole_sensor_is_refused(box):
    with pytest.raises(BoxError, match="covers the whole 100x80 sensor: give the box of an object on it"):
        box.check_not_all(100, 80)


@pytest.mark.parametrize("box", [Box(1, -1, 101, 82), Box(-1, -1, 100, 82), Box(-1, 2, 102, 81)])
def test_a_box_with_a_side_on_the_sensor_does_not_cover_it(box):
    box.check_not_all(100, 80)
