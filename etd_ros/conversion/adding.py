"""Events into the cell map, with what they add to the running sums of its entropy.

Loops over events have no branches on what comes: the processor cannot predict it. Indices are unsigned: for signed ones
the compiler adds a comparison to each access, as a negative index would count from the end.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from etd_ros.borrowing_kernel import kernel_part
from etd_ros.conversion.batches import fit
from etd_ros.conversion.bits import count_bits
from etd_ros.conversion.cell_map import LANES, CellMap
from etd_ros.conversion.marks import mark_events
from etd_ros.conversion.slots import fetch_events, find_slots

MARKED_EVENTS = 64
"""Events whose bits are set before their times are written: processors write in order, so that a bit, which is near,
would wait for each time, which is not; meanwhile the times' places are fetched."""

EVENTS_AHEAD = 512
"""How far ahead events are fetched: a batch that is read once from a memory that is far is waited for otherwise."""

_U32, _U64 = np.uint32, np.uint64


@kernel_part
def begin_block(
    cells: CellMap,
    state: npt.NDArray[np.void],
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    first: int,
    stop: int,
) -> bool:
    """Verify a block of events and find their slots; whether they fit.

    Block by block, as what a block is read for once is near for all that follows.
    """
    if not fit(t, x, y, p, first, stop, len(cells.column_slot), len(cells.row_slot)):
        return False
    state[0].previous_ns = t[stop - 1]
    state[0].block_first, state[0].block_stop = first, stop
    _find_slots(cells, x, y, p, _U64(first), _U64(stop - first))
    return True


@kernel_part
def add_events(
    cells: CellMap,
    state: npt.NDArray[np.void],
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    first: int,
    stop: int,
    start_ns: int,
    block_first: int,
) -> None:
    """Add events first .. stop - 1 to the frame that starts at start_ns.

    Args:
        cells: the map.
        state: where the frame stands.
        t: the batch; ns.
        x: pixels.
        y: pixels.
        p: 1 On, 0 Off.
        first: event.
        stop: event.
        start_ns: T_{i-1}.
        block_first: first event of the block that has been begun, which holds all of these.
    """
    state[0].events += stop - first
    slots = _U64(first - block_first), _U64(stop - block_first)
    if cells.is_plain:
        _mark_slots(cells, state, t, x, y, p, *slots, _U64(block_first), start_ns)
    else:
        _mark_and_count_slots(cells, state, t, *slots, _U64(block_first), start_ns)


@kernel_part
def _find_slots(
    cells: CellMap,
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    first: np.uint64,
    number: np.uint64,
) -> None:
    """Put the slots of events first .. first + number - 1 into `slots`."""
    done = _U64(0)
    if cells.columns > 0:
        done = number - number % _U64(LANES)
        find_slots(x, y, p, first, done, _U32(cells.columns), cells.slots)
    for k in range(done, number):
        on_slot = cells.row_slot[y[first + k]] + cells.column_slot[x[first + k]]
        cells.slots[k] = on_slot | ((_U32(p[first + k]) ^ _U32(1)) << _U32(4))


@kernel_part
def _mark_slots(
    cells: CellMap,
    state: npt.NDArray[np.void],
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    first: np.uint64,
    stop: np.uint64,
    block_first: np.uint64,
    start_ns: int,
) -> None:
    """Note the times of the events whose slots are slots[first] .. slots[stop - 1], that of slots[k] being event
    block_first + k; set their bits, and add what they bring to the running sums.

    Meanwhile events further on are fetched, bit by bit: all of a block's at once would be waited for.
    """
    slots, last, words, gains = cells.slots, cells.last, cells.words, cells.gains
    gained, counted = np.int64(0), np.int64(0)
    whole_stop = stop - (stop - first) % _U64(LANES)
    while first < whole_stop:
        part_stop = min(whole_stop, first + _U64(MARKED_EVENTS))
        ahead = block_first + first + _U64(EVENTS_AHEAD)
        if ahead < _U64(len(t)):
            fetch_events(t, x, y, p, ahead)
        more_gained, more_counted = mark_events(slots, words, last, first, part_stop, cells.gains_high, cells.gains_low)
        gained += more_gained
        counted += more_counted
        for k in range(first, part_stop):
            last[slots[k]] = t[block_first + k] - start_ns
        first = part_stop
    for k in range(first, stop):
        slot = slots[k]
        last[slot] = t[block_first + k] - start_ns
        tile = slot >> _U32(5)
        before = words[tile]
        bit = _U32(1) << (slot & _U32(31))
        words[tile] = before | bit
        in_channel = _U32(before & _U32(_U32(0xFFFF) << (slot & _U32(16))))
        gained += gains[count_bits(in_channel)] & -int(_U32(before & bit) == _U32(0))
        counted += int(before == _U32(0))
    state[0].entropy += gained
    state[0].counted += counted


@kernel_part
def _mark_and_count_slots(
    cells: CellMap,
    state: npt.NDArray[np.void],
    t: npt.NDArray[np.int64],
    first: np.uint64,
    stop: np.uint64,
    block_first: np.uint64,
    start_ns: int,
) -> None:
    """The same where some cells do not count, or a cell has several tiles."""
    slots, last, words, gains = cells.slots, cells.last, cells.words, cells.gains
    counts, is_counted = cells.counts, cells.is_counted
    gained, counted = np.int64(0), np.int64(0)
    for k in range(first, stop):
        slot = slots[k]
        last[slot] = t[block_first + k] - start_ns
        tile = slot >> _U32(5)
        before = words[tile]
        after = _U32(before | (_U32(1) << (slot & _U32(31))))
        words[tile] = after
        is_new = _U32(after != before)
        cell = tile >> _U64(cells.tile_shift)
        channel = (cell << _U64(1)) | ((slot >> _U32(4)) & _U32(1))
        count = counts[channel]
        counted_new = np.int64(is_new) & np.int64(is_counted[cell])
        gained += gains[count] & -counted_new
        counted += counted_new & np.int64((count | counts[channel ^ _U64(1)]) == 0)
        counts[channel] = count + is_new
    state[0].entropy += gained
    state[0].counted += counted
