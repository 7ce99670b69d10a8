"""The kernels of conversion: events into the cell map, a running bound of its NZGE, and the frame out of it.

They stay in one module: the compiler's cache knows only changes of a kernel's own file, and, by the state's type, of
what else `advance` and `finish` are made of. Loops over events have no branches on what comes: the processor cannot
predict it. Indices are unsigned: for signed ones the compiler adds a comparison to each access, as a negative index
would count from the end.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from etd_ros.borrowing_kernel import borrowing_kernel, kernel_part
from etd_ros.conversion.bits import count_bits, lowest_bit
from etd_ros.conversion.cell_map import (
    GROUP_TILES,
    LANES,
    PARTIAL,
    TILE_SIDE,
    CellMap,
    CellStore,
    borrowed_cells,
    source_digest,
)
from etd_ros.conversion.frame_buffers import written_from
from etd_ros.conversion.marks import mark_events
from etd_ros.conversion.tiles import clear_row, tile_levels, tiles_with_events, write_tile

CHECKS_AT_STRIDE = 8
"""Exact checks of a frame at `check_stride` before the distance begins to double."""

GROWTH_MAX = 8
"""Where NZGE may have reached alpha, a frame does not grow by more than one in so many of its events without a look."""

SAMPLE_CELLS_MIN = 256
"""Cells with events from which on a sample pays."""

SAMPLE_TRUST = 0.9
"""Share of the sample's loss that is believed, as it may err: rather a check too many than a frame too late."""

SAMPLE_PAIRS_MIN, PATIENCE = 25, 128
"""A sample that has lost as much as so many pairs of equal levels errs by about a fifth (one over the root of their
number) where they are strewn. From then on a frame waits until NZGE has most likely reached alpha, but not for more
than one in so many of its events, or a stride: a check of all its cells that fails costs more than that.
"""

FEW_TWINS = 2
"""So many pairs of pixels of one level are two pixels each; three may be three pixels."""

NO_CHECKS = 2**62
"""A `check_stride` that no frame reaches."""

MARGIN = 1e-9
"""Above the rounding errors of the bound."""

HALF_UP = 0.5 + 1e-10
"""Rounds halves up: above the rounding errors (1e-13) and below the distance of other levels from a half (1 / 4e9)."""

STATE_DTYPE = np.dtype(
    [
        ("events", "<i8"),
        ("counted", "<i8"),
        ("entropy", "<i8"),
        ("next", "<i8"),
        ("looked", "<i8"),
        ("near", "<i8"),
        ("lost", "<f8"),
        ("unsure", "<f8"),
        ("without_entropy", "<f8"),
        ("failed", "<i8"),
        (f"made_by_{source_digest()}", "<i8"),
    ]
)
"""Where an unfinished frame stands.

Its events; of the cells that count, those with events, and the sum of their channels' entropies as if all levels were
distinct; the number of the event at which to look at NZGE next. At the last look at levels, a sample or an exact
check: its event (0: none yet), what the sum had lost, how much more it may have lost (`unsure`), and the cells that had
events but no entropy. From which event on NZGE may have reached alpha (`near`, 0: it has not yet). Exact checks that
found less than alpha. The last field is empty (`source_digest`).
"""

EMPTY_STATE = (0, 0, 0, 0, 0, 0, 0.0, 0.0, 0.0, 0, 0)

ON, OFF = 1, 2

_U32, _U64 = np.uint32, np.uint64


@kernel_part
def _add_events(
    cells: CellMap,
    state: npt.NDArray[np.void],
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    first: int,
    stop: int,
    start_ns: int,
) -> None:
    """Add events first .. stop - 1 to the frame that starts at start_ns.

    In blocks, whose slots are found first, in loops that the compiler vectorises.
    """
    state[0].events += stop - first
    while first < stop:
        number = min(stop - first, len(cells.slots))
        if cells.columns > 0:
            _compute_slots(cells, x, y, p, _U64(first), _U64(number))
        else:
            _look_up_slots(cells, x, y, p, _U64(first), _U64(number))
        if cells.is_plain:
            _mark_slots(cells, state, t, _U64(first), _U64(number), start_ns)
        else:
            _mark_and_count_slots(cells, state, t, _U64(first), _U64(number), start_ns)
        first += number


