"""The scale filter: sizes of a texture of which everything is known."""

import itertools

import cv2
import numpy as np
import pytest

from etd_ros.simulation.textures import smooth_noise
from etd_ros.systems.eco.config import EcoConfig
from etd_ros.systems.eco.pictures import Pyramid
from etd_ros.systems.eco.scale import ScaleFilter

CENTER = 120.0, 90.0
STEP = EcoConfig().scale_step


@pytest.fixture(scope="module")
def zoomed():
    """A picture enlarged so many times about its middle; its texture is four times as fine, so that it stays sharp."""
    fine = (255 * smooth_noise(np.random.default_rng(1), 720, 960, grain=6)).astype(np.float32)

    def picture(factor):
        scale = factor / 4
        matrix = np.array([[scale, 0, 119.5 - 479.5 * scale], [0, scale, 89.5 - 359.5 * scale]])
        small = cv2.warpAffine(fine, matrix, (240, 180), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        return Pyramid(np.clip(small, 0, 255).astype(np.uint8))

    return picture


@pytest.mark.parametrize("size", [(40.0, 40.0), (60.0, 24.0)])
@pytest.mark.parametrize("k", [-8, -4, -2, -1, 0, 1, 2, 4, 8])
def test_the_scale_filter_finds_by_how_many_steps_the_target_grew(zoomed, size, k):
    scales = ScaleFilter(size, EcoConfig())
    scales.learn(zoomed(1), CENTER, size)
    factor = scales.find(zoomed(STEP**k), CENTER, size)
    # The taper towards the outer sizes draws a single answer towards none; the next picture makes up for it.
    assert np.log(factor) / np.log(STEP) == pytest.approx(k, abs=0.2 * abs(k) + 0.3)


def test_sizes_between_the_steps_are_told_apart(zoomed):
    scales = ScaleFilter((40.0, 40.0), EcoConfig())
    scales.learn(zoomed(1), CENTER, (40.0, 40.0))
    found = [scales.find(zoomed(STEP ** (k / 4)), CENTER, (40.0, 40.0)) for k in range(5)]
    assert all(later > earlier for earlier, later in itertools.pairwise(found))


def test_growing_picture_after_picture_is_followed(zoomed):
    size, scales = 40.0, ScaleFilter((40.0, 40.0), EcoConfig())
    scales.learn(zoomed(1), CENTER, (size, size))
    for k in range(1, 30):
        picture = zoomed(1.015**k)
        size *= scales.find(picture, CENTER, (size, size))
        scales.learn(picture, CENTER, (size, size))
    assert size == pytest.approx(40 * 1.015**29, rel=0.06)


def test_a_target_without_texture_keeps_its_size():
    even = Pyramid(np.full((180, 240), 99, np.uint8))
    scales = ScaleFilter((30.0, 20.0), EcoConfig())
    scales.learn(even, CENTER, (30.0, 20.0))
    assert scales.find(even, CENTER, (30.0, 20.0)) == 1


def test_before_anything_is_learnt_the_size_stays(zoomed):
    assert ScaleFilter((30.0, 20.0), EcoConfig()).find(zoomed(1.1), CENTER, (30.0, 20.0)) == 1
