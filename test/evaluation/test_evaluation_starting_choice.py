"""The weights of the object round a click, from what makes candidates good on simulated scenes."""

import numpy as np
import pytest

from etd_ros.evaluation.starting_choice import Example, examples, fitted_weights, random_scenes, shelf_scenes
from etd_ros.tracking.click_candidates import FEATURES


def made_up(looks: int, weights: np.ndarray) -> list[Example]:
    """Looks of which the candidate with the largest weighted sum is the one good one."""
    rng = np.random.default_rng(4)
    found = []
    for _ in range(looks):
        features = rng.normal(size=(12, len(weights)))
        found.append(Example(features, (np.arange(12) == (features @ weights).argmax()).astype(np.float64)))
    return found


def test_weights_choose_what_is_good_in_looks_that_they_were_not_made_from():
    looks = made_up(120, np.array([1.0, -2.0, 0.0]))
    weights = fitted_weights(looks[:80])
    assert weights[0] > 0 > weights[1]
    assert abs(weights[2]) < 0.3 * weights[0]
    assert np.mean([look.worth[(look.features @ weights).argmax()] for look in looks[80:]]) > 0.9


@pytest.mark.parametrize("scenes", [random_scenes, shelf_scenes])
def test_the_clicks_of_a_scene_give_examples_of_good_and_bad_candidates(scenes):
    looks = list(examples(*next(scenes([109]))))
    assert looks
    for look in looks:
        assert look.features.shape == (len(look.worth), len(FEATURES))
        assert look.worth.min() >= 0
        assert 0 < look.worth.max() <= 1
