"""The unfinished frame: each pixel's last event and a bit per pixel that has one, stored cell by cell.

A cell of the entropy's grid (r x r pixels) consists of tiles of at most 4 x 4 pixels; a tile has 32 slots in a row, 16
of its On channel and 16 of Off, pixel (row, column) of the tile at 4 row + column:

    last:   | tile 0: 16 On, 16 Off | tile 1 ... |     int32, ns since the frame's start
    words:  | tile 0: 32 bits       | tile 1 ... |     uint32, a bit per slot, lowest first

so that for the paper's r = 4 one word is a whole cell, and what has an event in it is counted and found by bits. Only
slots whose bit is set are valid: a new frame clears the words and leaves the times alone. No bit is ever set for a slot
of no pixel, in tiles that are smaller or beyond the border of a sensor that r does not divide.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from etd_ros.borrowing_kernel import borrowing_kernel, kernel_part, part_of
from etd_ros.boxes import Box
from etd_ros.conversion.nzge import GREY_LEVELS, FloatArray, check_grid, count_log_counts

TILE_SIDE = 4
CHANNEL_SLOTS = TILE_SIDE * TILE_SIDE
TILE_SLOTS = 2 * CHANNEL_SLOTS

DURATION_MAX_NS = 2_000_000_000
"""Longest frame: times since its start are kept in 32 bits."""

BLOCK_EVENTS = 512
"""Events whose slots are found at a time: few enough for these to stay in the processor's nearest memory."""

GROUP_TILES = 64
"""Tiles that are looked at for events at a time."""

LANES = 16
"""Events whose gains the processor looks up at once: as many as the tables have entries."""

LOW_BITS = 20
"""Gains have up to 41 bits and are summed in two parts: those of a block of events fit 32 bits each."""

PARTIAL = 2**31
"""More bytes than a frame has."""

SAMPLE_STEP = 8
"""One cell in so many is in the sample."""

HASH_FACTOR = 2654435761
"""Of the cells' numbers, in 32 bits: strews the sample (Knuth's multiplicative hash)."""


CellStore: TypeAlias = "npt.NDArray[np.int64]"
"""What a cell map lies in, its sizes first: Python hands a kernel one plain array in a tenth of the time of all the
map's arrays, and in a fifth of that of a named tuple."""

CellRectangles: TypeAlias = tuple[tuple[int, int, int, int], ...]
"""Rows from the first to before the second, and columns from the third to before the fourth, in cells."""

SIZES_DTYPE = np.dtype(
    [
        ("height", "<i8"),
        ("width", "<i8"),
        ("cells", "<i8"),
        ("cell_pixels", "<i8"),
        ("tile_shift", "<i8"),
        ("columns", "<i8"),
        ("is_plain", "<i8"),
        ("sample_scale", "<f8"),
        ("entropy_one", "<f8"),
        ("entropy_full", "<i8"),
    ]
)
"""h, w, C, m and the numbers of `CellMap`."""

SIZES_ITEMS = SIZES_DTYPE.itemsize // 8

LINE_ITEMS = 8
"""Items of a store in a line of the processor's near memory. What is read by whole vectors begins with one: a tile's
times are in two lines instead of three, each of which is fetched for itself."""

