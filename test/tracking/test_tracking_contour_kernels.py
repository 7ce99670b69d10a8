"""The contour tracker's kernels against what they say they do, in NumPy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.ndimage import map_coordinates

from etd_ros.tracking.contour_drawing import learn, normalise, splat
from etd_ros.tracking.contour_kernels import (
    MAPS,
    WEIGHT,
    arm_cells,
    measure_norms,
    parabola,
    score_at,
    scores_of_shapes,
    search,
    sums_at,
    sums_on_grid,
    to_cells,
)

ROWS, COLUMNS = 20, 24
STILL = np.zeros(4)
UPRIGHT = np.array([30.0, 40.0, 1.0, 0.0])


def points_at(x, y, polarity=1.0, age_s=0.0):
    x, y = np.broadcast_arrays(np.asarray(x, np.float32), np.asarray(y, np.float32))
    return np.stack([x, y, np.full_like(x, age_s), np.full_like(x, polarity)], axis=1).astype(np.float32)


def cross(x, y):
    """Points on two lines that cross at (x, y)."""
    reach = np.arange(-7, 8)
    return np.concatenate([points_at(x + reach, np.full(15, y)), points_at(np.full(15, x), y + reach)])


def model_of(points, pose, direction):
    """Maps that have learnt these points."""
    maps = np.zeros((MAPS, ROWS, COLUMNS), np.float32)
    maps[WEIGHT] = 1
    drawn = np.zeros((2, ROWS, COLUMNS), np.float32)
    splat(points, len(points), pose, 1.0, STILL, drawn)
    normalise(drawn, np.zeros_like(drawn), maps[WEIGHT], 1.0)
    learn(maps, drawn, np.array(direction, float), 1.0)
    norms = np.zeros((5, 5))
    measure_norms(maps, norms)
    return maps, norms


@settings(deadline=None)
@given(st.floats(-0.49, 0.49), st.floats(0.1, 10))
def test_a_parabola_has_its_top_where_it_was_made(top, steepness):
    values = [-steepness * (x - top) ** 2 for x in (-1, 0, 1)]
    assert parabola(*values) == pytest.approx(top, abs=1e-6)


def test_what_has_no_top_is_left_in_the_middle():
    assert parabola(2.0, 1.0, 2.0) == 0


def cells_under(points, x, y, angle_rad, cell_px, motion):
    """Columns and rows of the model's cells under points, moved on by their age."""
    age = points[:, 2].astype(float)
    grown, turned = 1 + motion[3] * age, motion[2] * age
    off = [points[:, 0] + motion[0] * age - x, points[:, 1] + motion[1] * age - y]
    dx, dy = grown * off[0] - turned * off[1], grown * off[1] + turned * off[0]
    cos, sin = np.cos(angle_rad) / cell_px, np.sin(angle_rad) / cell_px
    return cos * dx + sin * dy + (COLUMNS - 1) / 2, cos * dy - sin * dx + (ROWS - 1) / 2


def summed(values, columns, rows, polarities):
    """The six sums of what points find, their gradients along x and y and the ridge and weight, shape (4, points)."""
    arm = arm_cells(ROWS, COLUMNS)
    across, down = (columns - (COLUMNS - 1) / 2) / arm, (rows - (ROWS - 1) / 2) / arm
    gx, gy = polarities * values[0], polarities * values[1]
    parts = gx, gy, gy * across - gx * down, gx * across + gy * down, values[2], values[3]
    return np.array([part.sum() for part in parts])


anything = arrays.arrays(np.float32, (MAPS, ROWS, COLUMNS), elements=st.floats(-2, 2, width=32))
of_any_motion = {
    "seed": st.integers(0, 1000),
    "angle": st.floats(-3, 3),
    "cell_px": st.floats(0.3, 4),
    "motion": st.tuples(*[st.floats(-20, 20)] * 2, *[st.floats(-1, 1)] * 2),
}


def scattered(seed, number=60):
    rng = np.random.default_rng(seed)
    polarities = rng.choice([-1.0, 1.0], number)
    return np.column_stack([rng.uniform(0, 60, (number, 2)), rng.uniform(0, 0.1, number), polarities]).astype("f4")


def not_between(border, points, angle, cell_px, motion):
    """The points that are of one cell even where numbers are rounded."""
    offs = [np.abs((at - border) - np.rint(at - border)) for at in cells_under(points, 30, 40, angle, cell_px, motion)]
    return points[np.minimum(*offs) > 1e-3]


@settings(deadline=None, max_examples=50)
@given(maps=anything, **of_any_motion)
def test_sums_at_a_place_are_of_what_lies_between_the_cells_under_the_points(maps, seed, angle, cell_px, motion):
    points = not_between(0.0, scattered(seed), angle, cell_px, motion)
    columns, rows = cells_under(points, 30, 40, angle, cell_px, motion)
    inside = (columns >= 0) & (rows >= 0) & (columns < COLUMNS - 1) & (rows < ROWS - 1)
    columns, rows, polarities = columns[inside], rows[inside], points[inside, 3]
    values = np.array([map_coordinates(layer, [rows, columns], order=1) for layer in maps[:4]])
    values[3] = maps[3, rows.astype(int), columns.astype(int)]
    found = sums_at(points, len(points), maps, 30.0, 40.0, to_cells(cell_px, cell_px, angle), np.array(motion))
    np.testing.assert_allclose(found, summed(values, columns, rows, polarities), atol=2e-2)


