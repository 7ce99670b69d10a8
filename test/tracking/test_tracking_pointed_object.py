"""Objects round a point by their contours: closed paths, candidates, and the choice among them."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from etd_ros.boxes import Box, iou, ious
from etd_ros.tracking.click_candidates import FEATURES, candidates
from etd_ros.tracking.contour_paths import best_paths, contour_paths
from etd_ros.tracking.discovery import Discovery
from etd_ros.tracking.pointed_object import LOOKS, WEIGHTS, PointedObject

NO_BOXES = np.empty((0, 4))
BOX_LISTS = arrays(np.float64, (3, 4), elements=st.floats(1, 50))


def total(strengths, path, bend_cost):
    bends = np.count_nonzero(np.diff([*path, path[0]]))
    return strengths[list(path), np.arange(len(path))].sum() - bend_cost * bends


def closed(radii, angles):
    """All paths that take one step at most from ray to ray, and back to the first."""
    for path in product(range(radii), repeat=angles):
        if np.abs(np.diff([*path, path[0]])).max() <= 1:
            yield path


@settings(deadline=None, max_examples=40)
@given(arrays(np.float32, (4, 5), elements=st.floats(0, 1, width=16)), st.sampled_from([0.0, 0.05, 0.5]))
def test_each_path_is_the_strongest_of_all_closed_ones_through_its_radius(strengths, bend_cost):
    for start, path in enumerate(best_paths(strengths, bend_cost)):
        of_start = [total(strengths, other, bend_cost) for other in closed(4, 5) if other[0] == start]
        assert path[0] == start
        assert np.abs(np.diff([*path, path[0]])).max() <= 1
        assert total(strengths, path, bend_cost) == pytest.approx(max(of_start), abs=1e-4)


def picture_of(inside, side=120):
    """A picture with events along the rim of a shape, given by its implicit function of x and y."""
    y, x = np.mgrid[:side, :side] + 0.5
    return ((inside(x, y) <= 1) & (inside(x, y) > 0.85)).astype(np.float32)


@pytest.mark.parametrize("off", [(0, 0), (8, -6)])
@pytest.mark.parametrize(("w", "h"), [(24, 24), (70, 40), (30, 60)])
def test_the_contour_of_an_ellipse_is_the_best_supported_one(w, h, off):
    x0, y0 = 60 + off[0], 60 + off[1]
    found = contour_paths(picture_of(lambda x, y: ((x - x0) / (w / 2)) ** 2 + ((y - y0) / (h / 2)) ** 2))
    truth = np.array([[x0 - w / 2, y0 - h / 2, w, h]])
    assert ious(found.boxes, truth)[found.support.argmax(), 0] > 0.75


def test_an_empty_picture_has_contours_without_support_only():
    assert contour_paths(np.zeros((40, 40), np.float32)).support.max() == 0


@settings(deadline=None, max_examples=30)
@given(BOX_LISTS, BOX_LISTS)
def test_overlaps_of_many_boxes_are_those_of_each_pair(boxes, others):
    assert ious(boxes, others) == pytest.approx(np.stack([iou(boxes, Box(*other)) for other in others], axis=1))


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 1000), st.sampled_from([16, 50, 120]), st.floats(0, 0.5))
def test_candidates_lie_on_the_sensor_and_have_finite_features(seed, side, share):
    rng = np.random.default_rng(seed)
    picture = (rng.random((side, side)) < share).astype(np.float32) * 2
    own = picture * (rng.random((side, side)) < 0.5)
    room = np.array([-5.0, 4.0, side - 3.0, side + 9.0])
    found = candidates(picture, own, room, (np.array([[2.0, 2.0, 9.0, 9.0]]), NO_BOXES))
    assert found.features.shape == (len(found.boxes), len(FEATURES))
    assert np.isfinite(found.features).all()
    assert (found.boxes[:, :2] >= room[:2]).all()
    assert (found.boxes[:, :2] + found.boxes[:, 2:] <= room[2:] + 1e-9).all()


def test_the_box_of_what_moves_alike_is_a_candidate_where_something_else_runs_through_it():
    own = picture_of(lambda x, y: ((x - 60) / 20) ** 2 + ((y - 60) / 15) ** 2)
    everything = own.copy()
    everything[30:90, 55:65] += 1
    room = np.array([0.0, 0.0, 120.0, 120.0])
    found = candidates(everything, own.astype(np.float32), room, (NO_BOXES, NO_BOXES))
    best = ious(found.boxes, np.array([[40.0, 45.0, 40.0, 30.0]]))[:, 0].argmax()
    values = dict(zip(FEATURES, found.features[best], strict=True))
    assert values["own_contour_near"] > values["contour_near"]
    assert values["own_side_weakest"] > values["side_weakest"]


def test_there_is_a_weight_for_each_feature():
    assert tuple(WEIGHTS) == FEATURES


def looks_at(point, velocity, steps=30):
    """What two looks say about a point where a disc, on a texture of dots, moves with the picture."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:160, :400]
    from_disc = np.hypot(x - 230, y - 80)
    scene = (rng.random((160, 400)) < 0.01) & (from_disc > 24)
    scene |= np.abs(from_disc - 18) < 1
    discovery, pointed = Discovery(200, 160), None
    for step in range(steps):
        left = 100 - round(velocity * step * 0.01)
        frame = np.repeat(scene[:, left : left + 200, None], 2, axis=2).astype(np.uint8) * 255
        discovery.take((step + 1) * 10_000_000, frame)
        if step >= steps - 5 and discovery.is_due():
            discovery.look(thorough=True)
            pointed = pointed or PointedObject(*point, discovery.stamp_ns)
            pointed.look(discovery)
    assert pointed.looks == LOOKS
    return pointed.best()


@pytest.mark.parametrize("off", [(0.0, 0.0), (6.0, -5.0)])
def test_what_moves_with_the_picture_is_told_by_its_contour(off):
    box, expected_iou = looks_at((130 + 25 + off[0], 80 + off[1]), 100.0)
    x, y = box.center
    assert abs(x - (130 + 29)) < 6
    assert abs(y - 80) < 6
    assert 30 < box.w < 48
    assert 30 < box.h < 48
    assert expected_iou > 0.5


def test_a_sensor_without_events_has_no_answer_and_the_smallest_one_has_room():
    for side in (1, 200):
        pointed, discovery = PointedObject(0.5, 0.5, 0), Discovery(side, side)
        discovery.take(10_000_000, np.full((side, side, 2), 255 if side == 1 else 0, np.uint8))
        discovery.look(thorough=True)
        pointed.look(discovery)
        assert pointed.looks == 0
