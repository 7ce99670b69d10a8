"""Continuous interpolation, the label and the score's peak against their definitions in space."""

import numpy as np
import pytest
from scipy.integrate import quad

from etd_ros.systems.eco.fourier import (
    Interpolation,
    cubic_kernel_spectrum,
    inner,
    label_spectrum,
    on_grid,
    shifted,
)
from etd_ros.systems.eco.localisation import find_peak

A = -0.75


def cubic_kernel(x, a):
    """Cubic convolution kernel (Keys 1981): 1 at 0, and 0 at every other whole number."""
    distance = np.abs(x)
    near = (a + 2) * distance**3 - (a + 3) * distance**2 + 1
    far = a * (distance**3 - 5 * distance**2 + 8 * distance - 4)
    return np.where(distance <= 1, near, np.where(distance < 2, far, 0.0))


def values_at(spectrum, rows, columns):
    """A function from its coefficients, by the definition of a Fourier series."""
    highest = spectrum.shape[-1] - 1
    total = np.zeros(np.broadcast_shapes(rows.shape, columns.shape))
    for k in range(-highest, highest + 1):
        for m in range(highest + 1):
            wave = spectrum[k + highest, m] * np.exp(2j * np.pi * (k * rows + m * columns))
            total += (1 if m == 0 else 2) * wave.real
    return total


def random_spectrum(seed, highest, channels=None):
    side = 2 * highest + 1
    shape = (side, side) if channels is None else (channels, side, side)
    maps = np.random.default_rng(seed).normal(size=shape)
    spectrum = np.fft.fftshift(np.fft.rfft2(maps), axes=-2) / side**2
    return spectrum.astype(np.complex64)


def test_the_interpolation_kernel_keeps_the_samples():
    assert cubic_kernel(np.arange(-4.0, 5.0), A) == pytest.approx([0, 0, 0, 0, 1, 0, 0, 0, 0], abs=1e-12)


def test_the_interpolation_kernel_keeps_a_constant():
    offsets = np.linspace(0, 1, 11)[:, None] + np.arange(-3, 3)
    assert cubic_kernel(offsets, A).sum(axis=1) == pytest.approx(np.ones(11), abs=1e-12)


@pytest.mark.parametrize("frequency", [0.0, 0.05, 0.3, 0.5, 0.77, 1.2])
def test_the_kernels_spectrum_is_its_fourier_transform(frequency):
    integral, _ = quad(
        lambda x: cubic_kernel(np.array(x), A) * np.cos(2 * np.pi * frequency * x), -2, 2, points=[-1, 0, 1]
    )
    assert cubic_kernel_spectrum(np.array([frequency]), A)[0] == pytest.approx(integral, abs=1e-9)


@pytest.mark.parametrize("cells", [7, 25])
def test_interpolation_is_exact_at_the_samples(cells):
    # All frequencies that look alike at the samples add up to one, for each frequency that samples can have.
    frequencies = np.arange(cells)[:, None] / cells + np.arange(-4000, 4000)
    assert cubic_kernel_spectrum(frequencies, A).sum(axis=1) == pytest.approx(np.ones(cells), abs=1e-6)


def test_an_interpolated_map_is_the_sum_of_its_samples_kernels():
    cells = 9
    maps = np.random.default_rng(1).normal(size=(1, cells, cells)).astype(np.float32)
    spectrum = Interpolation(cells, A).spectrum(maps)[0]
    taper = np.hanning(cells + 2)[1:-1]
    samples = maps[0] * np.outer(taper, taper)
    # In space, on a fine grid over the period from -1/2 to 1/2, with the middle cell's centre at 0.
    fine = (np.arange(900) + 0.5) / 900 - 0.5
    centres = (np.arange(cells) - cells // 2) / cells
    distance = (fine[:, None] - centres + 0.5) % 1 - 0.5
    kernels = cubic_kernel(distance * cells, A)
    surface = kernels @ samples @ kernels.T
    for k, m in [(0, 0), (1, 0), (-2, 3), (4, 4), (-4, 1)]:
        waves = np.exp(-2j * np.pi * (k * fine[:, None] + m * fine))
        assert spectrum[k + cells // 2, m] == pytest.approx((surface * waves).mean(), abs=2e-5)


def test_the_label_is_a_gaussian_of_height_one_in_the_middle():
    sigma, highest = 0.04, 20
    label = label_spectrum(sigma, highest)
    places = np.linspace(-0.3, 0.3, 13)
    expected = np.exp(-(places[:, None] ** 2 + places**2) / (2 * sigma**2))
    assert values_at(label, places[:, None], places) == pytest.approx(expected, abs=1e-4)


def test_a_shifted_spectrum_is_that_of_the_shifted_function():
    spectrum = random_spectrum(2, 4, channels=2)
    (moved,) = shifted([spectrum], 0.13, -0.21)
    rows, columns = np.linspace(-0.5, 0.5, 6)[:, None], np.linspace(-0.5, 0.5, 5)
    for before, after in zip(spectrum, moved, strict=True):
        expected = values_at(before, rows + 0.13, columns - 0.21)
        assert values_at(after, rows, columns) == pytest.approx(expected, abs=1e-5)


def test_the_inner_product_is_that_of_the_functions():
    a, b = random_spectrum(3, 5), random_spectrum(4, 5)
    assert inner(a, b) == pytest.approx(float(np.mean(on_grid(a) * on_grid(b))), rel=1e-4)
    assert inner(a.real.copy(), b.real.copy()) == pytest.approx(float(np.sum(a.real * b.real)), rel=1e-4)


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.101, -0.203), (-0.333, 0.447), (0.499, -0.496)])
def test_the_peak_of_a_score_is_found_between_its_cells(place):
    score = label_spectrum(0.05, 15).astype(np.complex64)
    (moved,) = shifted([score], -place[0], -place[1])
    peak = find_peak(moved, newton_steps=5)
    assert (peak.row, peak.column) == pytest.approx(place, abs=1e-4)
    assert peak.score == pytest.approx(1, abs=1e-3)


def test_a_score_without_a_peak_stays_where_it_is_highest_on_the_grid():
    level = np.zeros((11, 6), np.complex64)
    level[5, 0] = 0.25
    peak = find_peak(level, newton_steps=5)
    assert (peak.row, peak.column, peak.score) == (0, 0, 0.25)