@settings(deadline=None, max_examples=50)
@given(maps=anything, radius=st.integers(1, 12), apart=st.integers(1, 4), any_motion=st.booleans(), **of_any_motion)
def test_sums_on_a_grid_are_those_of_the_model_moved_by_whole_cells(
    maps, radius, apart, any_motion, seed, angle, cell_px, motion
):
    points = not_between(0.5, scattered(seed), angle, cell_px, motion)
    columns, rows = (np.floor(at + 0.5) for at in cells_under(points, 30, 40, angle, cell_px, motion))
    turn = to_cells(cell_px, cell_px, angle)
    found = sums_on_grid(points, len(points), maps, 30.0, 40.0, turn, np.array(motion), radius, apart, any_motion)
    for j, down in enumerate(range(radius, -radius - 1, -1)):
        for i, right in enumerate(range(radius, -radius - 1, -1)):
            c, r = columns - right * apart, rows - down * apart
            inside = (c >= 0) & (r >= 0) & (c < COLUMNS) & (r < ROWS)
            c, r = c[inside].astype(int), r[inside].astype(int)
            expected = summed(maps[:4, r, c], c, r, points[inside, 3])
            if any_motion:
                expected[2:4] = 0
            np.testing.assert_allclose(found[:, j, i], expected, atol=1e-3)


@settings(deadline=None)
@given(dx=st.floats(-3.4, 3.4), dy=st.floats(-3.4, 3.4))
def test_a_shape_is_found_where_it_went_between_pixels(dx, dy):
    maps, norms = model_of(cross(30.0, 40.0), UPRIGHT, (1, 0, 0, 0))
    points = cross(30 + dx, 40 + dy)
    found = search(
        points, len(points), maps, norms, UPRIGHT, 1.0, STILL, np.array([4.0, 0.0, 0.0, 0.0]), UPRIGHT, 0.5, False, 4.0
    )  # fmt: skip
    np.testing.assert_allclose(found, [30 + dx, 40 + dy], atol=0.7)


@settings(deadline=None)
@given(dx=st.floats(-11.4, 11.4), dy=st.floats(-11.4, 11.4))
def test_a_shape_is_found_far_off_whichever_way_it_moves(dx, dy):
    maps, norms = model_of(cross(30.0, 40.0), UPRIGHT, (1, 0, 0, 0))
    points = cross(30 + dx, 40 + dy)
    points[:, 3] *= -1
    found = search(points, len(points), maps, norms, UPRIGHT, 1.0, STILL, STILL, UPRIGHT, 0.5, True, 12.0)
    np.testing.assert_allclose(found, [30 + dx, 40 + dy], atol=0.7)


def test_the_way_back_shows_the_other_polarity():
    points = cross(30.0, 40.0)
    maps, norms = model_of(points, UPRIGHT, (1, 0, 0, 0))
    back = points.copy()
    back[:, 3] *= -1

    def score(points, motion_x, any_motion=False):
        motion = np.array([motion_x, 0.0, 0.0, 0.0])
        return score_at(points, len(points), maps, norms, UPRIGHT, 1.0, STILL, motion, 0.5, any_motion)[0]

    assert score(points, 1.0) == pytest.approx(score(back, -1.0))
    assert score(back, 1.0) < 0.5 * score(points, 1.0)
    assert score(back, 1.0, any_motion=True) == pytest.approx(score(points, 1.0), rel=0.1)


