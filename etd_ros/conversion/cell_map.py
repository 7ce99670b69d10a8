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

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.conversion.nzge import GREY_LEVELS, FloatArray, check_grid, count_log_counts

TILE_SIDE = 4
TILE_SLOTS = 2 * TILE_SIDE * TILE_SIDE

DURATION_MAX_NS = 2_000_000_000
"""Longest frame: times since its start are kept in 32 bits."""

BLOCK_EVENTS = 512
"""Events that are added at a time: few enough for their slots to stay in the processor's nearest memory."""

LISTED = 4
"""Numbers that the readout's list holds of a tile."""

SAMPLE_STEP = 8
"""One cell in so many is in the sample."""


class CellMap(NamedTuple):
    """Arrays of the unfinished frame; h, w the sensor's size, m = r^2, C the number of cells, T that of tiles.

    Attributes:
        row_slot, column_slot: uint32, (h,) and (w,): a pixel's On slot is row_slot[y] + column_slot[x], its Off slot 16
            further on.
        last: int32, (32 T,): time of the last event since the frame's start (ns), where the slot's bit is set.
        words: uint32, (T,): the bits.
        tile_byte, slot_byte: uint32, (T,) and (32,): a slot's byte in the frame's data is the sum of the two.
        tile_shift: T = C 2^tile_shift.
        is_counted: bool, (C,): whether the entropy is measured in a cell.
        is_plain: whether it is in all of them, and each has one tile: then `counts` is not used, as the words tell.
        counts: uint32, (2 C,): pixels with events of a cell's On and Off channel.
        sample, sample_scale: uint32: the tiles of about one cell in eight that counts, and how many it stands for.
        entropy: int64, (m + 2,): entropy of a channel of which c pixels have events of distinct levels, in units of
            1 / entropy_one: sums of integers do not depend on how they were added up.
        loss: float64, (m + 1,): what it loses by the next pixel of a level that c pixels have already.
        columns: cells in a row, 0 where a cell is not a whole tile of 4 x 4 pixels.
        touched_tiles: uint32, (T + 1,): the tiles with events in the order in which they got the first one.
        slots: uint32, (512,): scratch for a block of events.
        seen: uint32, (512,), listed: uint32, (4 (T + 2),): scratch of the readout.
    """

    row_slot: npt.NDArray[np.uint32]
    column_slot: npt.NDArray[np.uint32]
    last: npt.NDArray[np.int32]
    words: npt.NDArray[np.uint32]
    tile_byte: npt.NDArray[np.uint32]
    slot_byte: npt.NDArray[np.uint32]
    tile_shift: int
    is_counted: npt.NDArray[np.bool_]
    is_plain: bool
    counts: npt.NDArray[np.uint32]
    sample: npt.NDArray[np.uint32]
    sample_scale: float
    entropy: npt.NDArray[np.int64]
    entropy_one: float
    loss: FloatArray
    columns: int
    touched_tiles: npt.NDArray[np.uint32]
    slots: npt.NDArray[np.uint32]
    seen: npt.NDArray[np.uint32]
    listed: npt.NDArray[np.uint32]


def make_cell_map(width: int, height: int, cell_size: int, log_base: float) -> CellMap:
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
    channel, row, column = np.unravel_index(np.arange(TILE_SLOTS), (2, TILE_SIDE, TILE_SIDE))
    entropy, loss, entropy_one = _entropy_tables(cell_size, log_base, rows * columns)
    is_counted = np.ones(rows * columns, np.bool_)
    tile_shift = 2 * (side.bit_length() - 1)
    sample, sample_scale = _sample(is_counted, tile_shift)
    return CellMap(
        row_slot=(tile_row * TILE_SLOTS + y % cell_size % TILE_SIDE * TILE_SIDE).astype(np.uint32),
        column_slot=(tile_column * TILE_SLOTS + x % cell_size % TILE_SIDE).astype(np.uint32),
        last=np.empty(len(tile) * TILE_SLOTS, np.int32),
        words=np.zeros(len(tile), np.uint32),
        tile_byte=((top * width + left) * 2).astype(np.uint32),
        slot_byte=((row * width + column) * 2 + channel).astype(np.uint32),
        tile_shift=tile_shift,
        is_counted=is_counted,
        is_plain=tile_shift == 0,
        counts=np.zeros(2 * rows * columns, np.uint32),
        sample=sample,
        sample_scale=sample_scale,
        entropy=entropy,
        entropy_one=entropy_one,
        loss=loss,
        columns=columns if cell_size == TILE_SIDE else 0,
        touched_tiles=np.zeros(len(tile) + 1, np.uint32),
        slots=np.zeros(BLOCK_EVENTS, np.uint32),
        seen=np.zeros(2 * GREY_LEVELS, np.uint32),
        listed=np.zeros(LISTED * (len(tile) + 2), np.uint32),
    )


def _entropy_tables(cell_size: int, log_base: float, cells: int) -> tuple[npt.NDArray[np.int64], FloatArray, float]:
    """`CellMap.entropy`, `loss` and `entropy_one`: a level that c of m pixels share takes (c ln c) / m from ln m."""
    c_log_c = count_log_counts(cell_size) / (cell_size * cell_size) / math.log(log_base)
    # The pixels without events share level 0. As fine as the sum over all channels fits 63 bits.
    entropy = c_log_c[-1] - c_log_c[::-1]
    entropy_one = 2.0 ** min(40, math.floor(62 - math.log2(2 * cells * entropy[-1])))
    whole = np.rint(entropy * entropy_one).astype(np.int64)
    return np.append(whole, whole[-1]), np.append(np.diff(c_log_c), 0.0), entropy_one


def _sample(is_counted: npt.NDArray[np.bool_], tile_shift: int) -> tuple[npt.NDArray[np.uint32], float]:
    """`CellMap.sample` and `sample_scale`; strewn by a hash of the cells' numbers, so that no pattern fits it."""
    counted = np.flatnonzero(is_counted).astype(np.uint64)
    cells = counted[(counted * np.uint64(2654435761) & np.uint64(0xFFFFFFFF)) < np.uint64(2**32 // SAMPLE_STEP)]
    tiles = (cells[:, None] << np.uint64(tile_shift)) + np.arange(1 << tile_shift, dtype=np.uint64)
    return tiles.ravel().astype(np.uint32), len(counted) / max(1, len(cells))


def count_in(cells: CellMap, boxes: Iterable[Box] | None, cell_size: int) -> CellMap:
    """The map, which must be empty, with the entropy measured in the cells that have a pixel in one of the boxes.

    Args:
        cells: the map.
        boxes: pixels, which may lie off the sensor; None: measure everywhere.
        cell_size: r (pixels).
    """
    height, width = len(cells.row_slot), len(cells.column_slot)
    rows, columns = -(-height // cell_size), -(-width // cell_size)
    inside = np.full((rows, columns), boxes is None)
    for box in boxes or ():
        left, right = (int(np.clip(edge, 0, width)) for edge in (math.floor(box.x), math.ceil(box.x + box.w)))
        top, bottom = (int(np.clip(edge, 0, height)) for edge in (math.floor(box.y), math.ceil(box.y + box.h)))
        if left < right and top < bottom:
            inside[top // cell_size : -(-bottom // cell_size), left // cell_size : -(-right // cell_size)] = True
    is_counted = inside.ravel()
    sample, sample_scale = _sample(is_counted, cells.tile_shift)
    is_plain = cells.tile_shift == 0 and bool(is_counted.all())
    return cells._replace(is_counted=is_counted, is_plain=is_plain, sample=sample, sample_scale=sample_scale)
