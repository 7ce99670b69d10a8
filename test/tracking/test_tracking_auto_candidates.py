"""What may become a target by itself has to go somewhere."""

import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.tracking.auto_candidates import Candidate
from etd_ros.tracking.clusters import Sighting

LOOK_NS = 30_000_000


def seen_at(places, size_px=30.0):
    """A candidate whose middle was at these places (pixels), look by look."""
    first, *rest = [Sighting(Box(x, y, size_px, size_px), (0.0, 0.0), 1.0) for x, y in places]
    candidate = Candidate(first, LOOK_NS, LOOK_NS, first.box.center)
    for look, sighting in enumerate(rest, start=2):
        candidate.see(sighting, look * LOOK_NS)
    return candidate


def test_what_moves_steadily_is_on_its_way_at_its_third_look():
    assert seen_at([(0, 0), (3, 1), (6, 2)]).is_on_its_way
    assert not seen_at([(0, 0)]).is_on_its_way


def test_what_flickers_in_place_is_not_on_its_way_though_it_is_not_where_it_was_first():
    rng = np.random.default_rng(3)
    flickers = [seen_at(rng.normal(4, 3, (looks, 2))) for looks in range(5, 40) for _ in range(5)]
    assert np.mean([candidate.moved_px > 2 for candidate in flickers]) > 0.5
    assert np.mean([candidate.is_on_its_way for candidate in flickers]) < 0.05


@pytest.mark.parametrize(("size_px", "is_on_its_way"), [(20, True), (150, False)])
def test_what_moves_by_less_than_boxes_are_off_is_not(size_px, is_on_its_way):
    assert seen_at([(0, 0), (1, 0), (2, 0), (3, 0)], size_px).is_on_its_way is is_on_its_way


def test_what_sets_off_after_it_has_flickered_for_long_is_on_its_way_soon():
    flickers = [(float(look % 2), 0.0) for look in range(60)]
    assert seen_at([*flickers, *((4.0 * look, 0.0) for look in range(6))]).is_on_its_way
