"""The kernels of conversion: when to look at the cell map's NZGE, by a running bound of it, and when a frame ends.

The compiler's cache knows only changes of a kernel's own file, and, by the state's type, of what else these are made
of.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from numba import from_dtype

from etd_ros.borrowing_kernel import borrowing_kernel, kernel_part
from etd_ros.conversion.adding import add_events, begin_block
from etd_ros.conversion.batches import BEFORE_ALL_NS, can_follow
from etd_ros.conversion.cell_map import DURATION_MAX_NS, CellMap, CellStore, borrowed_cells, source_digest
from etd_ros.conversion.readout import read_levels
from etd_ros.direct_kernel import (
    DirectKernel,
    PythonObject,
    addresses_of,
    give_away_lock,
    integer_of,
    is_plain,
    take_int64,
    take_lock_back,
    take_uint8,
    take_uint16,
    taken_as,
    to_python,
)

CHECKS_AT_STRIDE = 8
"""Exact checks of a frame at `check_stride` before the distance begins to double."""

GROWTH_MAX = 8
"""Where NZGE may have reached alpha, a frame does not grow by more than one in so many of its events without a look."""

SAMPLE_CELLS_MIN = 256
"""Cells with events from which on a sample pays: of fewer, each stride is checked."""

SAMPLE_TRUST = 0.9
"""Share of the sample's loss that is believed, as it may err: rather a check too many than a frame too late."""

SAMPLE_PAIRS_MIN, PATIENCE = 25, 128
"""A sample that has lost as much as so many pairs of equal levels errs by about a fifth (one over the root of their
number) where they are strewn. From then on a frame waits until NZGE has most likely reached alpha, but not for more
than one in so many of its events, or a stride: a check of all its cells that fails costs more than that. So it does
where the last frame tells instead of a sample.
"""

SURPRISE_MAX, EXPECTING_EVENTS_MIN = 0.004, 2000
"""A frame is expected to lose what the last one that NZGE ended did, where that had lost what was expected, to this
share of its entropy; by as much as that was off it is unsure. Else a sample tells, as it does for frames of fewer
events: of those a stride is a large part.
"""

FULL_EVENTS = 12
"""A frame of more events than so many to each cell with events is full: its cells hold few levels. No trigger lets it
come to that where things move: only what ends by its time or count does."""

LOCKED_EVENTS_MAX, LOCKED_ITEMS_MAX = 1000, 2**18
"""The interpreter's lock is kept for batches of so many events on sensors whose maps have so many items (a quarter of a
million pixels): to give it away and take it back, which may have to wait, costs more than to let others wait for as
long as these take."""

NO_CHECKS = 2**62
"""A `check_stride` that no frame reaches."""

NEW_BATCH = -1
"""Instead of a batch's first event: it has not been verified yet."""

NO_END, BY_NZGE, BY_TIME, LATE, NOT_FOLLOWING, NOT_PLAIN = 0, 1, 2, 3, -1, -2
"""What came of adding a batch's events. They have all been added, and no frame has ended; one has, by its NZGE, or by
its longest duration; an event is later than that, and `finish` is to end the frame, or no event is in it yet; one of a
block of events does not fit, and none of that block has been added; nothing is known of these arrays by
`advance_plain`."""

Step: TypeAlias = tuple[int, int, int, float, int]
"""What came of adding events (`NO_END` and so on); the first event not added; the time of the one that has ended the
frame (ns): the last one added, or else the first one that came too late; the NZGE of a frame that has ended; the number
of events of that frame, or of the unfinished one."""

