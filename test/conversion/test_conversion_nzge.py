import numpy as np
import pytest
from conversion_oracles import histogram_nzge
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from etd_ros.conversion import PAPER_INTERVAL, ConversionError, confidence_interval, interval_from_statistics, nzge

frames = hnp.arrays(
    np.uint8,
    st.tuples(st.integers(1, 13), st.integers(1, 13), st.just(2)),
    elements=st.sampled_from([0, 0, 0, 1, 7, 128, 255]),
)


@given(frames, st.integers(2, 6), st.sampled_from([2.0, np.e, 10.0, 256.0]))
@settings(deadline=None, max_examples=80)
def test_nzge_equals_plain_histograms(data, cell_size, log_base):
    assert nzge(data, cell_size, log_base) == pytest.approx(histogram_nzge(data, cell_size, log_base), abs=1e-12)


def test_one_event_pixel_gives_the_paper_cell_its_known_entropy():
    data = np.zeros((180, 240, 2), np.uint8)
    data[10, 10, 0] = 200
    assert nzge(data, 4, np.e) == pytest.approx(0.117, abs=5e-4)
    assert nzge(data) == pytest.approx(0.0211, abs=5e-5)


def test_frame_without_any_contrast_has_no_entropy():
    assert nzge(np.zeros((9, 9, 2), np.uint8)) == 0.0
    assert nzge(np.full((8, 8, 2), 77, np.uint8)) == 0.0


@pytest.mark.parametrize("data", [np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4, 2))])
def test_anything_but_a_two_channel_frame_is_refused(data):
    with pytest.raises(ConversionError, match="height, width, 2"):
        nzge(data)


@pytest.mark.parametrize(("cell_size", "log_base"), [(1, 256.0), (17, 256.0), (4, 1.0), (4, float("nan"))])
def test_grids_without_a_meaning_are_refused(cell_size, log_base):
    with pytest.raises(ConversionError, match="out of range"):
        nzge(np.zeros((4, 4, 2), np.uint8), cell_size, log_base)


def test_papers_statistics_give_the_papers_interval():
    alpha, beta = interval_from_statistics(mean=0.08795, std=0.02394, n=100)
    assert (round(alpha, 4), round(beta, 4)) == PAPER_INTERVAL


def test_interval_of_samples_is_that_of_their_statistics():
    samples = np.random.default_rng(0).normal(0.09, 0.02, 40)
    expected = interval_from_statistics(samples.mean(), samples.std(ddof=1), 40, 0.1)
    assert confidence_interval(samples.tolist(), 0.1) == pytest.approx(expected)


def test_interval_holds_the_true_mean_as_often_as_it_says():
    rng = np.random.default_rng(1)
    intervals = [confidence_interval(rng.normal(0.09, 0.02, 10)) for _ in range(2000)]
    assert 0.93 < np.mean([low <= 0.09 <= high for low, high in intervals]) < 0.97


@pytest.mark.parametrize("samples", [[], [0.1], [0.1, float("nan")]])
def test_too_few_or_broken_samples_are_refused(samples):
    with pytest.raises(ConversionError, match="at least two finite samples"):
        confidence_interval(samples)


@pytest.mark.parametrize(("n", "std", "significance"), [(1, 0.1, 0.05), (9, -0.1, 0.05), (9, 0.1, 0.0), (9, 0.1, 1.0)])
def test_statistics_without_an_interval_are_refused(n, std, significance):
    with pytest.raises(ConversionError, match="no interval"):
        interval_from_statistics(0.09, std, n, significance)