HEADER_ITEMS = -(-SIZES_ITEMS // LINE_ITEMS) * LINE_ITEMS


def source_digest() -> str:
    """Changes with what kernels are compiled of beside their own file: named in the type of an argument, it keeps those
    out of the cache's answers that were compiled with other sources."""
    names = (
        "adding.py",
        "batches.py",
        "bits.py",
        "cell_map.py",
        "extremes.py",
        "frame_buffers.py",
        "marks.py",
        "nzge.py",
        "readout.py",
        "slots.py",
        "tile_tables.py",
        "tiles.py",
        "twins.py",
        "vectors.py",
        "../borrowing_kernel.py",
        "../direct_kernel.py",
    )
    sources = (Path(__file__).parent / name for name in names)
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()[:8]


class CellMap(NamedTuple):
    """Arrays of the unfinished frame; h, w the sensor's size, m = r^2, C the number of cells, T that of tiles.

    Attributes:
        row_slot, column_slot: uint32, (h,) and (w,): a pixel's On slot is row_slot[y] + column_slot[x], its Off slot 16
            further on.
        last: int32, (32 T,): time of the last event since the frame's start (ns), where the slot's bit is set.
        words: uint32, (T,): the bits. Behind the last tile's follow empty ones up to a whole group.
        tile_byte, slot_byte: uint32, (T,) and (32,): a slot's byte in the frame's data is the sum of the two. PARTIAL
            is added to the first where a tile does not have all of its 4 x 4 pixels.
        tile_shift: T = C 2^tile_shift.
        is_counted: uint32, (C,): whether the entropy is measured in a cell.
        is_plain: whether it is in all of them, and each has one tile: then `counts` is not used, as the words tell.
        counts: uint32, (2 C,): pixels with events of a cell's On and Off channel.
        sample, sample_scale: uint64, a bit per tile: those of about one cell in eight that counts, and how many it
            stands for.
        whole: uint64, a bit per tile: those that have all of their 4 x 4 pixels.
        gains: int64, (m + 1,): what the entropy of a channel gains by the next pixel with an event where c have one, of
            distinct levels, in units of 1 / entropy_one: sums of integers do not depend on how they were added up.
        gains_high, gains_low: uint32, (16,): the same in two parts, high 2^LOW_BITS + low; for cells of one tile.
        entropy_full: the entropy of a channel of which all pixels have events, of distinct levels, in the same units.
        loss: float64, (m + 1,): what it loses by the next pixel of a level that c pixels have already.
        shared_loss: float64, (m + 1,): what it loses by c pixels of one level in all.
        columns: cells in a row, 0 where a cell is not a whole tile of 4 x 4 pixels.
        slots: uint32, (512,): scratch for a block of events.
        seen: uint32, (512,), levels: uint8, (32,): scratch of the readout.
    """

    row_slot: npt.NDArray[np.uint32]
    column_slot: npt.NDArray[np.uint32]
    last: npt.NDArray[np.int32]
    words: npt.NDArray[np.uint32]
    tile_byte: npt.NDArray[np.uint32]
    slot_byte: npt.NDArray[np.uint32]
    tile_shift: int
    is_counted: npt.NDArray[np.uint32]
    is_plain: bool
    counts: npt.NDArray[np.uint32]
    sample: npt.NDArray[np.uint64]
    sample_scale: float
    whole: npt.NDArray[np.uint64]
    gains: npt.NDArray[np.int64]
    gains_high: npt.NDArray[np.uint32]
    gains_low: npt.NDArray[np.uint32]
    entropy_one: float
    entropy_full: int
    loss: FloatArray
    shared_loss: FloatArray
    columns: int
    slots: npt.NDArray[np.uint32]
    seen: npt.NDArray[np.uint32]
    levels: npt.NDArray[np.uint8]


def cells_in(store: CellStore) -> CellMap:
    """The map that lies in a store."""
    sizes = store[:SIZES_ITEMS].view(SIZES_DTYPE)[0]
    cells, counts_max = sizes["cells"], sizes["cell_pixels"] + 1
    tiles = cells << sizes["tile_shift"]
    groups = -(-tiles // GROUP_TILES)
    at = HEADER_ITEMS
    last, at = part_of(store, at, TILE_SLOTS * tiles, np.int32), at + TILE_SLOTS * tiles // 2
    words, at = part_of(store, at, tiles, np.uint32), at + GROUP_TILES * groups // 2
    slots, at = part_of(store, at, BLOCK_EVENTS, np.uint32), at + BLOCK_EVENTS // 2
    seen, at = part_of(store, at, 2 * GREY_LEVELS, np.uint32), at + GREY_LEVELS
    gains_high, at = part_of(store, at, LANES, np.uint32), at + LANES // 2
    gains_low, at = part_of(store, at, LANES, np.uint32), at + LANES // 2
    levels, at = part_of(store, at, TILE_SLOTS, np.uint8), at + TILE_SLOTS // 8
    gains, at = part_of(store, at, counts_max, np.int64), at + counts_max
    loss, at = part_of(store, at, counts_max, np.float64), at + counts_max
    shared_loss, at = part_of(store, at, counts_max, np.float64), at + counts_max
    sample, at = part_of(store, at, groups, np.uint64), at + groups
    whole, at = part_of(store, at, groups, np.uint64), at + groups
    narrow = part_of(store, at, 2 * (len(store) - at), np.uint32)
    row_slot, at = part_of(narrow, 0, sizes["height"], np.uint32), sizes["height"]
    column_slot, at = part_of(narrow, at, sizes["width"], np.uint32), at + sizes["width"]
    tile_byte, at = part_of(narrow, at, tiles, np.uint32), at + tiles
    slot_byte, at = part_of(narrow, at, TILE_SLOTS, np.uint32), at + TILE_SLOTS
    is_counted, at = part_of(narrow, at, cells, np.uint32), at + cells
    counts = part_of(narrow, at, 2 * cells, np.uint32)
    return CellMap(
        row_slot, column_slot, last, words, tile_byte, slot_byte, sizes["tile_shift"], is_counted,
        sizes["is_plain"] != 0, counts, sample, sizes["sample_scale"], whole, gains, gains_high, gains_low,
        sizes["entropy_one"], sizes["entropy_full"], loss, shared_loss, sizes["columns"], slots, seen, levels,
    )  # fmt: skip


borrowed_cells = kernel_part(cells_in)
"""`cells_in` for kernels."""


def _empty_store(height: int, width: int, cells: int, tiles: int, counts_max: int) -> CellStore:
    """As much as `cells_in` deals out, from the beginning of a cache line on (a copy of it may begin elsewhere, and is
    as good but for its speed)."""
    groups = -(-tiles // GROUP_TILES)
    bytes_ = 8 * HEADER_ITEMS + 4 * TILE_SLOTS * tiles + 4 * GROUP_TILES * groups
    bytes_ += 4 * BLOCK_EVENTS + 8 * GREY_LEVELS + 8 * LANES + TILE_SLOTS
    bytes_ += 24 * counts_max + 16 * groups
    bytes_ += 4 * (height + width + tiles + TILE_SLOTS + 3 * cells)
    store = np.zeros(-(-bytes_ // 8) + LINE_ITEMS, np.int64)
    first = -store.ctypes.data // 8 % LINE_ITEMS
    return store[first : first + len(store) - LINE_ITEMS]


def _sizes_of(store: CellStore) -> npt.NDArray[np.void]:
    return store[:SIZES_ITEMS].view(SIZES_DTYPE)


def make_cell_map(width: int, height: int, cell_size: int, log_base: float) -> CellStore:
    """An empty map whose cells all count; the sensor's size must have been checked.

    Raises:
        ConversionError: cell_size or log_base out of range.
    """
    check_grid(cell_size, log_base)
    side = 1 << (-(-cell_size // TILE_SIDE) - 1).bit_length()
    rows, columns = -(-height // cell_size), -(-width // cell_size)
    y, x = np.arange(height), np.arange(width)
    tile_row = y // cell_size * columns * side * side + y % cell_size // TILE_SIDE * side
    tile_column = x // cell_size * side * side + x % cell_size // TILE_SIDE
    cell, tile = np.divmod(np.arange(rows * columns * side * side), side * side)
    top = cell // columns * cell_size + tile // side * TILE_SIDE
    left = cell % columns * cell_size + tile % side * TILE_SIDE
    is_partial = (top + TILE_SIDE > height) | (tile // side * TILE_SIDE + TILE_SIDE > cell_size)
    is_partial |= (left + TILE_SIDE > width) | (tile % side * TILE_SIDE + TILE_SIDE > cell_size)
    channel, row, column = np.unravel_index(np.arange(TILE_SLOTS), (2, TILE_SIDE, TILE_SIDE))
    gains, loss, entropy_one = _entropy_tables(cell_size, log_base, rows * columns)
    store = _empty_store(height, width, rows * columns, len(tile), len(gains))
    sizes = _sizes_of(store)
    sizes["height"], sizes["width"], sizes["cells"] = height, width, rows * columns
    sizes["cell_pixels"], sizes["tile_shift"] = cell_size * cell_size, 2 * (side.bit_length() - 1)
    sizes["columns"] = columns if cell_size == TILE_SIDE else 0
    sizes["entropy_one"], sizes["entropy_full"] = entropy_one, gains.sum()
    cells = cells_in(store)
    cells.gains[:], cells.loss[:] = gains, loss
    cells.shared_loss[1:] = np.cumsum(loss[:-1])
    # A cell of one tile has at most 16 pixels; when all have events, nothing is gained.
    table = gains[:LANES]
    cells.gains_high[: len(table)], cells.gains_low[: len(table)] = table >> LOW_BITS, table & (1 << LOW_BITS) - 1
    cells.row_slot[:] = tile_row * TILE_SLOTS + y % cell_size % TILE_SIDE * TILE_SIDE
    cells.column_slot[:] = tile_column * TILE_SLOTS + x % cell_size % TILE_SIDE
    cells.tile_byte[:] = (top * width + left) * 2 + PARTIAL * is_partial
    cells.whole[:] = _bits_of_tiles(~is_partial)
    cells.slot_byte[:] = (row * width + column) * 2 + channel
    count_in(store, cell_rectangles(None, width, height, cell_size), cell_size)
    return store


def _entropy_tables(cell_size: int, log_base: float, cells: int) -> tuple[npt.NDArray[np.int64], FloatArray, float]:
    """`CellMap.gains`, `loss` and `entropy_one`: a level that c of m pixels share takes (c ln c) / m from ln m.

    Whole numbers as fine as the largest gain fits 41 bits, and the sum over all channels 63.
    """
    c_log_c = count_log_counts(cell_size) / (cell_size * cell_size) / math.log(log_base)
    # The pixels without events share level 0.
    entropy = c_log_c[-1] - c_log_c[::-1]
    entropy_one = 2.0 ** math.floor(min(40 - math.log2(entropy[1]), 62 - math.log2(2 * cells * entropy[-1])))
    gains = np.diff(np.rint(entropy * entropy_one).astype(np.int64))
    return np.append(gains, 0), np.append(np.diff(c_log_c), 0.0), entropy_one


def _bits_of_tiles(are_set: npt.NDArray[np.bool_]) -> npt.NDArray[np.uint64]:
    """A bit per tile, lowest first, 64 to a word."""
    bits = np.packbits(np.pad(are_set, (0, -len(are_set) % GROUP_TILES)), bitorder="little")
    return bits.view("<u8").astype(np.uint64)


def cell_rectangles(boxes: Iterable[Box] | None, width: int, height: int, cell_size: int) -> CellRectangles:
    """The cells that have a pixel in one of the boxes.

    Args:
        boxes: pixels, which may lie off the sensor; None: all of it.
        width: of the sensor (pixels).
        height: of the sensor (pixels).
        cell_size: r (pixels).

    Returns:
        First row, row after the last, first column and column after the last of each box, in cells.
    """
    if boxes is None:
        return ((0, -(-height // cell_size), 0, -(-width // cell_size)),)
    rectangles = []
    for box in boxes:
        left, right = (min(max(edge, 0), width) for edge in (math.floor(box.x), math.ceil(box.x + box.w)))
        top, bottom = (min(max(edge, 0), height) for edge in (math.floor(box.y), math.ceil(box.y + box.h)))
        if left < right and top < bottom:
            rectangles.append((top // cell_size, -(-bottom // cell_size), left // cell_size, -(-right // cell_size)))
    return tuple(rectangles)


def count_in(store: CellStore, rectangles: CellRectangles, cell_size: int) -> None:
    """Have the entropy measured in these cells; the map must be empty.

    Args:
        store: the map.
        rectangles: as `cell_rectangles` gives them.
        cell_size: r (pixels).
    """
    sizes = _sizes_of(store)[0]
    columns = -(-int(sizes["width"]) // cell_size)
    counted, drawn = _count_in(store, np.array(rectangles, np.int64).reshape(-1, 4), columns)
    sizes["sample_scale"] = counted / max(1, drawn)
    sizes["is_plain"] = int(sizes["tile_shift"]) == 0 and counted == int(sizes["cells"])


@borrowing_kernel
def _count_in(store: CellStore, rectangles: npt.NDArray[np.int64], columns: int) -> tuple[int, int]:
    """Note the cells that count, and those of them that are in the sample; how many those are.

    The sample is strewn by a hash of the cells' numbers, so that no pattern fits it.
    """
    cells = borrowed_cells(store)
    cells.is_counted[:] = 0
    cells.sample[:] = 0
    counted, drawn = 0, 0
    for k in range(len(rectangles)):
        first_row, end_row, first_column, end_column = rectangles[k]
        for row in range(first_row, end_row):
            for cell in range(row * columns + first_column, row * columns + end_column):
                if cells.is_counted[cell]:
                    continue
                cells.is_counted[cell] = 1
                counted += 1
                if (cell * HASH_FACTOR & 0xFFFFFFFF) < 2**32 // SAMPLE_STEP:
                    drawn += 1
                    for tile in range(cell << cells.tile_shift, (cell + 1) << cells.tile_shift):
                        cells.sample[tile // GROUP_TILES] |= np.uint64(1) << np.uint64(tile % GROUP_TILES)
    return counted, drawn
