"""The kernels of conversion: events into the cell map, a running bound of its NZGE, and the frame out of it.

They stay in one module: the compiler's cache knows only changes of a kernel's own file. Loops over events have no
branches on what comes: the processor cannot predict it. Indices are unsigned: for signed ones the compiler adds a
comparison to each access, as a negative index would count from the end.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.conversion.bits import count_bits, lowest_bit
from etd_ros.conversion.cell_map import ENTROPY_ONE, CellMap

CHECKS_AT_STRIDE = 8
"""Exact checks of a frame at `check_stride` before the distance begins to double."""

SAMPLE_STEP = 8
"""One cell in so many is looked at where the exact value is not worth its time yet."""

SAMPLE_CELLS_MIN = 256
"""Cells with events from which on a sample pays."""

SAMPLE_TRUST = 0.9
"""Share of the sample's loss that is believed, as it may err: rather a check too many than a frame too late."""

MARGIN = 1e-9
"""Above the rounding errors of the bound."""

HALF_UP = 0.5 + 1e-10
"""Rounds halves up: above the rounding errors (1e-13) and below the distance of other levels from a half (1 / 4e9)."""

STATE_DTYPE = np.dtype(
    [
        ("events", "<i8"),
        ("entropy", "<i8"),
        ("touched", "<i8"),
        ("next", "<i8"),
        ("exact_per_bound", "<f8"),
        ("sampled", "?"),
        ("failed", "<i8"),
    ]
)
"""Where an unfinished frame stands.

Its events; over the whole sensor, the sum of the channels' entropies as if all levels were distinct and the number of
cells with events; the number of the event at which to look at NZGE next; NZGE by its bound as last seen, 1 before;
whether a sample has told it; exact checks that found less than alpha.
"""

EMPTY_STATE = (0, 0, 0, 0, 1.0, False, 0)

_U32, _U64 = np.uint32, np.uint64


@njit(cache=True, nogil=True)
def add_events(
    cells: CellMap,
    state: npt.NDArray[np.void],
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    start_ns: int,
) -> None:
    """Add all of these events to the frame that starts at start_ns."""
    row_slot, column_slot = cells.row_slot, cells.column_slot
    last, words, entropy = cells.last, cells.words, cells.entropy
    gained, touched = np.int64(0), _U64(0)
    for i in range(len(t)):
        slot = (row_slot[y[i]] + column_slot[x[i]]) | ((_U32(p[i]) ^ _U32(1)) << _U32(4))
        last[slot] = t[i] - start_ns
        tile = slot >> _U32(5)
        before = words[tile]
        after = _U32(before | (_U32(1) << (slot & _U32(31))))
        words[tile] = after
        channel = _U32(0xFFFF) << (slot & _U32(16))
        touched += _U64(before == _U32(0))
        gained += entropy[count_bits(_U32(after & channel))] - entropy[count_bits(_U32(before & channel))]
    state[0].events += len(t)
    state[0].entropy += gained
    state[0].touched += np.int64(touched)


@njit(cache=True, nogil=True)
def first_after(t: npt.NDArray[np.int64], first: int, limit_ns: int) -> int:
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


@njit(cache=True, nogil=True)
def read_out(cells: CellMap, state: npt.NDArray[np.void], duration_ns: int, data: npt.NDArray[np.uint8]) -> float:
    """Write the grey levels of the pixels with events into the frame's data, flat, and return its exact NZGE."""
    entropy, touched = _sum_entropies(cells, state)
    lost, without_entropy = _write_levels(cells, duration_ns, 1, data)
    not_zero = touched - without_entropy
    return (entropy / ENTROPY_ONE - lost) / 2 / not_zero if not_zero else 0.0


@njit(cache=True, nogil=True)
def _write_levels(cells: CellMap, duration_ns: int, step: int, data: npt.NDArray[np.uint8]) -> tuple[float, int]:
    """Write the levels of every step-th tile's pixels with events.

    A level is max(1, round(255 * since_start / duration)), halves up, and 255 in a frame of no duration.

    Returns:
        What the channels' entropies lose against distinct levels, and the number of cells with events, but without
        entropy; both over the cells that count.
    """
    last, seen, tiles, words = cells.last, cells.seen, cells.touched_tiles, cells.touched_words
    tile_byte, slot_byte, tile_shift = cells.tile_byte, cells.slot_byte, _U64(cells.tile_shift)
    slope, offset = (255.0 / duration_ns, HALF_UP) if duration_ns > 0 else (0.0, 255.0)
    pixels = _list_touched(cells, step)
    # A level has been seen c times in its cell and channel if its mark is the cell's stamp + c.
    seen[:] = 0
    stamp_step = _U32(len(cells.loss))
    lost, without_entropy, uniform_cell = 0.0, 0, np.int64(-1)
    k = _U64(0)
    word, next_word = words[_U64(0)], words[_U64(1)]
    # One loop over all pixels, with the next tile's word at hand when a tile is done.
    for _ in range(pixels):
        slot = _U64(lowest_bit(word))
        tile = _U64(tiles[k])
        cell = tile >> tile_shift
        level = max(np.int32(1), np.int32(last[(tile << _U64(5)) | slot] * slope + offset))
        data[_U64(tile_byte[tile]) + _U64(slot_byte[slot])] = level
        key = ((slot & _U64(16)) << _U64(4)) | _U64(level)
        stamp = _U32(_U32(cell + _U64(1)) * stamp_step)
        mark = seen[key]
        same = _U32(mark - stamp) if mark > stamp else _U32(0)
        seen[key] = _U32(_U32(stamp + same) + _U32(1))
        if same and cells.is_counted[cell]:
            lost += cells.loss[same]
            if same + _U32(2) == stamp_step:
                # A channel full of one level: the cell has no entropy if the other one is so too, or empty.
                is_on = slot < _U64(16)
                other_is_uniform = uniform_cell == np.int64(cell)
                without_entropy += int(other_is_uniform or _is_empty(cells, cell, not is_on))
                uniform_cell = np.int64(cell)
        word = _U32(word & _U32(word - _U32(1)))
        done = _U64(word == _U32(0))
        word = _U32(word | (next_word & _U32(-np.int64(done))))
        k += done
        next_word = words[k + _U64(1)]
    return lost, without_entropy


