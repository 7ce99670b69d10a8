"""The unfinished frame: a last-event map in cell order, counts per cell, and the kernels that work on them.

Pixels are stored cell by cell, first the On channel of a cell, then its Off channel (a "group" each):

    last:   | cell 0 On | cell 0 Off | cell 1 On | ...        each group has cell_size^2 slots, row by row
    counts: |     0     |      1     |     2     | ...        pixels of the group that have an event

so that an entropy or a readout touches only cells with events, each contiguous. A border cell of a sensor that
cell_size does not divide has slots that no pixel maps to; they stay empty and `pixels` leaves them out.

Kernels that call each other stay in this module: the compiler's cache knows only changes of a kernel's own file.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.conversion.nzge import GREY_LEVELS, FloatArray, check_grid, count_log_counts

NO_EVENT = -1
DURATION_MAX_NS = 2_000_000_000
"""Longest frame: times since its start are kept in 32 bits."""

STATE_DTYPE = np.dtype(
    [("start_ns", "<i8"), ("events", "<i8"), ("touched", "<i8"), ("full", "<i8"), ("entropy", "<f8")]
)
"""The frame's start T_{i-1} (ns); its events; cells with an event; groups with an event in every pixel; the sum over
groups of the entropy that they have if all grey levels are distinct (in units of the log base)."""


CHECKS_AT_STRIDE = 8
"""Exact checks of a frame at `check_stride` before the distance begins to double."""

ESTIMATE_MARGIN = 1e-9
"""Above the rounding errors of the estimate's running sum."""

CHECKS_DTYPE = np.dtype([("next", "<i8"), ("exact_per_bound", "<f8"), ("failed", "<i8")])
"""Number of the frame's event at which to check next, exact NZGE by its bound at the last exact check (1 before the
frame's first), and exact checks that found less than alpha."""


class CellMap(NamedTuple):
    """Arrays of the unfinished frame; h, w the sensor's size, r the cell size, C the number of cells.

    Attributes:
        row_slot, column_slot: int32, (h,) and (w,): a pixel's On slot is row_slot[y] + column_slot[x].
        row_group, column_group: int32, (h,) and (w,): its On group, likewise.
        last: int32, (2 C r^2,): time of the last event since the frame's start (ns), or NO_EVENT.
        counts: int32, (2 C,): pixels of a group that have an event.
        pixels: int32, (C,): pixels of a cell.
        gains: float64, (r^2 + 1, r^2 + 1): entropy that pixel c + 1 adds to a group of m pixels of which c have events.
        c_log_c: float64, (r^2 + 1,): c ln c.
        state: STATE_DTYPE, (1,).
    """

    row_slot: npt.NDArray[np.int32]
    column_slot: npt.NDArray[np.int32]
    row_group: npt.NDArray[np.int32]
    column_group: npt.NDArray[np.int32]
    last: npt.NDArray[np.int32]
    counts: npt.NDArray[np.int32]
    pixels: npt.NDArray[np.int32]
    gains: FloatArray
    c_log_c: FloatArray
    state: npt.NDArray[np.void]


