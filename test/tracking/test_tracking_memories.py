"""What a target usually looks like changes slowly, what it looks like lately faster; both can be kept and recalled."""

from __future__ import annotations

import math

import numpy as np
import pytest

from etd_ros.tracking.contour_kernels import DENSITY, GRADIENT_X
from etd_ros.tracking.memories import LATEST_TIMES, RECENT_RATE, Memories

ROWS, COLUMNS = 24, 26
TO_THE_RIGHT = np.array([1.0, 0.0, 0.0, 0.0])


def drawn_at(column):
    """What a look draws of one upright edge."""
    drawn = np.zeros((2, ROWS, COLUMNS), np.float32)
    drawn[0, 8:16, column] = 1
    return drawn


@pytest.fixture
def memories():
    """Of one look at an edge on the left."""
    made = Memories(ROWS, COLUMNS, 20.0, 18.0)
    made.learn(drawn_at(8), TO_THE_RIGHT, 1.0, 1.0, sees_covers=False)
    return made


def densities_at(memories, column):
    return memories.remembered().maps[:, DENSITY, 12, column].tolist()


def test_a_first_look_is_all_that_is_known(memories):
    assert densities_at(memories, 8) == [1, 1, 1]
    assert densities_at(memories, 17) == [0, 0, 0]


@pytest.mark.parametrize(("rate", "trust"), [(0.02, 1.0), (0.02, 0.5), (0.25, 1.0)])
def test_a_look_renews_what_is_usual_least_and_the_last_looks_most(memories, rate, trust):
    memories.learn(drawn_at(17), TO_THE_RIGHT, rate, trust, sees_covers=False)
    recent = max(rate, trust * RECENT_RATE)
    assert densities_at(memories, 17) == pytest.approx([rate, recent, LATEST_TIMES * recent])
    assert densities_at(memories, 8) == pytest.approx([1 - rate, 1 - recent, 1 - LATEST_TIMES * recent])


def test_what_was_kept_comes_back(memories):
    memories.see(1.0, 0.0, 0.8)
    memories.keep()
    memories.learn(drawn_at(17), TO_THE_RIGHT, 0.5, 1.0, sees_covers=False)
    memories.see(0.0, 1.0, 0.8)
    memories.restore()
    assert densities_at(memories, 17) == [0, 0, 0]
    assert memories.known_along(1.0, 0.0) == pytest.approx(0.8)
    assert memories.known_along(0.0, 1.0) == 0


def test_what_is_remembered_does_not_change_with_what_is_learnt_afterwards(memories):
    before = memories.remembered()
    memories.learn(drawn_at(17), TO_THE_RIGHT, 0.5, 1.0, sees_covers=False)
    memories.recall(before)
    memories.learn(drawn_at(17), TO_THE_RIGHT, 0.5, 1.0, sees_covers=False)
    assert before.maps[:, DENSITY, 12, 17].tolist() == [0, 0, 0]


def test_edges_across_a_direction_are_known_by_how_nearly_it_was_seen(memories):
    memories.see(1.0, 0.0, 1.0)
    for angle in np.linspace(0, math.pi / 2, 7):
        assert memories.known_along(math.cos(angle), math.sin(angle)) == pytest.approx(math.cos(angle) ** 2)


def test_looks_are_compared_with_the_usual_memory_or_with_the_mean_of_both_where_all_cells_stay_alike(memories):
    cells = memories.cells
    assert cells.trusted == pytest.approx(cells.both)
    for _ in range(3):
        memories.learn(drawn_at(17), TO_THE_RIGHT, 0.02, 1.0, sees_covers=False)
    usual, both = (abs(maps[GRADIENT_X, 12, 17]) for maps in (cells.trusted, cells.both))
    assert both > usual > 0


def test_what_changes_on_one_side_covers_the_target_until_all_of_it_is_trusted_again(memories):
    for _ in range(20):
        memories.learn(drawn_at(8) + drawn_at(17), TO_THE_RIGHT, 1.0, 1.0, sees_covers=True)
    assert memories.cells.covered == 0
    for _ in range(5):
        memories.learn(drawn_at(8), TO_THE_RIGHT, 0.0, 1.0, sees_covers=True)
    assert memories.cells.covered > 0.5
    memories.uncover()
    assert memories.cells.covered == 0


def test_what_looks_would_be_compared_with_is_of_what_was_remembered_then(memories):
    then = memories.remembered()
    before = memories.cells.trusted.copy()
    memories.learn(drawn_at(17), TO_THE_RIGHT, 0.5, 1.0, sees_covers=False)
    cells = memories.cells_of(then)
    np.testing.assert_allclose(cells.trusted[GRADIENT_X], before[GRADIENT_X])
    assert not np.allclose(memories.cells.trusted[GRADIENT_X], before[GRADIENT_X])