@kernel_part
def _compute_slots(
    cells: CellMap,
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    first: np.uint64,
    number: np.uint64,
) -> None:
    """The slots of events where a cell is one tile of 4 x 4 pixels; all in 32 bits, the compiler's widest loops."""
    cell_columns = _U32(cells.columns)
    for k in range(number):
        column, row = _U32(x[first + k]), _U32(y[first + k])
        cell = _U32(_U32(_U32(row >> _U32(2)) * cell_columns) + _U32(column >> _U32(2)))
        place = _U32(_U32(_U32(row & _U32(3)) << _U32(2)) | _U32(column & _U32(3)))
        off = _U32(_U32(_U32(p[first + k]) ^ _U32(1)) << _U32(4))
        cells.slots[k] = _U32(_U32(_U32(cell << _U32(5)) | place) | off)


@kernel_part
def _look_up_slots(
    cells: CellMap,
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    first: np.uint64,
    number: np.uint64,
) -> None:
    for k in range(number):
        on_slot = cells.row_slot[y[first + k]] + cells.column_slot[x[first + k]]
        cells.slots[k] = on_slot | ((_U32(p[first + k]) ^ _U32(1)) << _U32(4))


@kernel_part
def _mark_slots(
    cells: CellMap,
    state: npt.NDArray[np.void],
    t: npt.NDArray[np.int64],
    first: np.uint64,
    number: np.uint64,
    start_ns: int,
) -> None:
    """Note the times of the events in `slots`, set their bits, and add what they bring to the running sums."""
    slots, last, words, gains = cells.slots, cells.last, cells.words, cells.gains
    whole = number - number % _U64(LANES)
    gained, counted = mark_events(slots, last, words, t, first, whole, start_ns, cells.gains_high, cells.gains_low)
    for k in range(whole, number):
        slot = slots[k]
        last[slot] = t[first + _U64(k)] - start_ns
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
    number: np.uint64,
    start_ns: int,
) -> None:
    """The same where some cells do not count, or a cell has several tiles."""
    slots, last, words, gains = cells.slots, cells.last, cells.words, cells.gains
    counts, is_counted = cells.counts, cells.is_counted
    gained, counted = np.int64(0), np.int64(0)
    for k in range(number):
        slot = slots[k]
        last[slot] = t[first + k] - start_ns
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


@kernel_part
def _first_after(t: npt.NDArray[np.int64], first: int, limit_ns: int) -> int:
    """Index of the first event from `first` on that comes after limit_ns."""
    low, high = first, len(t)
    if low < high and t[high - 1] <= limit_ns:
        return high
    while low < high:
        middle = (low + high) // 2
        if t[middle] <= limit_ns:
            low = middle + 1
        else:
            high = middle
    return low


@borrowing_kernel
def finish(
    store: CellStore, state: npt.NDArray[np.void], duration_ns: int, data: npt.NDArray[np.uint8]
) -> tuple[float, int]:
    """End the frame: write it into data, flat, and begin the next one; its exact NZGE and its number of events."""
    cells = borrowed_cells(store)
    nzge = _read_out(cells, state, duration_ns, data)
    events = state[0].events
    _clear(cells, state)
    return nzge, events


@kernel_part
def _read_out(cells: CellMap, state: npt.NDArray[np.void], duration_ns: int, data: npt.NDArray[np.uint8]) -> float:
    """Write the grey levels of the pixels with events into the frame's data, and return its exact NZGE."""
    lost, without_entropy = _read_levels(cells, duration_ns, False, data)
    state[0].looked = state[0].events
    state[0].lost = lost * cells.entropy_one
    state[0].unsure = 0.0
    state[0].without_entropy = without_entropy
    not_zero = state[0].counted - without_entropy
    return (state[0].entropy / cells.entropy_one - lost) / 2 / not_zero if not_zero else 0.0


@kernel_part
def _look_at_sample(cells: CellMap, state: npt.NDArray[np.void], duration_ns: int, data: npt.NDArray[np.uint8]) -> None:
    """Note what a sample of the cells has lost."""
    lost, without_entropy = _read_levels(cells, duration_ns, True, data)
    scale = SAMPLE_TRUST * cells.sample_scale
    state[0].looked = state[0].events
    state[0].lost = lost * scale * cells.entropy_one
    lost_pairs = lost / cells.loss[1]
    if lost_pairs >= SAMPLE_PAIRS_MIN:
        state[0].unsure = (1 + 1 / np.sqrt(lost_pairs) - SAMPLE_TRUST) / SAMPLE_TRUST * state[0].lost
    state[0].without_entropy = without_entropy * scale


