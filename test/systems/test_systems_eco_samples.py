"""The model of all samples: weights, replacing, merging."""

import numpy as np
import pytest

from etd_ros.systems.eco.samples import SampleSpace

RATE = 0.1


def sample(*values):
    """A sample whose functions are constant: one channel for each value, in two kinds of features."""
    parts = [np.zeros((1, 3, 2), np.complex64) for _ in values]
    for part, value in zip(parts, values, strict=True):
        part[0, 1, 0] = value
    return parts


def values_of(space):
    """(first value, second value) of each component."""
    return [tuple(float(block[i, 0, 1, 0].real) for block in space.samples) for i in range(space.count)]


def test_components_are_filled_first_and_older_ones_fade():
    space = SampleSpace(4, RATE)
    for value in (1, 2, 3):
        space.add(sample(value, 0))
    assert space.count == 3
    assert values_of(space) == [(1, 0), (2, 0), (3, 0)]
    assert space.weights == pytest.approx([0.81, 0.09, 0.1, 0], abs=1e-6)


def test_a_new_sample_is_merged_with_the_nearest_component_where_that_is_the_nearest_pair():
    space = SampleSpace(3, RATE)
    for value in (0, 10, 20):
        space.add(sample(value, 0))
    before = space.weights.copy()
    space.add(sample(11, 0))
    share = RATE / (RATE + 0.9 * before[1])
    assert values_of(space)[1] == pytest.approx((10 + share, 0), abs=1e-5)
    assert values_of(space)[0::2] == [(0, 0), (20, 0)]
    assert space.weights == pytest.approx([0.9 * before[0], 0.9 * before[1] + RATE, 0.9 * before[2]], abs=1e-6)


def test_the_nearest_two_components_are_merged_to_make_place_for_a_sample_that_is_new():
    space = SampleSpace(3, RATE)
    for value in (0, 1, 20):
        space.add(sample(value, 0))
    before = 0.9 * space.weights.astype(float)
    space.add(sample(20, 30))
    mean = before[1] / (before[0] + before[1])
    assert values_of(space) == [pytest.approx((mean, 0), abs=1e-5), (20, 30), (20, 0)]
    assert space.weights == pytest.approx([before[0] + before[1], RATE, before[2]], abs=1e-6)


def test_a_component_with_next_to_no_weight_makes_place():
    space = SampleSpace(2, 0.5)
    space.add(sample(0, 0))
    space.add(sample(100, 0))
    # The first one's weight halves with every sample that is merged with the other one.
    for _ in range(4):
        space.add(sample(100, 0))
    assert values_of(space) == [(0, 0), (100, 0)]
    space.add(sample(100, 0))
    assert space.weights.sum() == pytest.approx(1)
    assert values_of(space) == [(100, 0), (100, 0)]


def test_distances_are_those_of_all_features_and_frequencies():
    space = SampleSpace(3, RATE)
    apart = [sample(0, 0), sample(0, 0), sample(5, 5)]
    apart[1][0][0, 2, 1] = 3 + 4j
    for part in apart:
        space.add(part)
    # 5 away in a frequency that stands for two: farther (7.07) than the new sample is from (5, 5).
    space.add(sample(5, 11))
    assert values_of(space)[2][1] > 5
    assert values_of(space)[0] == (0, 0)


def test_weights_sum_to_one_and_the_mean_of_all_samples_is_kept():
    rng = np.random.default_rng(3)
    space = SampleSpace(6, RATE)
    mean = None
    for values in rng.normal(size=(60, 2)):
        space.add(sample(*values))
        mean = values if mean is None else (1 - RATE) * mean + RATE * values
        assert space.weights.sum() == pytest.approx(1, abs=1e-5)
        # Merging keeps it exactly; replacing a component of hardly any weight nearly so.
        total = np.sum(np.array(values_of(space)) * space.weights[: space.count, None], axis=0)
        assert total == pytest.approx(mean, abs=0.15)
