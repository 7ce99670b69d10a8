"""The compiled parts of discovery against plain NumPy."""

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.tracking.discovery_kernels import (
    count_recent,
    deal_to_tiles,
    draw,
    enter,
    label_cells,
    read_evidence,
    refined_velocity,
    score_tiles,
    sharpness,
    supported_points,
)

seeds = st.integers(0, 2**32 - 1)
few = settings(deadline=None, max_examples=25)


def some_points(seed: int, count: int = 200, side: float = 40.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(0, side, (count, 2)), rng.uniform(0, 0.05, count)]).astype(np.float32)


@few
@given(seeds)
def test_a_frame_gives_each_pixel_the_time_of_its_newest_event(seed):
    rng = np.random.default_rng(seed)
    data = (rng.integers(0, 256, (7, 9, 2)) * (rng.random((7, 9, 2)) < 0.4)).astype(np.uint8)
    times = np.full((7, 9), -1, np.int64)
    of_each = np.full((7, 9, 2), -1, np.int64)
    enter(times.ravel(), of_each.reshape(-1, 2), data.view(np.uint16).ravel(), 1000, 2550)
    levels = data.max(axis=2).astype(np.int64)
    assert np.array_equal(times, np.where(levels > 0, 1000 + 10 * levels, -1))
    assert np.array_equal(of_each, np.where(data > 0, 1000 + 10 * data.astype(np.int64), -1))
    assert count_recent(times, 2000) == (times > 2000).sum()


@few
@given(seeds)
def test_points_are_recent_pixels_with_a_neighbour_of_about_their_time(seed):
    times = np.random.default_rng(seed).integers(0, 200, (13, 11)).astype(np.int64)
    counts = np.zeros((4, 3), np.int32)
    room = np.zeros((200, 3), np.float32)
    n = supported_points(times, 200, 120, 2, 1, 4, room, counts)
    expected = set()
    for row, column in np.ndindex(times.shape):
        window = times[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2]
        near = (abs(window - times[row, column]) <= 2).sum() > 1
        if times[row, column] > 120 and near:
            expected.add((column + 0.5, row + 0.5, round((200 - times[row, column]) * 1e-9, 12)))
    assert {(x, y, round(float(age), 12)) for x, y, age in room[:n].tolist()} == expected
    assert counts.sum() == n


def test_points_beyond_the_room_are_left_out_and_every_other_one_is_taken():
    times = np.full((10, 10), 5, np.int64)
    counts = np.zeros((3, 3), np.int32)
    room = np.zeros((30, 3), np.float32)
    assert supported_points(times, 5, 0, 1, 1, 4, room, counts) == 30
    assert supported_points(times, 5, 0, 1, 5, 4, room, counts) == 20
    assert counts.sum() == 100


@few
@given(seeds, st.integers(1, 3))
def test_clusters_are_the_connected_components_of_busy_cells(seed, least):
    counts = np.random.default_rng(seed).integers(0, 4, (8, 9)).astype(np.int32)
    labels = np.zeros_like(counts)
    number = label_cells(counts, least, labels, np.zeros((counts.size, 2), np.int32))
    total, expected = cv2.connectedComponents((counts >= least).astype(np.uint8), connectivity=8)
    assert number == total - 1
    pairs = set(zip(labels.ravel().tolist(), expected.ravel().tolist(), strict=True))
    assert len(pairs) == len(np.unique(expected))
    assert labels.max() == number