MARGIN = 1e-9
"""Above the rounding errors of the bound."""

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
        ("below", "<i8"),
        ("expected", "<f8"),
        ("expected_without", "<f8"),
        ("expected_events", "<i8"),
        ("surprise", "<f8"),
        ("block_first", "<i8"),
        ("block_stop", "<i8"),
        ("previous_ns", "<i8"),
        ("min_duration_ns", "<i8"),
        ("max_duration_ns", "<i8"),
        ("alpha", "<f8"),
        ("check_stride", "<i8"),
        (f"made_by_{source_digest()}", "<i8"),
    ]
)
"""Where an unfinished frame stands, and when it ends.

Its events; of the cells that count, those with events, and the sum of their channels' entropies as if all levels were
distinct; the number of the event at which to look at NZGE next. At the last look at levels, a sample or an exact
check: its event (0: none yet), what the sum had lost, how much more it may have lost (`unsure`), and the cells that had
events but no entropy. From which event on NZGE has most likely reached alpha (`near`, 0: it has not yet). Exact checks
that found less than alpha, and up to which event NZGE is known to be below alpha (`below`, 0: no bound has let it reach
that yet).

What the last frame that NZGE ended had lost, as a share of that sum, and its share of cells without entropy; its events
(0: none is known); by how much its lost share was another one than expected (`surprise`).

The first event of the block of the batch whose slots the map holds, and the one behind its last: frames end within
blocks, which are not begun anew for the next one.

The time of the stream's last event. What ends a frame: NZGE of alpha or more, looked for every `check_stride` events,
min_duration_ns after the frame's start at the earliest, or max_duration_ns. All this lies here, as an array costs
Python less to hand over than a number each. The last field is empty (`source_digest`).
"""


def empty_state() -> npt.NDArray[np.void]:
    """That of a frame that nothing ends but its longest duration, and before which there was none; shape (1,)."""
    state = np.zeros(1, STATE_DTYPE)
    state["previous_ns"], state["max_duration_ns"] = BEFORE_ALL_NS, DURATION_MAX_NS
    state["alpha"], state["check_stride"] = 1.0, NO_CHECKS
    return state


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


@kernel_part
def _finish(
    store: CellStore, state: npt.NDArray[np.void], duration_ns: int, data: npt.NDArray[np.uint8]
) -> tuple[float, int]:
    cells = borrowed_cells(store)
    nzge = _read_out(cells, state, duration_ns, _is_full(cells, state), data)
    events = state[0].events
    _clear(cells, state)
    return nzge, events


@kernel_part
def _is_full(cells: CellMap, state: npt.NDArray[np.void]) -> bool:
    return bool(cells.tile_shift == 0 and state[0].events > FULL_EVENTS * state[0].counted)


@kernel_part
def _read_out(
    cells: CellMap, state: npt.NDArray[np.void], duration_ns: int, is_full: bool, data: npt.NDArray[np.uint8]
) -> float:
    """Write the grey levels of the pixels with events into the frame's data, and return its exact NZGE."""
    lost, without_entropy = read_levels(cells, duration_ns, False, is_full, data)
    state[0].looked = state[0].events
    state[0].lost = lost * cells.entropy_one
    state[0].unsure = 0.0
    state[0].without_entropy = without_entropy
    not_zero = state[0].counted - without_entropy
    return (state[0].entropy / cells.entropy_one - lost) / 2 / not_zero if not_zero else 0.0


@kernel_part
def _look_at_sample(cells: CellMap, state: npt.NDArray[np.void], duration_ns: int, data: npt.NDArray[np.uint8]) -> None:
    """Note what a sample of the cells has lost."""
    lost, without_entropy = read_levels(cells, duration_ns, True, False, data)
    scale = SAMPLE_TRUST * cells.sample_scale
    state[0].looked = state[0].events
    state[0].lost = lost * scale * cells.entropy_one
    lost_pairs = lost / cells.loss[1]
    if lost_pairs >= SAMPLE_PAIRS_MIN:
        state[0].unsure = (1 + 1 / np.sqrt(lost_pairs) - SAMPLE_TRUST) / SAMPLE_TRUST * state[0].lost
    state[0].without_entropy = without_entropy * scale


