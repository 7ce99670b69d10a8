"""Noise is told from edges by what lies side by side."""

import numpy as np
import pytest

from etd_ros.tracking.strewn import are_strewn

HEIGHT, WIDTH = 60, 80
NOW_NS = 5_000_000_000
OLDEST_NS = NOW_NS - 100_000_000


def times_with(rows, columns):
    """A surface whose pixels at these places have fired since OLDEST_NS, and all others before."""
    times = np.full((HEIGHT, WIDTH, 2), OLDEST_NS, np.int64)
    times[rows, columns, np.arange(len(rows)) % 2] = OLDEST_NS + 1
    return times


def noise(share, seed=0):
    return np.nonzero(np.random.default_rng(seed).random((HEIGHT, WIDTH)) < share)


def edge():
    rows = np.arange(10, 50)
    return rows, 20 + rows // 2


@pytest.mark.parametrize("share", [0.0, 0.005, 0.02, 0.1])
def test_noise_is_strewn(share):
    assert are_strewn(times_with(*noise(share)), NOW_NS, 0.1, 0, HEIGHT, 0, WIDTH)


@pytest.mark.parametrize("share", [0.0, 0.005])
def test_an_edge_in_noise_is_not(share):
    rows, columns = (np.concatenate(both) for both in zip(edge(), noise(share), strict=True))
    assert not are_strewn(times_with(rows, columns), NOW_NS, 0.1, 0, HEIGHT, 0, WIDTH)


def test_only_the_window_counts():
    rows, columns = (np.concatenate(both) for both in zip(edge(), noise(0.02), strict=True))
    times = times_with(rows, columns)
    assert are_strewn(times, NOW_NS, 0.1, 0, HEIGHT, 50, WIDTH)
    assert not are_strewn(times, NOW_NS, 0.1, 10, 50, 20, 50)


def test_what_fires_more_often_than_noise_is_not_noise():
    times = times_with(*noise(0.1))
    times[times > OLDEST_NS] = NOW_NS
    assert are_strewn(times, NOW_NS, 0.1, 0, HEIGHT, 0, WIDTH)
    assert not are_strewn(times, NOW_NS, 0.05, 0, HEIGHT, 0, WIDTH)


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_where_nearly_everything_fires_it_cannot_be_told(share):
    assert not are_strewn(times_with(*noise(share)), NOW_NS, 0.1, 0, HEIGHT, 0, WIDTH)
