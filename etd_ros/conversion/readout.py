"""The grey levels of the unfinished frame out of the cell map, and what its entropy loses by those that are equal."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from etd_ros.borrowing_kernel import kernel_part
from etd_ros.conversion.bits import count_bits, lowest_bit
from etd_ros.conversion.cell_map import CHANNEL_SLOTS, GROUP_TILES, PARTIAL, TILE_SIDE, CellMap
from etd_ros.conversion.frame_buffers import written_from
from etd_ros.conversion.tile_tables import FEW_EVENTS, tile_tables
from etd_ros.conversion.tiles import clear_row, fetch_tile, slots_of_level, tile_levels, tiles_with_events, write_tile
from etd_ros.conversion.twins import pairs_of_few

FEW_TWINS = 2
"""So many pairs of pixels of one level are two pixels each; three may be three pixels."""

HALF_UP = 0.5 + 1e-10
"""Rounds halves up: above the rounding errors (1e-13) and below the distance of other levels from a half (1 / 4e9)."""

TILES_AHEAD = 48
"""How far ahead a full frame's times are fetched: they are in no near memory, and all of them are needed."""

ON, OFF = 1, 2

_U32, _U64 = np.uint32, np.uint64

_ON_SLOTS = _U32(0xFFFF)


@kernel_part
def read_levels(
    cells: CellMap, duration_ns: int, of_sample: bool, is_full: bool, data: npt.NDArray[np.uint8]
) -> tuple[float, int]:
    """Write the levels of the pixels with events, or look at those of the sample without writing them.

    A level is max(1, round(255 * since_start / duration)), halves up, and 255 in a frame of no duration. If the frame
    is full, cells are expected to hold few levels, each of many pixels.

    Returns:
        What the channels' entropies lose against distinct levels, and the number of cells with events, but without
        entropy; both over the cells that count.
    """
    words, levels, is_counted = cells.words, cells.levels, cells.is_counted
    slope, offset = (255.0 / duration_ns, HALF_UP) if duration_ns > 0 else (0.0, 255.0)
    row_bytes = _U64(2 * len(cells.column_slot))
    pairs_max = FEW_TWINS if cells.tile_shift == 0 else -1
    # Fewer than the pixels of a channel: these cells have entropy.
    few_events = min(FEW_EVENTS, len(cells.loss) - 2)
    cells.seen[:] = 0
    tables = tile_tables()
    level_bytes = row_bytes * _U64(len(cells.row_slot))
    written = data[written_from(int(level_bytes)) :].view(np.uint64)
    if not of_sample:
        _clear_partial_tiles(cells, data, row_bytes, written)
    pairs, lost, without_entropy = np.int64(0), 0.0, 0
    for k in range(_U64(len(cells.sample))):
        first = k * _U64(GROUP_TILES)
        group = tiles_with_events(words, first)
        if of_sample:
            group &= cells.sample[k]
        else:
            _clear_old_tiles(cells, data, row_bytes, first, _U64(written[k] & cells.whole[k] & _U64(~group)))
            written[k] = group
        while group:
            tile = first | lowest_bit(group)
            group = _U64(group & _U64(group - _U64(1)))
            twins = np.int64(
                tile_levels(cells.last, tile << _U64(5), words[tile], slope, offset, levels, not is_full, tables)
            )
            if not of_sample:
                byte = _U64(cells.tile_byte[tile])
                if byte < PARTIAL:
                    write_tile(levels, data, byte, row_bytes, tables)
                else:
                    _write_pixels(cells, words[tile], data, byte - _U64(PARTIAL))
            if is_full:
                fetch_tile(cells.last, (tile + _U64(TILES_AHEAD)) << _U64(5))
                loss, without = _lost_by_levels(cells, tile)
                lost += loss
                without_entropy += without
            elif twins <= pairs_max:
                if not cells.is_plain:
                    twins &= -np.int64(is_counted[tile])
                pairs += twins
            elif pairs_max == FEW_TWINS and count_bits(words[tile]) <= few_events:
                lost += _lost_by_pairs(cells, tile, tables)
            else:
                loss, without = _lost_by_twins(cells, tile)
                lost += loss
                without_entropy += without
    return lost + pairs * cells.loss[1], without_entropy


