"""Which cells of a model are trusted: against what the module says, in NumPy."""

import numpy as np
import pytest

from etd_ros.tracking.cell_trust import CellTrust
from etd_ros.tracking.contour_kernels import GRADIENT_X, GRADIENT_Y, MAPS, RIDGE, WEIGHT

ROWS, COLUMNS = 20, 24
LOOKED_AT = [GRADIENT_X, GRADIENT_Y, RIDGE]
GRADIENTS = [GRADIENT_X, GRADIENT_Y]
INSIDE = np.zeros((ROWS, COLUMNS), np.float32)
KNOWN = np.eye(2)
"""Edges across all directions have been seen."""


@pytest.fixture
def usual():
    maps = np.random.default_rng(4).normal(size=(MAPS, ROWS, COLUMNS)).astype(np.float32)
    maps[WEIGHT] = 1
    return maps


def changed(maps, where, *, seed=5):
    """Maps that look otherwise where it is 1."""
    other = np.random.default_rng(seed).normal(size=maps.shape).astype(np.float32)
    return np.where(where > 0, other, maps).astype(np.float32)


def columns_until(column):
    where = np.zeros((ROWS, COLUMNS), np.float32)
    where[:, :column] = 1
    return where


def sums_around(values, reach):
    padded = np.pad(values, reach)
    shifts = range(2 * reach + 1)
    return sum(padded[row : row + ROWS, column : column + COLUMNS] for row in shifts for column in shifts)


def stays(usual, lately, reach):
    square, change = ((maps[LOOKED_AT] ** 2).sum(axis=0) for maps in (usual, lately - usual))
    square, change = sums_around(square, reach), sums_around(change, reach)
    return square / (square + 3 * change)


def stays_known(usual, lately, seen, reach):
    """How alike cells stay, where they may have more of the same, by the parts of the gradients that are known."""

    def product(one, other):
        along = np.einsum("irc,ij,jrc->rc", one[GRADIENTS], seen, other[GRADIENTS])
        return sums_around(along + one[RIDGE] * other[RIDGE], reach)

    square, common = product(usual, usual), product(lately, usual)
    times = np.maximum(1, common / square)
    change = product(lately, lately) - 2 * times * common + times**2 * square
    return square / (square + 3 * change)


def trust_in(cells, usual):
    """What the maps that looks are compared with say of each cell."""
    return (cells.trusted[LOOKED_AT] / usual[LOOKED_AT]).mean(axis=0)