@kernel_part
def _read_levels(cells: CellMap, duration_ns: int, of_sample: bool, data: npt.NDArray[np.uint8]) -> tuple[float, int]:
    """Write the levels of the pixels with events, or look at those of the sample without writing them.

    A level is max(1, round(255 * since_start / duration)), halves up, and 255 in a frame of no duration.

    Returns:
        What the channels' entropies lose against distinct levels, and the number of cells with events, but without
        entropy; both over the cells that count.
    """
    words, levels, is_counted = cells.words, cells.levels, cells.is_counted
    slope, offset = (255.0 / duration_ns, HALF_UP) if duration_ns > 0 else (0.0, 255.0)
    row_bytes = _U64(2 * len(cells.column_slot))
    pairs_max = FEW_TWINS if cells.tile_shift == 0 else -1
    cells.seen[:] = 0
    if not of_sample:
        _clear_old_tiles(cells, data, row_bytes)
    pairs, lost, without_entropy = np.int64(0), 0.0, 0
    for k in range(_U64(len(cells.sample))):
        first = k * _U64(GROUP_TILES)
        group = tiles_with_events(words, first)
        if of_sample:
            group &= cells.sample[k]
        while group:
            tile = first | lowest_bit(group)
            group = _U64(group & _U64(group - _U64(1)))
            twins = np.int64(tile_levels(cells.last, tile << _U64(5), words[tile], slope, offset, levels))
            if not of_sample:
                byte = _U64(cells.tile_byte[tile])
                if byte < PARTIAL:
                    write_tile(levels, data, byte, row_bytes)
                else:
                    _write_pixels(cells, words[tile], data, byte - _U64(PARTIAL))
            if twins <= pairs_max:
                pairs += twins & -np.int64(is_counted[tile])
            else:
                loss, without = _lost_by_twins(cells, tile)
                lost += loss
                without_entropy += without
    return lost + pairs * cells.loss[1], without_entropy


@kernel_part
def _clear_old_tiles(cells: CellMap, data: npt.NDArray[np.uint8], row_bytes: np.uint64) -> None:
    """Clear the tiles that an earlier frame has written into data and this one will not, or not all of; note those that
    it will.

    Of a tile that does not have all of its 4 x 4 pixels, others may be cleared with it: all before any is written.
    """
    level_bytes = row_bytes * _U64(len(cells.row_slot))
    written = data[written_from(int(level_bytes)) :].view(np.uint64)
    for k in range(_U64(len(written))):
        first = k * _U64(GROUP_TILES)
        group = tiles_with_events(cells.words, first)
        old = _U64(written[k] & _U64(~_U64(group & cells.whole[k])))
        written[k] = group
        while old:
            byte = _U64(cells.tile_byte[first | lowest_bit(old)]) & _U64(PARTIAL - 1)
            old = _U64(old & _U64(old - _U64(1)))
            for _ in range(TILE_SIDE):
                if byte < level_bytes:
                    clear_row(data, byte)
                byte += row_bytes


@kernel_part
def _write_pixels(cells: CellMap, word: np.uint32, data: npt.NDArray[np.uint8], byte: np.uint64) -> None:
    """Write the levels of a tile that does not have all of its 4 x 4 pixels."""
    while word:
        place = _U64(lowest_bit(word))
        data[byte + _U64(cells.slot_byte[place])] = cells.levels[place]
        word = _U32(word & _U32(word - _U32(1)))


@kernel_part
def _lost_by_twins(cells: CellMap, tile: np.uint64) -> tuple[float, int]:
    """What the entropies of a tile's channels lose by levels that come twice or more, and whether the tile, its cell's
    last one, completes a cell that has events but no entropy: its channels are full of one level, or empty.

    The tiles of a cell have to come one after the other. A level has been seen c times in its cell and channel if its
    mark is the cell's stamp + c; stamps only grow.
    """
    cell, word = tile >> _U64(cells.tile_shift), cells.words[tile]
    if not cells.is_counted[cell]:
        return 0.0, 0
    stamp = _U32(_U32(cell + _U64(1)) * _U32(len(cells.loss)))
    lost, full = 0.0, 0
    while word:
        place = _U64(lowest_bit(word))
        key = ((place & _U64(16)) << _U64(4)) | _U64(cells.levels[place])
        mark = cells.seen[key]
        same = _U32(mark - stamp) if mark > stamp else _U32(0)
        cells.seen[key] = _U32(_U32(stamp + same) + _U32(1))
        if same:
            lost += cells.loss[same]
            if same + _U32(2) == len(cells.loss):
                full |= OFF if place >= _U64(16) else ON
        word = _U32(word & _U32(word - _U32(1)))
    return lost, int(full == (ON | OFF) or (full != 0 and _is_empty(cells, cell, full == OFF)))