@few
@given(seeds)
def test_a_tile_is_scored_by_the_pairs_of_its_points_that_fall_together(seed):
    points = some_points(seed, 90, 24.0)
    kept, seen = np.zeros((1, 128, 3), np.float32), np.zeros(1, np.int32)
    deal_to_tiles(points, len(points), 24, 1, kept, seen)
    assert seen[0] == 90
    assert np.array_equal(kept[0, :90], points)
    scores = np.zeros((1, 5, 5), np.float32)
    score_tiles(kept, seen, 20, 24, 1.5, 0.05, scores)
    for j, i in ((2, 2), (0, 3), (4, 1)):
        moves = points[:, 2:] / np.float32(0.05) * 1.5 * np.array([i - 2, j - 2])
        pixels = [tuple(pixel) for pixel in np.floor(points[:, :2] + moves + 5).astype(int).tolist()]
        pairs = sum(pixels.count(pixel) ** 2 - pixels.count(pixel) for pixel in set(pixels))
        assert abs(scores[0, j, i] - pairs / 90**2) <= 8 / 90**2


def test_a_tile_with_few_points_has_no_scores_and_one_with_many_keeps_some_of_all_its_rows():
    points = some_points(3, 1000, 24.0)
    points = points[np.argsort(points[:, 1])]
    kept, seen = np.zeros((1, 50, 3), np.float32), np.zeros(1, np.int32)
    deal_to_tiles(points, len(points), 24, 1, kept, seen)
    assert seen[0] == 1000
    assert kept[0, :, 1].min() < 8
    assert kept[0, :, 1].max() > 16
    scores = np.ones((1, 5, 5), np.float32)
    score_tiles(kept, seen, 1001, 24, 1.0, 0.05, scores)
    assert not scores.any()


@few
@given(seeds, st.floats(-200, 200), st.floats(-200, 200))
def test_sharpness_is_the_sum_of_the_squares_of_the_picture(seed, velocity_x, velocity_y):
    points = some_points(seed)
    picture, room = np.ones((40, 40), np.float32), np.zeros((40, 40), np.float32)
    draw(points, velocity_x, velocity_y, picture)
    assert np.isclose(sharpness(points, velocity_x, velocity_y, room), (picture.astype(float) ** 2).sum(), rtol=1e-3)
    assert not room.any()


def test_a_velocity_is_refined_towards_the_sharpest_picture():
    ages = np.tile(np.linspace(0, 0.05, 25), 4)
    columns = np.repeat([10.5, 14.5, 20.5, 26.5], 25)
    points = np.column_stack([columns - 100 * ages, np.full(100, 15.5), ages]).astype(np.float32)
    x, y = refined_velocity(points, 80.0, 8.0, 40.0, np.zeros((40, 40), np.float32))
    assert abs(x - 100) <= 10
    assert abs(y) <= 10


def test_evidence_is_positive_for_points_of_their_own_motion_and_negative_for_the_others():
    ages = np.linspace(0, 0.05, 30)
    own = np.column_stack([10.5 - 100 * ages, np.full(30, 10.5), ages])
    other = np.column_stack([25.5 + 100 * ages, np.full(30, 25.5), ages])
    points = np.concatenate([own, other]).astype(np.float32)
    pictures = [np.zeros((40, 40), np.float32) for _ in range(2)]
    for velocity, picture in zip((100.0, -100.0), pictures, strict=True):
        draw(points, velocity, 0.0, picture)
    evidence, places = np.zeros((40, 40), np.float32), np.zeros((60, 3), np.float32)
    read_evidence(points, 100.0, 0.0, pictures[0], -100.0, 0.0, pictures[1], 0.3, evidence, places)
    assert places[:30, 2].min() > 0
    assert places[30:, 2].max() < 0
    assert np.isclose(evidence.sum(), places[:, 2].sum(), rtol=1e-4)


def test_a_point_that_is_rounded_to_the_border_of_the_picture_is_outside():
    points = np.array([[39.5, 20.5, 0.05]], np.float32)
    velocity = (0.5 - 1e-9) / float(points[0, 2])
    pictures = [np.zeros((40, 40), np.float32) for _ in range(3)]
    places = np.zeros((1, 3), np.float32)
    read_evidence(points, velocity, 0.0, pictures[0], 0.0, 0.0, pictures[1], 0.3, pictures[2], places)
    assert places.tolist() == [[-1, -1, 0]]