def turned(points, angle_rad):
    """Points turned round UPRIGHT's place."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    moved = points.copy()
    moved[:, :2] = (points[:, :2] - UPRIGHT[:2]) @ [[cos, sin], [-sin, cos]] + UPRIGHT[:2]
    return moved


@settings(deadline=None)
@given(angle=st.floats(-3, 3), across=st.floats(-1, 1), down=st.floats(-1, 1), turning=st.floats(-1, 1))
def test_what_has_turned_looks_as_before_to_a_model_that_has_turned(angle, across, down, turning):
    points = cross(30.0, 40.0)
    maps, norms = model_of(points, UPRIGHT, (0.8, 0.6, 0, 0))
    cos, sin = np.cos(angle), np.sin(angle)
    upright = np.array([across, down, turning, 0.5])
    with_it = np.array([cos * across - sin * down, sin * across + cos * down, turning, 0.5])
    pose = np.array([30.0, 40.0, 1.0, angle])
    before = score_at(points, len(points), maps, norms, UPRIGHT, 1.0, STILL, upright, 0.5, False)
    after = score_at(turned(points, angle), len(points), maps, norms, pose, 1.0, STILL, with_it, 0.5, False)
    assert after[0] == pytest.approx(before[0], abs=1e-3)
    assert after[1] == pytest.approx(before[1], rel=1e-3)
    np.testing.assert_allclose(after[2:], np.array([[cos, -sin], [sin, cos]]) @ before[2:], atol=2e-2)


def test_turning_and_growing_predict_the_polarity_of_each_place():
    maps = np.zeros((MAPS, ROWS, COLUMNS), np.float32)
    maps[WEIGHT] = 1
    # A slope that rises to the right: turning moves its upper and lower halves opposite ways along it.
    maps[0] = 1
    norms = np.zeros((5, 5))
    measure_norms(maps, norms)
    above, below = points_at([30.0, 31.0], [34.0, 33.0]), points_at([30.0, 31.0], [46.0, 47.0], polarity=-1.0)
    points = np.concatenate([above, below])

    def score(motion):
        return score_at(points, len(points), maps, norms, UPRIGHT, 1.0, STILL, np.array(motion), 0.0, False)[0]

    assert score((0.0, 0.0, 1.0, 0.0)) == pytest.approx(-score((0.0, 0.0, -1.0, 0.0)))
    assert score((0.0, 0.0, 1.0, 0.0)) > 3 * abs(score((1.0, 0.0, 0.0, 0.0)))
    assert score((0.0, 0.0, 1.0, 0.0)) > 3 * abs(score((0.0, 0.0, 0.0, 1.0)))


@settings(deadline=None)
@given(arrays.arrays(np.float32, (MAPS, 5, 6), elements=st.floats(-2, 2, width=32)))
def test_norms_are_the_products_of_the_gradients_along_the_parts_of_a_motion(maps):
    norms = np.zeros((5, 5))
    measure_norms(maps, norms)
    down, across = np.mgrid[0:5, 0:6]
    across, down = (across - 2.5) / arm_cells(5, 6), (down - 2.0) / arm_cells(5, 6)
    x, y = maps[0].astype(float), maps[1].astype(float)
    parts = np.stack([x, y, y * across - x * down, x * across + y * down]).reshape(4, -1)
    np.testing.assert_allclose(norms[:4, :4], np.triu(parts @ parts.T), atol=1e-4)
    assert norms[4, 4] == pytest.approx(float((maps[2].astype(float) ** 2).sum()), abs=1e-4)


@settings(deadline=None)
@given(st.floats(0.1, 0.49), st.floats(0.1, 10))
def test_a_parabola_that_hardly_bends_stays_near_the_middle(top, steepness):
    values = [-steepness * (x - top) ** 2 for x in (-1, 0, 1)]
    assert 0 < parabola(*values, 2 * steepness) < 0.51 * parabola(*values)


@pytest.mark.parametrize(
    ("shape", "pose", "area"), [((1.02, 1.02, 0), (30, 40, 1.02, 0.1), 1.02**2), ((1, 1, -0.02), (30, 40, 1, 0.08), 1)]
)
def test_the_score_of_another_size_or_angle_is_that_of_such_a_pose_over_the_root_of_its_area(shape, pose, area):
    points, motion, scores = cross(30, 40), np.array([1.0, 0.0, 0.0, 0.0]), np.empty(1)
    maps, norms = model_of(points, UPRIGHT, (1, 0, 0, 0))
    upright = np.array([30.0, 40.0, 1.0, 0.1])
    scores_of_shapes(
        points, len(points), maps, norms, upright, np.array([shape], float), 1.0, STILL, motion, 0.5, scores
    )
    expected, *_ = score_at(points, len(points), maps, norms, np.array(pose, float), 1.0, STILL, motion, 0.5, False)
    assert scores[0] * np.sqrt(area) == pytest.approx(expected, rel=1e-9)


def outline(wide, high):
    """Points on the edges of a box round UPRIGHT's place."""
    along, ends = np.linspace(-7, 7, 29), np.array([[-7.0], [7.0]])
    sides = np.concatenate(
        [np.stack(np.broadcast_arrays(*edge), -1).reshape(-1, 2) for edge in ((ends, along), (along, ends))]
    )
    return points_at(*(sides * (wide, high) + UPRIGHT[:2]).T)


@pytest.mark.parametrize(("wide", "high"), [(1.3, 1.0), (1.0, 0.8)])
def test_what_was_stretched_one_way_scores_best_for_a_model_stretched_alike(wide, high):
    maps, norms = model_of(outline(1, 1), UPRIGHT, (0.7, 0.7, 0, 0))
    points, motion = outline(wide, high), np.array([0.7, 0.7, 0.0, 0.0])
    shapes = np.array([(wide, high, 0), (1, 1, 0), (high, wide, 0), (wide, high, 0.1)])
    scores = np.empty(len(shapes))
    scores_of_shapes(points, len(points), maps, norms, UPRIGHT, shapes, 1.0, STILL, motion, 0.5, scores)
    assert np.argmax(scores) == 0
