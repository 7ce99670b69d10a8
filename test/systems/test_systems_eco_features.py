"""Oriented gradients and intensity channels against plain Python, and what they must not depend on."""

import math

import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.simulation.textures import smooth_noise
from etd_ros.systems.eco.config import EcoConfig
from etd_ros.systems.eco.features import Features, project
from etd_ros.systems.eco.fhog import CHANNELS, fhog
from etd_ros.systems.eco.intensity import intensity_channels, membership
from etd_ros.systems.eco.pictures import Pyramid

TURN = math.pi / 9
DIRECTIONS = [k + half for k in range(9) for half in (0, 9)]
"""In the order in which the first of two equally near ones counts."""


def patch_of(seed: int, height: int, width: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width)).astype(np.uint8)


def cloudy(seed: int, height: int, width: int) -> np.ndarray:
    return (smooth_noise(np.random.default_rng(seed), height, width) * 250).astype(np.uint8)


def plain_fhog(patch: np.ndarray, cell: int) -> np.ndarray:
    """The definition, a pixel, a cell and a channel at a time."""
    rows, columns = patch.shape[0] // cell, patch.shape[1] // cell
    height, width = rows * cell, columns * cell
    pixels = patch.astype(float)
    votes = {}
    for y in range(height):
        for x in range(width):
            dx = pixels[y, min(x + 1, width - 1)] - pixels[y, max(x - 1, 0)]
            dy = pixels[min(y + 1, height - 1), x] - pixels[max(y - 1, 0), x]
            direction = max(DIRECTIONS, key=lambda k: round(dx * math.cos(k * TURN) + dy * math.sin(k * TURN), 9))
            for r in range(rows):
                for c in range(columns):
                    row_share = 1 - abs((y + 0.5) / cell - (r + 0.5))
                    column_share = 1 - abs((x + 0.5) / cell - (c + 0.5))
                    if row_share > 0 and column_share > 0:
                        key = r, c, direction
                        votes[key] = votes.get(key, 0) + math.hypot(dx, dy) * row_share * column_share
    energy = np.zeros((rows, columns))
    for r in range(rows):
        for c in range(columns):
            energy[r, c] = sum((votes.get((r, c, k), 0) + votes.get((r, c, k + 9), 0)) ** 2 for k in range(9))
    energy = np.pad(energy, 1, mode="edge")
    channels = np.zeros((CHANNELS, rows, columns))
    for r in range(rows):
        for c in range(columns):
            blocks = [energy[r + i : r + i + 2, c + j : c + j + 2].sum() for i in (0, 1) for j in (0, 1)]
            signed = [votes.get((r, c, k), 0) for k in range(18)]
            unsigned = [signed[k] + signed[k + 9] for k in range(9)]
            clipped = [[min(value / math.sqrt(block + 1e-4), 0.2) for block in blocks] for value in signed + unsigned]
            channels[:27, r, c] = [sum(values) / 2 for values in clipped]
            channels[27:, r, c] = [0.2357 * sum(values[i] for values in clipped[:18]) for i in range(4)]
    return channels


@pytest.mark.parametrize(("height", "width", "cell"), [(18, 24, 6), (13, 17, 4), (8, 8, 4)])
def test_the_gradient_histograms_are_those_of_their_definition(height, width, cell):
    patch = cloudy(1, height, width)
    assert fhog(patch, cell) == pytest.approx(plain_fhog(patch, cell), abs=1e-5)


def test_an_edge_votes_for_its_direction():
    patch = np.zeros((24, 24), np.uint8)
    patch[:, 12:] = 200
    channels = fhog(patch, 6).sum(axis=(1, 2))
    assert np.argmax(channels[:18]) == 0
    assert np.argmax(fhog(255 - patch, 6).sum(axis=(1, 2))[:18]) == 9
    assert np.argmax(fhog(patch.T.copy(), 6).sum(axis=(1, 2))[18:27]) in (4, 5)


def test_contrast_does_not_change_the_gradient_histograms():
    patch = cloudy(2, 36, 36) // 2
    assert fhog(2 * patch, 6) == pytest.approx(fhog(patch, 6), abs=1e-4)


def test_brightness_does_not_change_the_gradient_histograms():
    patch = cloudy(2, 36, 36) // 2
    assert (fhog(patch + 90, 6) == fhog(patch, 6)).all()


def test_a_shift_by_a_cell_shifts_the_gradient_histograms_by_a_cell():
    whole = cloudy(3, 60, 66)
    left, right = fhog(whole[:, :60].copy(), 6), fhog(whole[:, 6:].copy(), 6)
    assert left[:, 1:-1, 3:-2] == pytest.approx(right[:, 1:-1, 2:-3], abs=1e-5)


def test_an_even_patch_has_no_gradients():
    assert not fhog(np.full((30, 30), 77, np.uint8), 6).any()