@kernel_part
def _expect_the_same(state: npt.NDArray[np.void]) -> None:
    """Expect the next frame to lose what this one has lost at its end."""
    if state[0].entropy == 0:
        return
    lost = state[0].lost / state[0].entropy
    expected = state[0].expected * state[0].events / max(state[0].expected_events, 1)
    state[0].surprise = abs(lost - expected)
    state[0].expected = lost
    state[0].expected_without = state[0].without_entropy / state[0].counted
    state[0].expected_events = state[0].events


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
    state[0].below = 0


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
    data: npt.NDArray[np.uint8],
) -> Step:
    """Add events to the frame that started at start_ns until the state says that it ends, or the batch is over.

    A `NEW_BATCH` has to follow the stream's last event. Its events are verified here, block by block (`begin_block`):
    many batches are so small that a call of its own for it would cost as much as their events, and large ones would be
    read twice from a memory that is far.

    Returns:
        See `Step`. A frame that has ended is in data, and the next one has begun.
    """
    return _advance(store, state, t, x, y, p, first, start_ns, data)


@kernel_part
def _advance(
    store: CellStore,
    state: npt.NDArray[np.void],
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    first: int,
    start_ns: int,
    data: npt.NDArray[np.uint8],
) -> Step:
    cells = borrowed_cells(store)
    if first == NEW_BATCH:
        if not can_follow(t, x, y, p, state[0].previous_ns):
            return NOT_FOLLOWING, 0, 0, 0.0, 0
        if len(t) == 0:
            return NO_END, 0, 0, 0.0, state[0].events
        first = 0
        state[0].block_first, state[0].block_stop = 0, 0
    alpha, check_stride = state[0].alpha, state[0].check_stride
    earliest_ns = start_ns + state[0].min_duration_ns
    stop = _first_after(t, first, start_ns + state[0].max_duration_ns)
    i, block_first, block_stop = first, state[0].block_first, state[0].block_stop
    if not block_first <= i <= block_stop:
        # Another batch has come meanwhile, which should not be: no slots but those of a block may be taken.
        block_first, block_stop = i, i
    if state[0].events == 0:
        state[0].next = check_stride
    while True:
        if i == block_stop and i < len(t):
            # It goes on beyond the next check, as the frame or the next one most likely does.
            block_first, block_stop = i, min(i + len(cells.slots), len(t))
            if not begin_block(cells, state, t, x, y, p, block_first, block_stop):
                return NOT_FOLLOWING, i, 0, 0.0, 0
        part = min(stop, block_stop, i + state[0].next - state[0].events)
        add_events(cells, state, t, x, y, p, i, part, start_ns, block_first)
        i = part
        events = state[0].events
        if i == block_stop and i < len(t) and events < state[0].next:
            continue
        # Short of the next check the batch is over, or an event has come after the longest duration.
        is_late = events < state[0].next
        if is_late and i == len(t):
            return NO_END, i, 0, 0.0, events
        # Full frames are for `finish`; and so are all where no checks are: those end as their converter says.
        if is_late and (events == 0 or check_stride == NO_CHECKS or _is_full(cells, state)):
            return LATE, i, t[i], 0.0, events
        strides = 1
        duration_ns = state[0].max_duration_ns if is_late else t[i - 1] - start_ns
        if is_late:
            strides = 0
        elif t[i - 1] < earliest_ns:
            # To the first check that may succeed, or the batch's end.
            strides = 1 + (_first_after(t, i, earliest_ns - 1) - i) // check_stride
        elif duration_ns > 0:
            strides = _strides_below(cells, state, alpha, check_stride, duration_ns, data)
        if strides == 0:
            nzge = _read_out(cells, state, duration_ns, False, data)
            if is_late or nzge >= alpha:
                # What its time ends may have half the events that alpha takes, and not tell what twice as many lose.
                if not is_late:
                    _expect_the_same(state)
                _clear(cells, state)
                return (BY_TIME, i, t[i], nzge, events) if is_late else (BY_NZGE, i, t[i - 1], nzge, events)
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
    if state[0].below == 0 or (state[0].looked == 0 and not is_bound):
        state[0].below = state[0].events
    room = state[0].below + state[0].below // GROWTH_MAX - state[0].events
    if state[0].looked == 0 and state[0].counted < SAMPLE_CELLS_MIN:
        return 0
    is_expected = state[0].expected_events > 0 and state[0].surprise <= SURPRISE_MAX
    if state[0].looked == 0 and is_bound and is_expected and state[0].events >= EXPECTING_EVENTS_MIN:
        # Two events lose something together, so that the share of what is lost grows with their number.
        share = state[0].expected * state[0].events / state[0].expected_events
        with_entropy = state[0].counted * (1 - state[0].expected_without)
        missing = with_entropy * per_cell - state[0].entropy * (1 - share)
        unsure = state[0].entropy * state[0].surprise
    else:
        if state[0].looked == 0:
            _look_at_sample(cells, state, duration_ns, data)
        with_entropy = state[0].counted - state[0].without_entropy
        missing = with_entropy * per_cell - (state[0].entropy - state[0].lost)
        unsure = state[0].unsure
    if missing <= 0:
        if state[0].near == 0:
            state[0].near = state[0].events
        missing += unsure
        room = min(room, state[0].near + state[0].near // PATIENCE - state[0].events)
    if missing <= 0 or room <= 0:
        return 0
    return max(1, int(min(missing / gain_max, room / check_stride)))


@kernel_part
def _fail(state: npt.NDArray[np.void], check_stride: int) -> int:
    """Note an exact check that found less than alpha; strides to the next one."""
    state[0].failed += 1
    state[0].below = state[0].events
    doubled = 1 << min(max(int(state[0].failed) - CHECKS_AT_STRIDE, 0), 30)
    return max(1, min(doubled, int(state[0].events) // (GROWTH_MAX * check_stride)))


_take_state = taken_as(from_dtype(STATE_DTYPE))


def _advance_plain(known: PythonObject, arguments: Sequence[PythonObject], _number: int) -> PythonObject:
    addresses = take_int64(known)
    store, state, data = take_int64(arguments[0]), _take_state(arguments[1]), take_uint8(arguments[8])
    t, x, y, p = arguments[2], arguments[3], arguments[4], arguments[5]
    are_plain = is_plain(t, addresses, 1) and is_plain(p, addresses, 3)
    if not (are_plain and is_plain(x, addresses, 2) and is_plain(y, addresses, 2)):
        return to_python((NOT_PLAIN, 0, 0, 0.0, 0))
    first, start_ns = integer_of(arguments[6]), integer_of(arguments[7])
    times, columns, rows, polarities = take_int64(t), take_uint16(x), take_uint16(y), take_uint8(p)
    thread = give_away_lock(len(times) > LOCKED_EVENTS_MAX or len(store) > LOCKED_ITEMS_MAX)
    step = _advance(store, state, times, columns, rows, polarities, first, start_ns, data)
    take_lock_back(thread)
    # Of most messages this is all there is to say: no object has to be made for it.
    return to_python(None) if step[0] == NO_END else to_python(step)


def _finish_direct(_known: PythonObject, arguments: Sequence[PythonObject], _number: int) -> PythonObject:
    store, state, data = take_int64(arguments[0]), _take_state(arguments[1]), take_uint8(arguments[3])
    duration_ns = integer_of(arguments[2])
    thread = give_away_lock(len(store) > LOCKED_ITEMS_MAX)
    ended = _finish(store, state, duration_ns, data)
    take_lock_back(thread)
    return to_python(ended)


Advance: TypeAlias = (
    "Callable[[CellStore, npt.NDArray[np.void], npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any],"
    " int, int, npt.NDArray[np.uint8]], Step | None]"
)
Finish: TypeAlias = "Callable[[CellStore, npt.NDArray[np.void], int, npt.NDArray[np.uint8]], tuple[float, int]]"

_ADDRESSES = addresses_of(np.int64, np.uint16, np.uint8)

advance_plain: DirectKernel[Advance] = DirectKernel(_advance_plain, _ADDRESSES, source_digest())
"""`advance` for arrays as decoders make them, in less time: None where the batch is over, NOT_PLAIN for others."""

finish: DirectKernel[Finish] = DirectKernel(_finish_direct, None, source_digest())
"""finish(store, state, duration_ns, data): end the frame: write it into data, flat, and begin the next one; its exact
NZGE and its number of events."""
