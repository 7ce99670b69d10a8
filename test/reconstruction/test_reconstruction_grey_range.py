"""The bounds of the grey range against sorting."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.reconstruction.grey_range import GreyRange

AT_ONCE = {"range_min": 1e-30, "range_time_s": 0.0}


@settings(deadline=None, max_examples=100)
@given(
    seed=st.integers(0, 10**6),
    size=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    distinct=st.sampled_from([1, 2, 5, 10**6]),
    spread=st.sampled_from([1e-7, 0.01, 1.0, 15.0]),
    dropped_percent=st.sampled_from([0.0, 0.25, 3.0, 25.0]),
)
def test_bounds_are_the_order_statistics_exactly(seed, size, distinct, spread, dropped_percent):
    rng = np.random.default_rng(seed)
    values = np.exp(spread * rng.standard_normal(distinct)).astype(np.float32)
    image = rng.choice(values, size)
    dropped = int(image.size * dropped_percent / 100)
    ordered = np.sort(image, axis=None)
    bounds = GreyRange(size[1], size[0], dropped_percent=dropped_percent, **AT_ONCE).follow(image, 0)
    np.testing.assert_array_equal(np.float32(bounds), (ordered[dropped], ordered[-1 - dropped]))


def test_zero_and_the_largest_numbers_have_their_places():
    image = np.array([[0.0, 1e-45, 1.0, 3e38]], np.float32)
    assert GreyRange(4, 1, dropped_percent=0.0, **AT_ONCE).follow(image, 0) == (0.0, float(np.float32(3e38)))
    assert GreyRange(4, 1, dropped_percent=25.0, **AT_ONCE).follow(image, 0) == (float(image[0, 1]), 1.0)


@pytest.mark.parametrize(("width", "height", "step"), [(346, 260, 2), (1280, 720, 4), (65536, 1, 1), (65537, 1, 2)])
def test_large_images_are_sampled_on_a_grid(width, height, step):
    image = np.random.default_rng(0).random((height, width), np.float32)
    ordered = np.sort(image[::step, ::step], axis=None)
    dropped = int(ordered.size * 0.01)
    bounds = GreyRange(width, height, dropped_percent=1.0, **AT_ONCE).follow(image, 0)
    np.testing.assert_array_equal(np.float32(bounds), (ordered[dropped], ordered[-1 - dropped]))


def test_a_faint_image_gets_the_smallest_range_about_its_middle():
    grey_range = GreyRange(2, 1, dropped_percent=0.0, range_min=0.5, range_time_s=0.0)
    assert grey_range.follow(np.array([[1.0, 1.25]], np.float32), 0) == (0.875, 1.375)


def test_bounds_approach_the_scene_with_the_time_constant_and_start_anew_after_a_reset():
    grey_range = GreyRange(2, 1, dropped_percent=0.0, range_min=0.1, range_time_s=2.0)
    dark, bright = np.array([[0.0, 1.0]], np.float32), np.array([[10.0, 21.0]], np.float32)
    assert grey_range.follow(dark, 0) == (0.0, 1.0)
    done = 1 - math.exp(-1)
    np.testing.assert_allclose(grey_range.follow(bright, 2_000_000_000), (10 * done, 1 + 20 * done))
    grey_range.reset()
    assert grey_range.follow(bright, 3_000_000_000) == (10.0, 21.0)
