"""What the box network is shown of a box: events where they are by now, what is known of the target, the sensor."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.tracking import BoxView
from etd_ros.tracking.box_view import CELLS, CHANNELS, FIRST_CELLS, NUMBERS
from etd_ros.tracking.box_view_kernels import CONTRAST_MAX, draw_events, draw_model, move_picture
from etd_ros.tracking.contour_kernels import DENSITY, GRADIENT_X, GRADIENT_Y, MAPS

BOX = Box(80, 60, 32, 16)
MIDDLE = np.array([*BOX.center, BOX.w, BOX.h])
VELOCITY = np.array([300.0, -400.0])
SPAN_S = 0.01


def view_of(points=(), **changes):
    rng = np.random.default_rng(1)
    view = BoxView(
        target="thing",
        stamp_ns=0,
        points=np.array(points, np.float32).reshape(-1, 4),
        span_s=SPAN_S,
        box=BOX,
        velocity=VELOCITY,
        usual=rng.random((3, CELLS, CELLS)).astype(np.float32),
        first=rng.random((3, FIRST_CELLS, FIRST_CELLS)).astype(np.float32),
        sensor=(240, 180),
        age_s=0.5,
        growing_per_s=0.0,
    )
    return dataclasses.replace(view, **changes)


def drawn(points, box=MIDDLE, velocity=VELOCITY):
    maps = np.empty((6, CELLS, CELLS), np.float32)
    points = np.array(points, np.float32).reshape(-1, 4)
    return maps, draw_events(points, len(points), box, velocity, SPAN_S, maps)


def middle_of(layer):
    """Column and row of what is drawn, in cells."""
    rows, columns = np.mgrid[:CELLS, :CELLS]
    return (columns * layer).sum() / layer.sum(), (rows * layer).sum() / layer.sum()


@pytest.mark.parametrize("age_s", [0.0, 0.004, 0.009])
def test_an_event_is_drawn_where_the_target_has_taken_it(age_s):
    at = np.add(BOX.center, (8, -4))
    maps, inside = drawn([*(at - age_s * VELOCITY), age_s, 1])
    assert middle_of(maps.sum(0)) == pytest.approx((15.5 + 8 / 2, 15.5 - 4 / 1), abs=1e-3)
    assert inside == 1


@pytest.mark.parametrize(("part", "layer"), [(0.1, 0), (0.3, 2), (0.7, 4), (1.0, 4)])
@pytest.mark.parametrize("polarity", [1, -1])
def test_parts_of_the_time_and_polarities_are_drawn_apart(part, layer, polarity):
    maps, _ = drawn([*BOX.center, part * SPAN_S, polarity], velocity=np.zeros(2))
    assert np.flatnonzero(maps.sum((1, 2))).tolist() == [layer + (polarity < 0)]


def test_what_lies_beyond_twice_the_box_is_not_drawn_and_what_lies_round_it_is_not_counted():
    x, y = BOX.center
    points = [[x + 33, y, 0, 1], [x, y - 17, 0, 1], [x + 20, y, 0, 1]]
    maps, inside = drawn(points, velocity=np.zeros(2))
    assert middle_of(maps.sum(0)) == pytest.approx((15.5 + 10, 15.5), abs=1e-3)
    assert inside == 0


def test_many_events_are_drawn_at_the_contrast_of_few():
    rng = np.random.default_rng(0)
    where = rng.uniform(-0.5, 0.5, (8000, 2)) * (BOX.w, BOX.h) + BOX.center
    points = np.column_stack([where, rng.uniform(0, SPAN_S, 8000), rng.choice([-1, 1], 8000)])
    means = [drawn(points[:number], velocity=np.zeros(2))[0].mean() for number in (2000, 8000)]
    assert means[1] == pytest.approx(2 * means[0], rel=0.1)


def test_one_pixel_that_fires_always_is_not_drawn_brighter_than_the_rest_can_be():
    maps, _ = drawn([[*BOX.center, 0, 1]] * 3000, velocity=np.zeros(2))
    assert maps.max() == CONTRAST_MAX


def model(rng, rows=41, columns=41):
    maps = np.zeros((MAPS, rows, columns), np.float32)
    maps[GRADIENT_X], maps[GRADIENT_Y], maps[DENSITY] = rng.random((3, rows, columns))
    return maps


def test_a_model_is_drawn_as_it_lies_on_the_sensor():
    maps, out = model(np.random.default_rng(0)), np.empty((3, 20, 20), np.float32)
    draw_model(maps, np.array([0, 0, 1.0, 0]), 2.0, 0.0, 0.0, 40.0, 40.0, out)
    inner = maps[:, 10:31, 10:31]
    expected = (inner[:, 1:, 1:] + inner[:, :-1, 1:] + inner[:, 1:, :-1] + inner[:, :-1, :-1]) / 4
    assert out == pytest.approx(expected[[GRADIENT_X, GRADIENT_Y, DENSITY]], abs=1e-5)


def test_a_model_that_is_turned_by_a_quarter_has_its_gradients_turned_as_well():
    maps = model(np.random.default_rng(0))
    upright, turned = np.empty((2, 3, 20, 20), np.float32)
    draw_model(maps, np.array([0, 0, 1.0, 0]), 2.0, 0.0, 0.0, 40.0, 40.0, upright)
    draw_model(maps, np.array([0, 0, 1.0, math.pi / 2]), 2.0, 0.0, 0.0, 40.0, 40.0, turned)
    quarter = np.rot90(upright, -1, (1, 2))
    assert turned[0] == pytest.approx(-quarter[1], abs=1e-4)
    assert turned[1] == pytest.approx(quarter[0], abs=1e-4)
    assert turned[2] == pytest.approx(quarter[2], abs=1e-4)


def test_a_cell_that_is_larger_than_the_models_is_a_mean():
    maps, out = model(np.random.default_rng(0)), np.empty((3, 4, 4), np.float32)
    draw_model(maps, np.array([0, 0, 1.0, 0]), 1.0, 0.0, 0.0, 40.0, 40.0, out)
    assert out.mean((1, 2)) == pytest.approx(maps[[GRADIENT_X, GRADIENT_Y, DENSITY]].mean((1, 2)), rel=0.05)
    assert out.std() < 0.1


def test_beside_the_model_nothing_is_known():
    maps, out = model(np.random.default_rng(0), 11, 11), np.empty((3, 20, 20), np.float32)
    draw_model(maps, np.array([0, 0, 1.0, 0]), 1.0, 30.0, 0.0, 20.0, 20.0, out)
    assert not out.any()


def test_a_picture_is_moved_and_magnified():
    y, x = np.mgrid[:32, :32].astype(np.float32)
    moved = np.empty((2, 32, 32), np.float32)
    move_picture(np.stack([x, y]), 3.0, -2.0, 0.5, 0.25, moved)
    assert moved[0, 16] == pytest.approx((np.arange(32) - 15.5) * 0.5 + 3 + 15.5, abs=1e-4)
    assert moved[1, :, 16] == pytest.approx((np.arange(32) - 15.5) * 0.25 - 2 + 15.5, abs=1e-4)


def test_nothing_is_known_beyond_a_picture():
    moved = np.empty((1, 32, 32), np.float32)
    move_picture(np.ones((1, 32, 32), np.float32), 20.0, 0.0, 1.0, 1.0, moved)
    assert moved[0].sum(0).tolist() == [32] * 12 + [0] * 20


def test_a_view_has_its_events_what_is_known_and_the_sensor():
    view = view_of([[*BOX.center, 0, 1]])
    maps, numbers = view.drawn(view.box, view.velocity)
    assert maps.shape == (CHANNELS, CELLS, CELLS)
    assert numbers.shape == (NUMBERS,)
    assert maps.dtype == numbers.dtype == np.float32
    assert maps[0].any()
    assert not maps[1:6].any()
    assert maps[6] == pytest.approx(0.6 * view.usual[0] - 0.8 * view.usual[1], abs=1e-6)
    assert np.array_equal(maps[7], view.usual[2])
    assert maps[8, 4:-4, 4:-4] == pytest.approx(0.6 * view.first[0] - 0.8 * view.first[1], abs=1e-6)
    assert maps[9].sum() == pytest.approx(view.first[2].sum(), rel=1e-5)
    assert (maps[10] == 1).all()


def test_of_what_rests_no_polarity_is_expected():
    view = view_of(velocity=np.array([3.0, 0.0]))
    maps, numbers = view.drawn(view.box, view.velocity)
    assert not maps[[6, 8]].any()
    assert numbers[2:4].tolist() == [0, 0]


def test_numbers_say_size_speed_direction_age_shape_and_growth():
    view = view_of(growing_per_s=1.5)
    _, numbers = view.drawn(view.box, view.velocity)
    size = math.sqrt(32 * 16)
    expected = [math.log(size / 40), math.log(500 / size), 0.6, -0.8, 0.5, math.log(2), -1, 0.5]
    assert numbers == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(("growing_per_s", "said"), [(50.0, 1.0), (-50.0, -1.0)])
def test_growth_and_age_have_limits(growing_per_s, said):
    _, numbers = view_of(growing_per_s=growing_per_s, age_s=100.0).drawn(BOX, VELOCITY)
    assert numbers[7] == said
    assert numbers[4] == 1


def test_round_another_box_what_is_usual_lies_elsewhere_and_what_was_first_does_not():
    view = view_of()
    maps, _ = view.drawn(view.box, view.velocity)
    moved, _ = view.drawn(Box(BOX.x + 2, BOX.y, BOX.w, BOX.h), view.velocity)
    assert moved[7, :, :-1] == pytest.approx(maps[7, :, 1:], abs=1e-5)
    assert np.array_equal(moved[8:10], maps[8:10])


def test_what_lies_beyond_the_sensor_is_told():
    corner = Box(-8, -4, 32, 16)
    maps, _ = view_of(box=corner).drawn(corner, VELOCITY)
    seen = np.zeros((CELLS, CELLS), bool)
    seen[12:, 12:] = True
    assert np.array_equal(maps[10] == 1, seen)
