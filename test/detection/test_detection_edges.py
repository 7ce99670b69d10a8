"""Edge map and orientation for EdgeBoxes."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.detection import edge_orientation, edges_of, thin_edges
from etd_ros.detection.edges import NEIGHBOUR_DISTANCE, TIE_MARGIN


def bilinear(image, x, y):
    """Interpolated value at a point inside the image."""
    height, width = image.shape
    left, top = min(int(x), width - 2), min(int(y), height - 2)
    part_x, part_y = x - left, y - top
    rows = image[top : top + 2, left : left + 2] @ np.array([1 - part_x, part_x])
    return rows @ np.array([1 - part_y, part_y])


def thin_edges_in_python(edges, orientation):
    """What `thin_edges` does, one definition a line."""
    height, width = edges.shape
    thin = np.zeros_like(edges)
    for y, x in zip(*np.nonzero(edges > 0), strict=True):
        across = np.array([math.cos(orientation[y, x]), math.sin(orientation[y, x])])
        neighbours = [
            np.clip((x, y) + distance * across, 0, (width - 1, height - 1))
            for distance in range(-NEIGHBOUR_DISTANCE, NEIGHBOUR_DISTANCE + 1)
            if distance
        ]
        if max(bilinear(edges.astype(np.float64), *point) for point in neighbours) <= edges[y, x] * TIE_MARGIN:
            thin[y, x] = edges[y, x]
    return thin


@settings(deadline=None, max_examples=40)
@given(st.integers(2, 14), st.integers(2, 14), st.integers(0, 2**32 - 1))
def test_thinning_equals_its_definition(height, width, seed):
    random = np.random.default_rng(seed)
    edges = random.random((height, width), np.float32) * (random.random((height, width)) < 0.7)
    edges = edges.astype(np.float32)
    orientation = random.uniform(0, math.pi, (height, width)).astype(np.float32)
    np.testing.assert_array_equal(thin_edges(edges, orientation), thin_edges_in_python(edges, orientation))


@pytest.mark.parametrize("angle_deg", [0, 30, 60, 90, 120, 150])
def test_orientation_points_across_a_straight_edge_within_12_degrees(angle_deg):
    angle = math.radians(angle_deg)
    middle, along = np.array([32, 32]), np.array([-math.sin(angle), math.cos(angle)])
    image = np.zeros((65, 65), np.uint8)
    ends = [tuple(np.round(middle + side * 60 * along).astype(int).tolist()) for side in (-1, 1)]
    cv2.line(image, *ends, 255, 1)
    found = edge_orientation(image.astype(np.float32) / 255)[32, 32]
    away = abs(found - angle) % math.pi
    assert min(away, math.pi - away) < math.radians(12)


@settings(deadline=None, max_examples=40)
@given(st.integers(8, 40), st.integers(8, 40), st.integers(1, 255), st.booleans(), st.integers(0, 2**32 - 1))
def test_the_map_is_normalised_and_the_angle_lies_in_half_a_turn(height, width, strongest, thin, seed):
    random = np.random.default_rng(seed)
    events = random.integers(0, strongest + 1, (height, width)).astype(np.uint8)
    events[height // 2, width // 2] = strongest
    edges, orientation = edges_of(events, thin=thin)
    assert edges.dtype == orientation.dtype == np.float32
    assert edges.max() == 1.0
    assert edges.min() >= 0
    assert orientation.min() >= 0
    assert orientation.max() < np.float32(math.pi)


def test_a_faint_frame_gives_the_map_of_a_bright_one():
    bright = np.zeros((30, 30), np.uint8)
    cv2.rectangle(bright, (8, 8), (20, 20), 255)
    np.testing.assert_allclose(edges_of(bright // 255 * 10, thin=True)[0], edges_of(bright, thin=True)[0], atol=1e-6)


def test_a_thick_line_is_thinned_to_its_ridge():
    image = np.zeros((40, 40), np.uint8)
    image[:, 18:23] = (80, 160, 255, 160, 80)
    thin, _ = edges_of(image, thin=True)
    assert set(np.nonzero(thin[10:30])[1]) == {20}