def test_memberships_are_shares_of_neighbouring_bins():
    table = membership(6) + 1 / 6
    assert table.sum(axis=1) == pytest.approx(np.ones(256), abs=1e-6)
    assert table[51] == pytest.approx([0, 1, 0, 0, 0, 0], abs=1e-6)
    assert ((table > 1e-6).sum(axis=1) <= 2).all()


def test_intensity_channels_are_mean_memberships_of_equal_parts():
    patch, table = patch_of(4, 12, 12), membership(6)
    channels = intensity_channels(patch, 3, table)
    expected = table[patch].reshape(3, 4, 3, 4, 6).mean(axis=(1, 3)).transpose(2, 0, 1)
    assert channels == pytest.approx(expected, abs=1e-6)


def test_pixels_between_two_parts_count_for_both():
    patch, table = patch_of(5, 10, 10), membership(6)
    # 7 parts of 10 pixels are parts of 10 tenths each once every pixel is cut into 7.
    fine = np.kron(patch, np.ones((7, 7), np.uint8))
    expected = table[fine].reshape(7, 10, 7, 10, 6).mean(axis=(1, 3)).transpose(2, 0, 1)
    assert intensity_channels(patch, 7, table) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("box", [Box(0, 0, 8, 8), Box(0, 0, 40, 40), Box(0, 0, 100, 12), Box(0, 0, 300, 260)])
def test_every_kind_of_feature_has_an_odd_number_of_cells_on_the_search_area(box):
    features = Features(box, EcoConfig())
    maps = features.maps(Pyramid(cloudy(6, 180, 240)), (120.0, 90.0), features.scale)
    assert [part.shape[0] for part in maps] == [31, 6]
    assert all(part.shape[1] == part.shape[2] and part.shape[1] % 2 == 1 for part in maps)
    assert 144 <= features.side <= 206
    assert features.side * features.scale == pytest.approx(4 * math.sqrt(box.w * box.h), rel=0.05)


def test_feature_maps_have_unit_mean_square():
    features = Features(Box(0, 0, 30, 30), EcoConfig())
    maps = features.maps(Pyramid(cloudy(6, 180, 240)), (120.0, 90.0), features.scale)
    assert [float(np.mean(part**2)) for part in maps] == pytest.approx([1, 1], abs=1e-4)


def test_the_first_projection_keeps_the_directions_of_largest_variance():
    features = Features(Box(0, 0, 30, 30), EcoConfig())
    maps = features.maps(Pyramid(cloudy(6, 180, 240)), (120.0, 90.0), features.scale)
    for part, projection, kept in zip(maps, features.principal_directions(maps), (10, 3), strict=True):
        assert projection.T @ projection == pytest.approx(np.eye(kept), abs=1e-5)
        values = part.reshape(len(part), -1) - part.reshape(len(part), -1).mean(axis=1, keepdims=True)
        singular = np.linalg.svd(values, compute_uv=False)
        variances = np.sum((projection.T @ values) ** 2, axis=1)
        assert variances == pytest.approx(singular[:kept] ** 2, rel=1e-3)


def test_projecting_is_a_product_with_the_transposed_matrix():
    rng = np.random.default_rng(7)
    channels = (rng.normal(size=(5, 3, 4)) + 1j * rng.normal(size=(5, 3, 4))).astype(np.complex64)
    matrix = rng.normal(size=(5, 2)).astype(np.float32)
    assert project(channels, matrix) == pytest.approx(np.einsum("cd,crk->drk", matrix, channels), abs=1e-5)


def test_a_patch_shows_the_part_asked_for_to_a_fraction_of_a_pixel():
    ramp = np.add.outer(np.arange(100), 1.5 * np.arange(100)).astype(np.uint8)
    patch = Pyramid(ramp).patch((40.25, 50.5), (20.0, 10.0), (10, 20)).astype(float)
    # The pixel in column 0 has its middle at 0.5.
    columns, rows = 30.25 + np.arange(20) + 0.5 - 0.5, 45.5 + np.arange(10) + 0.5 - 0.5
    assert patch == pytest.approx(np.add.outer(rows, 1.5 * columns), abs=1.1)


def test_a_patch_made_smaller_does_not_alias():
    stripes = np.zeros((200, 200), np.uint8)
    stripes[:, ::2] = 200
    patch = Pyramid(stripes).patch((100.0, 100.0), (150.0, 150.0), (20, 20))
    assert patch == pytest.approx(np.full((20, 20), 100), abs=2)


def test_a_patch_beyond_the_border_goes_on_with_the_edge():
    picture = cloudy(8, 40, 40)
    patch = Pyramid(picture).patch((-60.0, 20.5), (20.0, 1.0), (1, 20))
    assert (patch == picture[20, 0]).all()
