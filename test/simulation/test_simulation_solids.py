"""What stands on a shelf."""

import numpy as np
import pytest

from etd_ros.simulation.solids import SOLIDS
from etd_ros.simulation.textures import BRIGHT, DARK

SEEDS = range(12)


@pytest.mark.parametrize("solid", SOLIDS)
def test_a_solid_fills_its_texture_and_is_about_as_large_as_it_should_be(solid):
    for seed in SEEDS:
        texture, opacity = solid(np.random.default_rng(seed), 60)
        assert texture.shape == opacity.shape
        assert 25 <= max(texture.shape) <= 75
        assert texture.min() >= DARK
        assert texture.max() <= BRIGHT
        is_opaque = opacity > 0.5
        assert all(edge.any() for edge in (is_opaque[0], is_opaque[-1], is_opaque[:, 0], is_opaque[:, -1]))


@pytest.mark.parametrize("solid", SOLIDS)
def test_a_seed_gives_one_solid_and_another_seed_another(solid):
    (first, _), (again, _), (other, _) = (solid(np.random.default_rng(seed), 40) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert first.shape != other.shape or (first != other).any()