def test_cells_outside_of_the_target_count_by_how_alike_they_stay(usual):
    recent = changed(usual, 1 - columns_until(8))
    outside = np.random.default_rng(6).uniform(0, 1, (ROWS, COLUMNS)).astype(np.float32)
    outside[:, 12:] = 0
    cells = CellTrust(usual, outside)
    cells.weigh(usual, recent, recent, KNOWN, sees_covers=False)
    trust = 1 - outside * (1 - stays(usual, recent, reach=1))
    np.testing.assert_allclose(cells.trusted[LOOKED_AT], trust * usual[LOOKED_AT], rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(cells.both[LOOKED_AT], trust * (usual + recent)[LOOKED_AT] / 2, rtol=1e-4, atol=1e-5)
    assert trust[:, :7].min() == 1, "what stays is trusted"
    assert trust[:, 12:].min() == 1, "and so is what lies inside"
    assert trust[:, 9:12].min() < 0.5
    assert cells.covered == 0


def test_cells_inside_that_change_on_one_side_show_what_covers_the_target(usual):
    cells = CellTrust(usual, INSIDE)
    latest = changed(usual, columns_until(9))
    cells.weigh(usual, usual, latest, KNOWN, sees_covers=True)
    assert cells.covered == 1
    staying = stays_known(usual, latest, KNOWN, reach=2)
    mean = (staying * (usual[LOOKED_AT] ** 2).sum(axis=0)).sum() / (usual[LOOKED_AT] ** 2).sum()
    expected = np.clip((staying / mean - 0.7) / 0.3, 0, 1)
    np.testing.assert_allclose(trust_in(cells, usual), expected, rtol=1e-3, atol=1e-3)
    assert expected[:, :7].max() == 0, "nothing of what covers it counts"
    assert expected[:, 12:].min() == 1, "all of what is left to see does"


def test_a_target_that_changes_all_round_is_trusted_as_it_was(usual):
    cells = CellTrust(usual, INSIDE)
    cells.weigh(usual, usual, changed(usual, INSIDE + 1), KNOWN, sees_covers=True)
    assert cells.covered == 0
    np.testing.assert_array_equal(cells.trusted[LOOKED_AT], usual[LOOKED_AT])


def test_edges_that_become_stronger_on_one_side_are_not_covered(usual):
    cells = CellTrust(usual, INSIDE)
    stronger = usual * (1 + columns_until(9))
    cells.weigh(usual, usual, stronger, KNOWN, sees_covers=True)
    assert cells.covered == 0
    weaker = usual * (1 - 0.8 * columns_until(9))
    cells.weigh(usual, usual, weaker, KNOWN, sees_covers=True)
    assert cells.covered > 0.5


def test_edges_that_are_seen_for_the_first_time_do_not_cover_the_target(usual):
    usual[GRADIENT_Y] = 0
    latest = usual.copy()
    latest[GRADIENT_Y] = 3 * changed(usual, columns_until(9))[GRADIENT_X] * columns_until(9)
    cells = CellTrust(usual, INSIDE)
    cells.weigh(usual, usual, latest, np.diag([1.0, 0.0]), sees_covers=True)
    assert cells.covered == 0
    cells.weigh(usual, usual, latest, KNOWN, sees_covers=True)
    assert cells.covered > 0.5


@pytest.mark.parametrize("seen", [KNOWN, np.array([[0.9, -0.2], [-0.2, 0.3]])], ids=["all", "mostly one direction"])
def test_cells_that_show_what_covers_the_target_are_told_by_what_is_known(usual, seen):
    cells = CellTrust(usual, INSIDE)
    latest = changed(usual * (1 + 0.5 * (1 - columns_until(14))), columns_until(9))
    cells.weigh(usual, usual, latest, seen, sees_covers=True)
    assert cells.covered == 1
    staying = stays_known(usual, latest, seen, reach=2)
    square = np.einsum("irc,ij,jrc->rc", usual[GRADIENTS], seen, usual[GRADIENTS]) + usual[RIDGE] ** 2
    expected = np.clip((staying * square.sum() / (staying * square).sum() - 0.7) / 0.3, 0, 1)
    np.testing.assert_allclose(trust_in(cells, usual), expected, rtol=1e-3, atol=1e-3)


def test_how_surely_something_covers_the_target_grows_with_how_much_of_it_is_covered(usual):
    cells = CellTrust(usual, INSIDE)
    covered = []
    for column in range(7):
        cells.weigh(usual, usual, changed(usual, columns_until(column)), KNOWN, sees_covers=True)
        covered.append(cells.covered)
    assert covered[0] == 0
    assert covered == sorted(covered)
    assert 0 < covered[1] < covered[-1] == 1


def test_nothing_covers_a_target_that_is_not_known_well_enough_to_tell(usual):
    cells = CellTrust(usual, INSIDE)
    cells.weigh(usual, usual, changed(usual, columns_until(9)), KNOWN, sees_covers=True)
    cells.weigh(usual, usual, changed(usual, columns_until(9)), KNOWN, sees_covers=False)
    assert cells.covered == 0
    np.testing.assert_array_equal(cells.trusted[LOOKED_AT], usual[LOOKED_AT])


def test_a_model_of_nothing_is_trusted():
    empty = np.zeros((MAPS, ROWS, COLUMNS), np.float32)
    cells = CellTrust(empty, INSIDE)
    cells.weigh(empty, empty, empty, KNOWN, sees_covers=True)
    assert cells.covered == 0
    assert not cells.trusted[LOOKED_AT].any()