@njit(cache=True, nogil=True)
def _list_touched(cells: CellMap, step: int) -> np.int64:
    """Put every step-th tile that has events, and its word, into the map's scratch; return its pixels with events."""
    tiles, touched_words = cells.touched_tiles, cells.touched_words
    n, pixels = _U64(0), np.int64(0)
    for tile in range(0, len(cells.words), step):
        word = cells.words[tile]
        tiles[n] = tile
        touched_words[n] = word
        n += _U64(word != _U32(0))
        pixels += np.int64(count_bits(word))
    tiles[n] = 0
    touched_words[n] = 0
    touched_words[n + _U64(1)] = 0
    return pixels


@njit(cache=True, nogil=True)
def _is_empty(cells: CellMap, cell: np.uint64, on: bool) -> bool:
    """Whether a cell's channel has no events."""
    channel = _U32(0xFFFF) if on else _U32(0xFFFF0000)
    held = _U32(0)
    for tile in range(cell << _U64(cells.tile_shift), (cell + _U64(1)) << _U64(cells.tile_shift)):
        held = _U32(held | (cells.words[tile] & channel))
    return bool(held == _U32(0))


@njit(cache=True, nogil=True)
def _sum_entropies(cells: CellMap, state: npt.NDArray[np.void]) -> tuple[np.int64, int]:
    """Over the cells that count: the channels' entropies as if all levels were distinct, and the cells with events.

    Where all cells count and have one tile each, the running sums are these.
    """
    if len(cells.counted) == len(cells.words):
        return state[0].entropy, state[0].touched
    entropy, touched = np.int64(0), 0
    for index in cells.counted:
        cell = _U64(index)
        on, off = _U32(0), _U32(0)
        for tile in range(cell << _U64(cells.tile_shift), (cell + _U64(1)) << _U64(cells.tile_shift)):
            on = _U32(on + count_bits(_U32(cells.words[tile] & _U32(0xFFFF))))
            off = _U32(off + count_bits(_U32(cells.words[tile] >> _U32(16))))
        entropy += cells.entropy[on] + cells.entropy[off]
        touched += (on | off) != 0
    return entropy, touched


@njit(cache=True, nogil=True)
def advance(
    cells: CellMap,
    state: npt.NDArray[np.void],
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    first: int,
    start_ns: int,
    limit_ns: int,
    alpha: float,
    check_stride: int,
    data: npt.NDArray[np.uint8],
) -> tuple[int, float]:
    """Add events to the frame until it reaches alpha, one comes after limit_ns, or the batch is over.

    Returns:
        The index of the first event not added, and the NZGE that reached alpha (the frame is in data then), or 0.
    """
    stop = first_after(t, first, limit_ns)
    i = first
    if state[0].events == 0:
        state[0].next = check_stride
    while True:
        part = min(stop, i + state[0].next - state[0].events)
        add_events(cells, state, t[i:part], x[i:part], y[i:part], p[i:part], start_ns)
        i = part
        if state[0].events < state[0].next:
            return i, 0.0
        strides = 1
        duration_ns = t[i - 1] - start_ns
        if duration_ns > 0:
            strides = _strides_below(cells, state, alpha, check_stride, duration_ns, data)
        if strides == 0:
            nzge = read_out(cells, state, duration_ns, data)
            if nzge >= alpha:
                return i, nzge
            strides = _fail(cells, state, nzge)
        state[0].next += strides * check_stride


@njit(cache=True, nogil=True)
def _strides_below(
    cells: CellMap,
    state: npt.NDArray[np.void],
    alpha: float,
    check_stride: int,
    duration_ns: int,
    data: npt.NDArray[np.uint8],
) -> int:
    """For how many strides from now NZGE will hardly reach alpha; 0 if it may have reached it."""
    entropy, touched = _sum_entropies(cells, state)
    wanted = 2 * touched * alpha * ENTROPY_ONE * (1 - MARGIN)
    if touched and not state[0].sampled and entropy >= wanted and touched >= SAMPLE_CELLS_MIN:
        lost, _ = _write_levels(cells, duration_ns, SAMPLE_STEP, data)
        lost *= SAMPLE_TRUST * SAMPLE_STEP * ENTROPY_ONE
        state[0].exact_per_bound = 1 - lost / entropy
        state[0].sampled = True
    missing = wanted - entropy * state[0].exact_per_bound
    if touched and missing <= 0:
        return 0
    # No event adds more than the first one of a channel.
    return max(1, int(missing / (cells.entropy[1] * check_stride)))


@njit(cache=True, nogil=True)
def _fail(cells: CellMap, state: npt.NDArray[np.void], nzge: float) -> int:
    """Note an exact check that found less than alpha; strides to the next one."""
    entropy, touched = _sum_entropies(cells, state)
    state[0].exact_per_bound = nzge * 2 * touched * ENTROPY_ONE / entropy
    state[0].failed += 1
    return 1 << min(max(int(state[0].failed) - CHECKS_AT_STRIDE, 0), 30)