def make_cell_map(width: int, height: int, cell_size: int, log_base: float) -> CellMap:
    """An empty map; the sensor's size must have been checked.

    Raises:
        ConversionError: cell_size or log_base out of range.
    """
    check_grid(cell_size, log_base)
    rows, columns = -(-height // cell_size), -(-width // cell_size)
    slots = cell_size * cell_size
    y, x = np.arange(height), np.arange(width)
    row_pixels = np.bincount(y // cell_size)
    column_pixels = np.bincount(x // cell_size)
    return CellMap(
        row_slot=((y // cell_size) * columns * 2 * slots + (y % cell_size) * cell_size).astype(np.int32),
        column_slot=((x // cell_size) * 2 * slots + x % cell_size).astype(np.int32),
        row_group=((y // cell_size) * columns * 2).astype(np.int32),
        column_group=((x // cell_size) * 2).astype(np.int32),
        last=np.full(rows * columns * 2 * slots, NO_EVENT, np.int32),
        counts=np.zeros(rows * columns * 2, np.int32),
        pixels=np.outer(row_pixels, column_pixels).ravel().astype(np.int32),
        gains=_entropy_gains(cell_size, log_base),
        c_log_c=count_log_counts(cell_size),
        state=np.zeros(1, STATE_DTYPE),
    )


def _entropy_gains(cell_size: int, log_base: float) -> FloatArray:
    """H(m, c + 1) - H(m, c), H the entropy of m pixels with c distinct levels and m - c zeros; zero where c >= m."""
    c_log_c = count_log_counts(cell_size)
    gains = np.zeros((len(c_log_c), len(c_log_c)))
    for pixels in range(1, len(c_log_c)):
        zeros = pixels - np.arange(pixels + 1)
        gains[pixels, :pixels] = np.diff(-c_log_c[zeros] / pixels) / math.log(log_base)
    return gains


@njit(cache=True, nogil=True)
def add_events(
    cells: CellMap,
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    first: int,
    stop: int,
    limit_ns: int,
) -> int:
    """Add events first .. stop - 1 that come at limit_ns or before; return the index of the first one not added."""
    slots = len(cells.c_log_c) - 1
    state = cells.state
    start_ns = state[0].start_ns
    touched, full, entropy = state[0].touched, state[0].full, state[0].entropy
    i = first
    while i < stop and t[i] <= limit_ns:
        channel = 1 - p[i]
        slot = cells.row_slot[y[i]] + cells.column_slot[x[i]] + channel * slots
        if cells.last[slot] == NO_EVENT:
            group = cells.row_group[y[i]] + cells.column_group[x[i]] + channel
            count = cells.counts[group]
            pixels = cells.pixels[group >> 1]
            touched += count == 0 and cells.counts[group ^ 1] == 0
            cells.counts[group] = count + 1
            entropy += cells.gains[pixels, count]
            full += count + 1 == pixels
        cells.last[slot] = t[i] - start_ns
        i += 1
    state[0].events += i - first
    state[0].touched, state[0].full, state[0].entropy = touched, full, entropy
    return i


@njit(cache=True, nogil=True)
def decay(duration_ns: int) -> tuple[float, float]:
    """Slope (levels / ns) and offset of `grey_level` in a frame of this duration."""
    return (255.0 / duration_ns, 0.5) if duration_ns > 0 else (0.0, 255.0)


@njit(cache=True, nogil=True)
def grey_level(since_start_ns: int, slope: float, offset: float) -> int:
    """max(1, round(255 * since_start / duration)), halves up; 255 in a frame of no duration."""
    # By way of 32 bits, for which processors have a vector instruction.
    return max(1, int(np.int32(since_start_ns * slope + offset)))


@njit(cache=True, nogil=True)
def map_nzge(cells: CellMap, duration_ns: int, per_log_base: float) -> float:
    """NZGE of the frame if it ended duration_ns after its start: `nzge` of its readout, from groups with events only.

    The state holds the entropy for distinct grey levels; what is missing from it is c ln c / m for every c equal ones.
    """
    slots = len(cells.c_log_c) - 1
    slope, offset = decay(duration_ns)
    levels = np.empty(slots + 1, np.int32)
    level_counts = np.zeros(GREY_LEVELS, np.int32)
    missing = 0.0
    zero_cells = 0
    for cell in range(len(cells.pixels)):
        pixels = cells.pixels[cell]
        zero_groups = 0
        for group in range(2 * cell, 2 * cell + 2):
            events = cells.counts[group]
            if events < 2:
                zero_groups += events == 0 or pixels == 1
                continue
            _pack_levels(cells.last[group * slots : (group + 1) * slots], slope, offset, levels)
            c_log_c = 0.0
            for k in range(events):
                count = level_counts[levels[k]]
                level_counts[levels[k]] = count + 1
                c_log_c += cells.c_log_c[count + 1] - cells.c_log_c[count]
            missing += c_log_c / pixels
            zero_groups += level_counts[levels[0]] == pixels
            for k in range(events):
                level_counts[levels[k]] = 0
        zero_cells += zero_groups == 2
    not_zero = len(cells.pixels) - zero_cells
    return (cells.state[0].entropy - missing * per_log_base) / 2 / not_zero if not_zero else 0.0


@njit(cache=True, nogil=True)
def _pack_levels(last: npt.NDArray[np.int32], slope: float, offset: float, levels: npt.NDArray[np.int32]) -> None:
    """Grey levels of the slots with an event, in a row; levels has room for one more than there are slots."""
    # No branch, as the processor could not predict it: what an empty slot writes is overwritten by the next one.
    k = 0
    for since_start_ns in last:
        levels[k] = grey_level(since_start_ns, slope, offset)
        k += since_start_ns != NO_EVENT


@njit(cache=True, nogil=True)
def read_out(cells: CellMap, duration_ns: int, cell_size: int, data: npt.NDArray[np.uint8]) -> None:
    """Write the frame's grey levels into data, uint8 zeros of shape (height, width, 2), and empty the map."""
    height, width, _ = data.shape
    slots = cell_size * cell_size
    columns = (width + cell_size - 1) // cell_size
    slope, offset = decay(duration_ns)
    levels = np.empty(2 * slots, np.uint8)
    for cell in range(len(cells.pixels)):
        if cells.counts[2 * cell] + cells.counts[2 * cell + 1] == 0:
            continue
        cells.counts[2 * cell : 2 * cell + 2] = 0
        last = cells.last[2 * cell * slots : 2 * (cell + 1) * slots]
        for slot in range(2 * slots):
            level = grey_level(last[slot], slope, offset)
            levels[slot] = level if last[slot] != NO_EVENT else 0
        last[:] = NO_EVENT
        top = cell // columns * cell_size
        left = cell % columns * cell_size
        for row in range(min(cell_size, height - top)):
            for column in range(min(cell_size, width - left)):
                data[top + row, left + column, 0] = levels[row * cell_size + column]
                data[top + row, left + column, 1] = levels[slots + row * cell_size + column]
    state = cells.state
    state[0].events = 0
    state[0].touched = 0
    state[0].full = 0
    state[0].entropy = 0.0


@njit(cache=True, nogil=True)
def advance(
    cells: CellMap,
    checks: npt.NDArray[np.void],
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    first: int,
    limit_ns: int,
    alpha: float,
    per_log_base: float,
    check_stride: int,
) -> tuple[int, float]:
    """Add events to the frame until it reaches alpha, an event comes after limit_ns, or the batch is over.

    Returns:
        The index of the first event not added, and the NZGE that reached alpha, or 0.
    """
    state = cells.state
    i = first
    while i < len(t):
        stop = min(len(t), i + checks[0].next - state[0].events)
        i = add_events(cells, t, x, y, p, i, stop, limit_ns)
        if i < stop:
            return i, 0.0
        if state[0].events < checks[0].next:
            continue
        checks[0].next += check_stride
        duration_ns = t[i - 1] - state[0].start_ns
        certain_cells = state[0].touched - state[0].full
        bound = state[0].entropy / 2 / certain_cells if certain_cells > 0 else 1.0
        if duration_ns == 0 or bound * checks[0].exact_per_bound < alpha * (1 - ESTIMATE_MARGIN):
            continue
        nzge = map_nzge(cells, duration_ns, per_log_base)
        if nzge >= alpha:
            return i, nzge
        checks[0].exact_per_bound = nzge / bound
        checks[0].failed += 1
        if checks[0].failed > CHECKS_AT_STRIDE:
            checks[0].next += check_stride * (2 ** min(checks[0].failed - CHECKS_AT_STRIDE, 30) - 1)
    return i, 0.0