@kernel_part
def _clear_old_tiles(
    cells: CellMap, data: npt.NDArray[np.uint8], row_bytes: np.uint64, first: np.uint64, old: np.uint64
) -> None:
    """Clear tiles of a group that begins with tile `first`, which all have their 4 x 4 pixels."""
    while old:
        byte = _U64(cells.tile_byte[first | lowest_bit(old)])
        old = _U64(old & _U64(old - _U64(1)))
        for _ in range(TILE_SIDE):
            clear_row(data, byte)
            byte += row_bytes


@kernel_part
def _clear_partial_tiles(
    cells: CellMap, data: npt.NDArray[np.uint8], row_bytes: np.uint64, written: npt.NDArray[np.uint64]
) -> None:
    """Clear the tiles that an earlier frame has written into data and that do not have all of their 4 x 4 pixels.

    Others may be cleared with them: all before any is written.
    """
    level_bytes = row_bytes * _U64(len(cells.row_slot))
    for k in range(_U64(len(written))):
        old = _U64(written[k] & _U64(~cells.whole[k]))
        while old:
            byte = _U64(cells.tile_byte[(k * _U64(GROUP_TILES)) | lowest_bit(old)]) & _U64(PARTIAL - 1)
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
    return lost, _is_without_entropy(cells, cell, full)


@kernel_part
def _lost_by_pairs(cells: CellMap, cell: np.uint64, tables: np.uint64) -> float:
    """What the entropies of a cell of one tile and few events lose by levels that come twice or more."""
    if not cells.is_counted[cell]:
        return 0.0
    pairs, lost = pairs_of_few(cells.levels, cells.words[cell], tables), 0.0
    for earlier in range(_U64(1), _U64(FEW_EVENTS)):
        same = _U32(pairs & _U64((_U64(1) << earlier) - _U64(1)))
        lost += cells.loss[count_bits(same)]
        pairs >>= earlier
    return lost


@kernel_part
def _lost_by_levels(cells: CellMap, cell: np.uint64) -> tuple[float, int]:
    """The same of a cell of one tile, level by level instead of pixel by pixel."""
    if not cells.is_counted[cell]:
        return 0.0, 0
    rest, lost = cells.words[cell], 0.0
    while rest:
        same = slots_of_level(cells.levels, cells.levels[_U64(lowest_bit(rest))])
        rest = _U32(rest & _U32(~same))
        on, off = _on_and_off(same)
        lost += cells.shared_loss[on] + cells.shared_loss[off]
    return lost, _is_without_entropy(cells, cell, _full_of_one_level(cells, cell))


@kernel_part
def _full_of_one_level(cells: CellMap, cell: np.uint64) -> int:
    """Which channels of a cell of one tile have an event in each pixel, and one level. Hardly any has the first."""
    cell_pixels = _U64(len(cells.shared_loss) - 1)
    word, full = cells.words[cell], 0
    on, off = _on_and_off(word)
    if on == cell_pixels:
        same = slots_of_level(cells.levels, cells.levels[_U64(lowest_bit(word))])
        full |= ON * int(_on_and_off(same)[0] == cell_pixels)
    if off == cell_pixels:
        off_word = _U32(word & _U32(~_ON_SLOTS))
        same = slots_of_level(cells.levels, cells.levels[_U64(lowest_bit(off_word))])
        full |= OFF * int(_on_and_off(same)[1] == cell_pixels)
    return full


@kernel_part
def _on_and_off(word: np.uint32) -> tuple[np.uint64, np.uint64]:
    """How many of its On and of its Off bits are set."""
    return _U64(count_bits(_U32(word & _ON_SLOTS))), _U64(count_bits(_U32(word >> _U32(CHANNEL_SLOTS))))


@kernel_part
def _is_without_entropy(cells: CellMap, cell: np.uint64, full: int) -> int:
    """1 for a cell whose channels are full of one level each, as `full` says, or empty; else 0."""
    return int(full == (ON | OFF) or (full != 0 and _is_empty(cells, cell, full == OFF)))


@kernel_part
def _is_empty(cells: CellMap, cell: np.uint64, on: bool) -> bool:
    """Whether a cell's channel has no events."""
    channel = _ON_SLOTS if on else _U32(~_ON_SLOTS)
    held = _U32(0)
    for tile in range(cell << _U64(cells.tile_shift), (cell + _U64(1)) << _U64(cells.tile_shift)):
        held = _U32(held | (cells.words[tile] & channel))
    return bool(held == _U32(0))
