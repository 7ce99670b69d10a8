"""A camera that slides: all that it sees moves in one direction, which two pictures of the edges show."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.ndimage import map_coordinates

from etd_ros.tracking.camera_slide import DIRECTIONS, PADDED, CameraSlide, _whitened, between, peak_of
from etd_ros.tracking.camera_slide_kernels import light_cells, likeness_along

FRAME_S = 0.002
POINTS = 400
SPEED_PX_S = 80.0
NEARNESS = 1.0, 1.7, 3.0
OFF_MAX_RAD = math.radians(1)


def scattered(width, height, seed=0):
    """Edges, here as points: places (pixels from the sensor's middle, shape (n, 2)) on and round the sensor, and how
    near each is."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, (POINTS, 2)) * (width, height), rng.choice(NEARNESS, POINTS)


def frame_of(places, width, height):
    """A frame in which the pixels at these places have fired."""
    columns, rows = np.floor(places + np.array([width, height]) / 2).astype(int).T
    seen = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    data = np.zeros((height, width, 2), np.uint8)
    data[rows[seen], columns[seen], 0] = 200
    return data


def watch(slide, moved, *, width=240, height=180, from_s=0.0, for_s=1.2):
    """Frames of points that `moved` brings from their places by a time (s)."""
    for step in range(round(from_s / FRAME_S), round((from_s + for_s) / FRAME_S)):
        places = moved(*scattered(width, height), step * FRAME_S)
        start_ns, stamp_ns = (round(end * FRAME_S * 1e9) for end in (step, step + 1))
        slide.take(stamp_ns, start_ns, frame_of(places, width, height))
    return slide


def sliding(angle_rad, speed_px_s=SPEED_PX_S):
    way = speed_px_s * np.array([math.cos(angle_rad), math.sin(angle_rad)])
    return lambda places, nearness, time_s: places + nearness[:, None] * way * time_s


def zooming(places, nearness, time_s):
    del nearness
    return places * math.exp(0.8 * time_s)


def rolling(places, nearness, time_s):
    del nearness
    cos, sin = math.cos(1.2 * time_s), math.sin(1.2 * time_s)
    return places @ np.array([[cos, sin], [-sin, cos]])


def swarming(places, nearness, time_s):
    """Each thing goes its own way."""
    angles = np.arange(len(places)) // 10 * 2.4
    way = SPEED_PX_S * nearness[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return places + way * time_s


def passing(places, nearness, time_s):
    """Half of the things go one way, half of them the other way."""
    way = SPEED_PX_S * nearness * np.where(np.arange(len(places)) % 2, 1, -1)
    return places + way[:, None] * np.array([0.8, 0.6]) * time_s


def swinging(places, nearness, time_s):
    """A hand: the direction of a pan goes round once a second."""
    del nearness
    angle = 2 * math.pi * time_s
    return places + SPEED_PX_S / (2 * math.pi) * np.array([math.sin(angle), -math.cos(angle)])


def off_rad(slide, angle_rad):
    x, y = slide.slide.direction
    return abs(between(math.atan2(y, x), angle_rad))


@pytest.mark.parametrize("angle_deg", [0, 33, 90, 117, 200, 301])
def test_what_a_camera_slides_past_goes_one_way_however_near_it_is(angle_deg):
    angle_rad = math.radians(angle_deg)
    assert off_rad(watch(CameraSlide(240, 180), sliding(angle_rad)), angle_rad) < OFF_MAX_RAD


@pytest.mark.parametrize("size", [(346, 260), (640, 480), (1280, 720), (180, 240)])
def test_the_direction_is_known_on_sensors_of_any_size(size):
    width, height = size
    moved = sliding(0.5, SPEED_PX_S * max(size) / 240)
    assert off_rad(watch(CameraSlide(width, height), moved, width=width, height=height), 0.5) < OFF_MAX_RAD


def test_the_direction_of_a_slow_slide_is_known_later():
    slide = watch(CameraSlide(240, 180), sliding(0.5, 15.0), for_s=0.3)
    assert slide.slide is None
    assert off_rad(watch(slide, sliding(0.5, 15.0), from_s=0.3, for_s=3.0), 0.5) < 2 * OFF_MAX_RAD


@pytest.mark.parametrize("moved", [zooming, rolling, swarming, passing, swinging])
def test_there_is_no_direction_of_what_goes_in_many(moved):
    slide = CameraSlide(240, 180)
    for from_s in np.arange(0.0, 1.2, 0.1):
        assert watch(slide, moved, from_s=from_s, for_s=0.1).slide is None


def test_nothing_moves_in_a_direction_before_a_camera_that_stands():
    assert watch(CameraSlide(240, 180), lambda places, nearness, time_s: places).slide is None


def test_frames_without_events_say_nothing():
    assert watch(CameraSlide(240, 180), lambda places, nearness, time_s: places + 1e6).slide is None


@pytest.mark.parametrize("size", [(2000, 3), (3, 2000), (1, 1)])
def test_a_sensor_that_is_lower_than_a_cell_shows_no_direction(size):
    width, height = size
    assert watch(CameraSlide(width, height), sliding(0.5), width=width, height=height, for_s=0.6).slide is None


def test_what_was_known_is_forgotten_with_the_stream():
    slide = watch(CameraSlide(240, 180), sliding(0.5))
    slide.forget()
    assert slide.slide is None
    assert off_rad(watch(slide, sliding(1.5)), 1.5) < OFF_MAX_RAD


def test_a_new_direction_takes_the_place_of_the_one_before():
    slide = watch(CameraSlide(240, 180), sliding(0.5))
    assert off_rad(watch(slide, sliding(1.5), from_s=1.2), 1.5) < OFF_MAX_RAD


def test_the_direction_is_known_to_have_been_since_the_first_pictures():
    slide = watch(CameraSlide(240, 180), sliding(0.5), from_s=1.0)
    assert slide.slide.since_ns == pytest.approx(1.05e9, abs=0.03e9)


def test_what_turns_has_another_direction_since():
    slide = watch(CameraSlide(240, 180), sliding(0.5))
    assert 0.6e9 < watch(slide, sliding(1.5), from_s=1.2).slide.since_ns < 1.8e9


@given(st.floats(0, 2 * math.pi))
def test_the_angle_of_a_peak_is_known_to_a_part_of_a_direction(angle_rad):
    angles = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    apart = np.abs((angles - angle_rad + np.pi) % (2 * np.pi) - np.pi)
    found, clearness = peak_of(np.maximum(0.0, 1 - apart / 0.08) + 0.1)
    assert abs(between(found, angle_rad)) < math.radians(0.3)
    assert clearness == pytest.approx(11.0, rel=0.2)


def test_angles_are_compared_the_shorter_way_round():
    assert between(0.1, 2 * math.pi - 0.1) == pytest.approx(0.2)
    assert between(2 * math.pi - 0.1, 0.1) == pytest.approx(-0.2)


@given(arrays(np.uint8, (13, 17, 2), elements=st.sampled_from([0, 0, 0, 0, 9])), st.integers(1, 4), st.integers(1, 3))
def test_a_cell_is_lit_if_one_of_its_pixels_that_are_looked_at_has_fired(data, cell_px, stride):
    rows, columns = 13 // cell_px, 17 // cell_px
    lit = np.zeros((rows, columns), np.float32)
    looked_at = np.zeros((13, 17, 1), bool)
    looked_at[::stride, ::stride] = True
    fired = (looked_at * data)[: rows * cell_px, : columns * cell_px].any(axis=2)
    expected = fired.reshape(rows, cell_px, columns, cell_px).any(axis=(1, 3))
    assert light_cells(data, cell_px, stride, lit) == expected.sum()
    np.testing.assert_array_equal(lit, expected)


@given(st.integers(0, 1000), st.floats(0, 1.5))
def test_likeness_is_the_sum_over_all_ways_in_a_direction(seed, least):
    rng = np.random.default_rng(seed)
    alike = rng.normal(size=(24, 32)).astype(np.float32)
    angles = rng.uniform(0, 2 * np.pi, 7)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ways = np.arange(2.0, 9.0 + 1e-9, 0.5)
    likeness = np.zeros(7)
    best_way = likeness_along(alike, directions, 2.0, 9.0, 0.5, least, likeness)
    places = directions[:, ::-1, None] * ways
    over = np.maximum(map_coordinates(alike, places.transpose(1, 0, 2), order=1, mode="grid-wrap") - least, 0.0)
    np.testing.assert_allclose(likeness, (over**2).sum(axis=1), rtol=1e-4, atol=1e-5)
    best = over[likeness.argmax()]
    assert best.max() == pytest.approx(best[np.argmin(abs(ways - best_way))], abs=1e-5)


def test_pictures_give_the_same_numbers_wherever_they_lie_in_memory():
    values = np.random.default_rng(0).normal(size=(*PADDED, 2)).astype(np.float32)
    found = []
    for offset in (0, 16, 32, 48):
        room = np.empty(values.nbytes + 128, np.uint8)
        start = -room.ctypes.data % 64 + offset
        placed = room[start : start + values.nbytes].view(np.float32).reshape(values.shape)
        placed[:] = values
        found.append(_whitened(placed))
    for other in found[1:]:
        np.testing.assert_array_equal(other, found[0])