@kernel_part
def _clear(cells: CellMap, state: npt.NDArray[np.void]) -> None:
    """Forget the frame's events."""
    cells.words[:] = 0
    if not cells.is_plain:
        cells.counts[:] = 0
    state[0].events = 0
    state[0].counted = 0
    state[0].entropy = 0
    state[0].looked = 0
    state[0].near = 0
    state[0].lost = 0.0
    state[0].unsure = 0.0
    state[0].without_entropy = 0.0
    state[0].failed = 0


@kernel_part
def _is_empty(cells: CellMap, cell: np.uint64, on: bool) -> bool:
    """Whether a cell's channel has no events."""
    channel = _U32(0xFFFF) if on else _U32(0xFFFF0000)
    held = _U32(0)
    for tile in range(cell << _U64(cells.tile_shift), (cell + _U64(1)) << _U64(cells.tile_shift)):
        held = _U32(held | (cells.words[tile] & channel))
    return bool(held == _U32(0))


@borrowing_kernel
def advance(
    store: CellStore,
    state: npt.NDArray[np.void],
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    first: int,
    start_ns: int,
    earliest_ns: int,
    limit_ns: int,
    alpha: float,
    check_stride: int,
    data: npt.NDArray[np.uint8],
) -> tuple[int, float, int]:
    """Add events to the frame until it reaches alpha at earliest_ns or later, one comes after limit_ns, or the batch is
    over.

    Returns:
        The index of the first event not added; the NZGE that reached alpha and the number of the frame's events (the
        frame is in data then, and the next one has begun), or 0 and 0.
    """
    cells = borrowed_cells(store)
    stop = _first_after(t, first, limit_ns)
    i = first
    if state[0].events == 0:
        state[0].next = check_stride
    while True:
        part = min(stop, i + state[0].next - state[0].events)
        _add_events(cells, state, t, x, y, p, i, part, start_ns)
        i = part
        if state[0].events < state[0].next:
            return i, 0.0, 0
        strides = 1
        duration_ns = t[i - 1] - start_ns
        if t[i - 1] < earliest_ns:
            # To the first check that may succeed, or the batch's end.
            strides = 1 + (_first_after(t, i, earliest_ns - 1) - i) // check_stride
        elif duration_ns > 0:
            strides = _strides_below(cells, state, alpha, check_stride, duration_ns, data)
        if strides == 0:
            nzge = _read_out(cells, state, duration_ns, data)
            if nzge >= alpha:
                events = state[0].events
                _clear(cells, state)
                return i, nzge, events
            strides = _fail(state, check_stride)
        state[0].next += strides * check_stride


@kernel_part
def _strides_below(
    cells: CellMap,
    state: npt.NDArray[np.void],
    alpha: float,
    check_stride: int,
    duration_ns: int,
    data: npt.NDArray[np.uint8],
) -> int:
    """For how many strides from now NZGE cannot or will hardly reach alpha; 0 if it may have reached it."""
    if state[0].counted == 0:
        return 1
    # No event adds more than the first one of a channel.
    gain_max = cells.gains[0] * check_stride
    per_cell = 2 * alpha * cells.entropy_one * (1 - MARGIN)
    missing = state[0].counted * per_cell - state[0].entropy
    # A cell without entropy would raise the mean by leaving it, if it adds less than the mean; it has a full channel.
    is_bound = per_cell <= cells.entropy_full
    if is_bound and missing > 0:
        return max(1, int(missing / gain_max))
    if state[0].looked == 0:
        if state[0].counted < SAMPLE_CELLS_MIN:
            return 0
        _look_at_sample(cells, state, duration_ns, data)
    missing = (state[0].counted - state[0].without_entropy) * per_cell - (state[0].entropy - state[0].lost)
    room = state[0].looked + state[0].looked // GROWTH_MAX - state[0].events
    if missing <= 0:
        if state[0].near == 0:
            state[0].near = state[0].events
        missing += state[0].unsure
        room = min(room, state[0].near + state[0].near // PATIENCE - state[0].events)
    if missing <= 0 or room <= 0:
        return 0
    return max(1, int(min(missing / gain_max, room / check_stride)))


@kernel_part
def _fail(state: npt.NDArray[np.void], check_stride: int) -> int:
    """Note an exact check that found less than alpha; strides to the next one."""
    state[0].failed += 1
    doubled = 1 << min(max(int(state[0].failed) - CHECKS_AT_STRIDE, 0), 30)
    return max(1, min(doubled, int(state[0].events) // (GROWTH_MAX * check_stride)))
