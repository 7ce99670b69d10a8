"""Crops show what they claim to show, wherever they lie."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recovery_scenes import HEIGHT, WIDTH, texture

from etd_ros.boxes import Box
from etd_ros.recovery.crops import cut, exemplar_extent


def ramp(width: int, height: int) -> np.ndarray:
    """Columns as grey levels."""
    return np.tile(np.arange(width, dtype=np.uint8), (height, 1))


def test_a_crop_at_scale_1_is_the_images_own_pixels():
    image = np.random.default_rng(0).integers(0, 256, (60, 80)).astype(np.uint8)
    crop = cut(image, (40, 30), 1.0, (20, 10))
    np.testing.assert_array_equal(crop.pixels, image[25:35, 30:50])


@pytest.mark.parametrize("scale", [0.4, 0.7, 1.5, 3.0])
def test_a_place_of_the_crop_is_where_it_is_on_the_image(scale):
    image = ramp(200, 100)
    crop = cut(image, (90.3, 51.7), scale, (40, 24))
    # The middle of column 8 lies at 8.5; pixels' own middles lie half a pixel in.
    column = crop.left + 8.5 / scale - 0.5
    assert float(crop.pixels[12, 8]) == pytest.approx(column, abs=1.0)


def test_beyond_the_border_is_the_images_mean():
    image = np.full((40, 40), 77, np.uint8)
    image[:, 20:] = 177
    crop = cut(image, (-100.0, -100.0), 0.5, (16, 16))
    assert (crop.pixels == 127).all()


@settings(deadline=None, max_examples=60)
@given(x=st.floats(-50, 150), y=st.floats(-50, 150), w=st.floats(1, 90), h=st.floats(1, 90), scale=st.floats(0.2, 4.0))
def test_boxes_come_back_from_the_crop(x, y, w, h, scale):
    box = Box(x, y, w, h)
    crop = cut(np.zeros((64, 64), np.uint8), (30.0, 20.0), scale, (48, 32))
    np.testing.assert_allclose(crop.on_image(*crop.of_box(box)), box, atol=1e-6)


def test_an_exemplar_of_a_square_is_twice_as_wide():
    assert exemplar_extent(30, 30) == pytest.approx(60)


@pytest.mark.parametrize("scale", [0.4, 1.0, 2.5])
def test_each_channel_of_a_colour_picture_is_cut_as_a_grey_one(scale):
    channels = [texture(seed, WIDTH, HEIGHT) for seed in (1, 2, 3)]
    colour = cut(np.dstack(channels), (10.3, 100.7), scale, (64, 48)).pixels
    for index, channel in enumerate(channels):
        np.testing.assert_array_equal(colour[..., index], cut(channel, (10.3, 100.7), scale, (64, 48)).pixels)
