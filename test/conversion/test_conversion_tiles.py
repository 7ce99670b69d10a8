"""The vector instructions of a tile against plain Python, and where a cell map lies in its memory."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from etd_ros.conversion.cell_map import GROUP_TILES, PARTIAL, TILE_SIDE, TILE_SLOTS, cells_in, make_cell_map
from etd_ros.conversion.readout import HALF_UP
from etd_ros.conversion.tile_tables import FEW_EVENTS, tile_tables
from etd_ros.conversion.tiles import slots_of_level, tile_levels, tiles_with_events, write_tile
from etd_ros.conversion.twins import pairs_of_few

times = st.lists(st.integers(0, 2_000_000_000), min_size=TILE_SLOTS, max_size=TILE_SLOTS)
words = st.integers(0, 2**TILE_SLOTS - 1)
few_slots = st.sets(st.integers(0, TILE_SLOTS - 1), max_size=FEW_EVENTS)


@njit
def levels_of(last, slot, word, slope, levels):
    return tile_levels(last, np.uint64(slot), np.uint32(word), slope, HALF_UP, levels, True, tile_tables())


@njit
def write(levels, data, byte, row_bytes):
    write_tile(levels, data, np.uint64(byte), np.uint64(row_bytes), tile_tables())


@njit
def with_level(levels, level):
    return slots_of_level(levels, np.uint8(level))


@njit
def pairs_in(levels, word):
    return pairs_of_few(levels, np.uint32(word), tile_tables())


@njit
def with_events(words, first):
    return tiles_with_events(words, np.uint64(first))


def expected_levels(last, word, slope):
    """0 where there is no event, whatever the time says there."""
    return [max(1, int(t * slope + HALF_UP)) if word >> slot & 1 else 0 for slot, t in enumerate(last)]


@given(times, words, st.sampled_from([1, 1_000, 12_345_678, 2_000_000_000]), st.sampled_from([0, 32, 64]))
@settings(deadline=None)
def test_levels_and_twins_of_a_tile_are_those_of_its_pixels_one_by_one(tile_times, word, duration_ns, slot):
    valid = [min(t, duration_ns) if word >> place & 1 else t for place, t in enumerate(tile_times)]
    last = np.full(3 * TILE_SLOTS, 7, np.int32)
    last[slot : slot + TILE_SLOTS] = valid
    levels = np.zeros(TILE_SLOTS, np.uint8)
    twins = levels_of(last, slot, word, 255.0 / duration_ns, levels)
    wanted = expected_levels(valid, word, 255.0 / duration_ns)
    assert levels.tolist() == wanted
    channels = wanted[:16], wanted[16:]
    assert twins == sum(a == b > 0 for channel in channels for a, b in combinations(channel, 2))


@given(st.lists(st.integers(0, 9), min_size=TILE_SLOTS, max_size=TILE_SLOTS), few_slots)
@settings(deadline=None)
def test_twins_of_few_events_are_those_of_their_pixels_one_by_one(tile_times, slots):
    word = sum(1 << slot for slot in slots)
    last = np.array(tile_times, np.int32)
    levels = np.zeros(TILE_SLOTS, np.uint8)
    twins = levels_of(last, 0, word, 255.0 / 9, levels)
    places = sorted(slots)
    equal = [
        [levels[earlier] == levels[later] and earlier // 16 == later // 16 for earlier in places[:number]]
        for number, later in enumerate(places)
    ]
    assert twins == sum(map(sum, equal))
    bits = [is_equal for of_later in equal for is_equal in of_later]
    assert pairs_in(levels, word) == sum(1 << number for number, is_equal in enumerate(bits) if is_equal)


@pytest.mark.parametrize("duration_ns", [510, 51_000, 12_345_678, 123_456_789, 1_000_000_007, 2_000_000_000])
def test_levels_are_exact_where_they_begin(duration_ns):
    slope = 255.0 / duration_ns
    # In fewer bits it errs by less than 10 parts of 65536. One event a tile, as any of them may be unsure.
    parts = sorted({round(part * duration_ns / 255 / 65536) for part in range(-10, 11)} | {-1, 0, 1})
    for level in range(255):
        slot = level % TILE_SLOTS
        for off_ns in parts:
            time_ns = min(max(round((level + 0.5) * duration_ns / 255) + off_ns, 0), duration_ns)
            last = np.full(TILE_SLOTS, time_ns, np.int32)
            levels = np.zeros(TILE_SLOTS, np.uint8)
            levels_of(last, 0, 1 << slot, slope, levels)
            assert levels.tolist() == expected_levels(last.tolist(), 1 << slot, slope)


@pytest.mark.parametrize("distance", range(1, 16))
@pytest.mark.parametrize("first", [0, 16])
def test_a_pair_is_one_pair_however_far_apart_it_is(first, distance):
    last = np.arange(TILE_SLOTS, dtype=np.int32)
    for place in range(16 - distance):
        one, other = first + place, first + place + distance
        last[:] = np.arange(TILE_SLOTS)
        last[other] = last[one]
        assert levels_of(last, 0, 2**TILE_SLOTS - 1, 7.0, np.zeros(TILE_SLOTS, np.uint8)) == 1


@given(st.lists(st.integers(0, 3), min_size=TILE_SLOTS, max_size=TILE_SLOTS), st.integers(0, 3))
@settings(deadline=None)
def test_each_slot_of_a_level_has_its_bit(levels, level):
    wanted = sum(1 << slot for slot, found in enumerate(levels) if found == level)
    assert with_level(np.array(levels, np.uint8), level) == wanted


def test_equal_levels_of_both_channels_are_no_pair():
    last = np.tile(np.arange(16, dtype=np.int32), 2)
    assert levels_of(last, 0, 2**TILE_SLOTS - 1, 7.0, np.zeros(TILE_SLOTS, np.uint8)) == 0


def test_a_tile_is_written_row_by_row_with_the_channels_beside_each_other_and_nothing_else_is():
    levels = np.arange(1, TILE_SLOTS + 1, dtype=np.uint8)
    data = np.zeros((6, 7, 2), np.uint8)
    write(levels, data.reshape(-1), (1 * 7 + 2) * 2, 7 * 2)
    wanted = np.zeros_like(data)
    wanted[1:5, 2:6] = levels.reshape(2, 4, 4).transpose(1, 2, 0)
    np.testing.assert_array_equal(data, wanted)


@given(st.sets(st.integers(0, GROUP_TILES - 1)), st.sampled_from([0, 1, 64]))
@settings(deadline=None)
def test_each_tile_of_a_group_with_events_has_its_bit(tiles, first):
    words = np.zeros(2 * GROUP_TILES, np.uint32)
    words[[first + tile for tile in tiles]] = 1 << 31
    assert with_events(words, first) == sum(1 << tile for tile in tiles)


SENSORS = [(240, 180), (346, 260), (5, 3), (70, 50), (1, 1)]


@pytest.mark.parametrize("cell_size", [2, 3, 4, 5, 8, 9])
@pytest.mark.parametrize(("width", "height"), SENSORS)
def test_the_arrays_of_a_map_fill_its_memory_and_do_not_overlap(width, height, cell_size):
    store = make_cell_map(width, height, cell_size, 256.0)
    arrays = [array for array in cells_in(store) if isinstance(array, np.ndarray)]
    first = store.ctypes.data
    spans = sorted((array.ctypes.data - first, array.nbytes) for array in arrays)
    ends = [start + size for start, size in spans]
    assert all(end <= start for end, (start, _) in zip(ends, spans[1:], strict=False))
    assert 0 <= store.nbytes - ends[-1] < 8
    cells = cells_in(store)
    tiles = len(cells.is_counted) << cells.tile_shift
    assert (len(cells.words), len(cells.last), len(cells.gains)) == (tiles, TILE_SLOTS * tiles, cell_size**2 + 1)
    assert GROUP_TILES * (len(cells.sample) - 1) < tiles <= GROUP_TILES * len(cells.sample)


@pytest.mark.parametrize(("width", "height"), SENSORS)
def test_behind_the_words_of_the_tiles_is_room_for_a_whole_group(width, height):
    store = make_cell_map(width, height, 4, 256.0)
    cells = cells_in(store)
    behind = cells.slots.ctypes.data - cells.words.ctypes.data
    assert behind == 4 * GROUP_TILES * len(cells.sample)


@pytest.mark.parametrize("cell_size", [2, 3, 4, 5, 8, 9])
@pytest.mark.parametrize(("width", "height"), SENSORS)
def test_a_tile_is_partial_unless_all_of_its_pixels_are_its_own(width, height, cell_size):
    cells = cells_in(make_cell_map(width, height, cell_size, 256.0))
    owned = np.zeros(len(cells.words), int)
    slots = cells.row_slot[:, None] + cells.column_slot[None, :]
    np.add.at(owned, slots.ravel() // TILE_SLOTS, 1)
    assert (cells.tile_byte[owned > 0] >= PARTIAL).tolist() == (owned[owned > 0] < TILE_SIDE**2).tolist()
    whole = cells.tile_byte[owned == TILE_SIDE**2].astype(int)
    assert (whole + 3 * 2 * width + 8 <= 2 * width * height).all()
