"""Events that are put into a cell map 16 at a time, against plain Python."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from etd_ros.conversion.cell_map import BLOCK_EVENTS, LANES, TILE_SLOTS, cells_in, make_cell_map
from etd_ros.conversion.marks import mark_events

TILES = 4


@njit
def mark(slots, words, last, first, stop, high, low):
    return mark_events(slots, words, last, np.uint64(first), np.uint64(stop), high, low)


def channel_entropy(pixels):
    """Of 16 pixels of which so many have events of distinct levels, log base 256."""
    shares = [1 / 16] * pixels + [(16 - pixels) / 16]
    return -sum(share * math.log(share, 256) for share in shares if share)


def entropy_of(word):
    return sum(channel_entropy(half.bit_count()) for half in (word & 0xFFFF, word >> 16))


def marked(slots, words):
    """Words, the entropy gained and the tiles that were empty, one event at a time."""
    words, emptied = list(words), 0
    before = sum(map(entropy_of, words))
    for slot in slots:
        tile, place = divmod(slot, TILE_SLOTS)
        emptied += words[tile] == 0
        words[tile] |= 1 << place
    return words, sum(map(entropy_of, words)) - before, emptied


def gain_tables():
    store = make_cell_map(4, 4, 4, 256.0)
    cells = cells_in(store)
    return cells.gains_high, cells.gains_low, cells.entropy_one


slots_of_blocks = st.integers(0, 5).flatmap(
    lambda blocks: st.lists(st.integers(0, TILES * TILE_SLOTS - 1), min_size=LANES * blocks, max_size=LANES * blocks)
)


@given(
    slots_of_blocks, st.lists(st.sampled_from([0, 1, 0xFFFF, 0xFFFF0000, 2**32 - 1]), min_size=TILES, max_size=TILES)
)
@settings(deadline=None)
def test_16_at_a_time_events_leave_what_they_leave_one_by_one(slots, words):
    high, low, entropy_one = gain_tables()
    first = 3
    last = np.full(TILES * TILE_SLOTS, -1, np.int32)
    found = np.array(words, np.uint32)
    given_slots = np.array([0] * first + slots, np.uint32)
    gained, emptied = mark(given_slots, found, last, first, first + len(slots), high, low)
    wanted_words, wanted_gain, wanted_emptied = marked(slots, words)
    assert found.tolist() == wanted_words
    assert gained / entropy_one == pytest.approx(wanted_gain, abs=1e-11)
    assert emptied == wanted_emptied
    assert (last == -1).all()


def test_the_gains_of_a_whole_block_fit_their_sums():
    high, low, entropy_one = gain_tables()
    tiles = BLOCK_EVENTS // 2
    slots = np.sort(np.r_[TILE_SLOTS * np.arange(tiles), TILE_SLOTS * np.arange(tiles) + 16]).astype(np.uint32)
    last, words = np.zeros(TILE_SLOTS * tiles, np.int32), np.zeros(tiles, np.uint32)
    gained, emptied = mark(slots, words, last, 0, BLOCK_EVENTS, high, low)
    assert gained / entropy_one == pytest.approx(BLOCK_EVENTS * channel_entropy(1), rel=1e-9)
    assert emptied == tiles
