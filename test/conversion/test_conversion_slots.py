"""The slots of events that are found 16 at a time, against the map's own tables."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from etd_ros.conversion.cell_map import LANES, cells_in, make_cell_map
from etd_ros.conversion.slots import find_slots

WIDTH, HEIGHT = 346, 261
FIRST = 3
CELLS = cells_in(make_cell_map(WIDTH, HEIGHT, 4, 256.0))


@njit
def slots_of(x, y, p, first, number, cell_columns, slots):
    find_slots(x, y, p, np.uint64(first), np.uint64(number), np.uint32(cell_columns), slots)


def events_of(seed, number):
    rng = np.random.default_rng(seed)
    columns = ((WIDTH, np.uint16), (HEIGHT, np.uint16), (2, np.uint8))
    return [rng.integers(0, end, FIRST + number).astype(kind) for end, kind in columns]


def wanted(x, y, p):
    return CELLS.row_slot[y] + CELLS.column_slot[x] + 16 * (1 - p.astype(np.uint32))


@given(st.integers(0, 2**32), st.integers(0, 4))
def test_slots_are_those_of_the_maps_tables(seed, blocks):
    number = LANES * blocks
    x, y, p = events_of(seed, number)
    slots = np.full(number + 1, 7, np.uint32)
    slots_of(x, y, p, FIRST, number, CELLS.columns, slots)
    assert slots[:number].tolist() == wanted(x, y, p)[FIRST:].tolist()
    assert slots[number] == 7


@pytest.mark.parametrize("step", [2, -1])
def test_events_need_not_lie_one_after_the_other(step):
    x, y, p = (column[::step] for column in events_of(1, 2 * LANES + FIRST))
    slots = np.zeros(LANES, np.uint32)
    slots_of(x, y, p, FIRST, LANES, CELLS.columns, slots)
    assert slots.tolist() == wanted(x, y, p)[FIRST : FIRST + LANES].tolist()


def test_the_corners_of_the_largest_map_have_slots_of_their_own():
    width, height = 8192, 4096
    x, y = (np.resize(np.array(ends, np.uint16), LANES) for ends in ([0, width - 1], [0, 0, height - 1, height - 1]))
    slots = np.zeros(LANES, np.uint32)
    slots_of(x, y, np.zeros(LANES, np.uint8), 0, LANES, width // 4, slots)
    cells = (y // 4).astype(int) * (width // 4) + x // 4
    assert slots.tolist() == (32 * cells + y % 4 * 4 + x % 4 + 16).tolist()
