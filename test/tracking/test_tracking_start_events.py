"""The events of a start, thinned out where there are too many."""

import numpy as np
import pytest

from etd_ros.tracking.contour_kernels import AGE, X
from etd_ros.tracking.start_events import EVENTS_MAX, StartEvents


def points(count, first=0):
    looked_at = np.zeros((count, 4), np.float32)
    looked_at[:, X] = np.arange(first, first + count)
    looked_at[:, AGE] = 0.001
    return looked_at


def test_few_events_are_all_kept_with_ages_from_the_start():
    kept = StartEvents()
    kept.take(points(30), since_s=0.01)
    kept.take(points(20, first=30), since_s=0.02)
    assert kept.looks == 2
    np.testing.assert_array_equal(kept.events[:, X], np.arange(50))
    np.testing.assert_allclose(kept.events[:, AGE], [-0.009] * 30 + [-0.019] * 20, atol=1e-6)


def test_of_many_events_an_even_share_of_each_look_is_kept():
    kept = StartEvents()
    for look in range(100):
        kept.take(points(3000), since_s=0.005 * look)
    numbers = np.unique(kept.events[:, AGE], return_counts=True)[1]
    assert kept.looks == len(numbers) == 100
    assert EVENTS_MAX / 2 <= numbers.sum() <= EVENTS_MAX
    assert np.ptp(numbers) <= 1


@pytest.mark.parametrize("count", [100, 5 * EVENTS_MAX])
def test_events_that_replace_others_are_thinned_out_as_well(count):
    kept = StartEvents()
    for _ in range(3):
        kept.take(points(EVENTS_MAX), since_s=0.0)
    kept.replace(points(count))
    assert kept.looks == 3
    assert min(count, EVENTS_MAX / 2) <= len(kept.events) <= EVENTS_MAX
    assert kept.events[-1, X] >= count - 8
