"""What every consumer of batches verifies before its kernels index arrays with coordinates."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from etd_ros.borrowing_kernel import borrowing_kernel, kernel_part
from etd_ros.conversion.extremes import EVENTS_MIN, are_readable, extremes
from etd_ros.conversion.frame import ConversionError
from etd_ros.events import Events, EventsError

TIME_MAX_NS = 2**62
"""Stamps lie within +-this, so that differences and limits fit 64 bits."""

BEFORE_ALL_NS = -TIME_MAX_NS
"""Instead of the time of a stream's last event: it has none yet. No event has that time."""

COORDINATE_BYTES = 2


def check_batch(events: Events, width: int, height: int, previous_ns: int) -> None:
    """Verify that a batch may follow in this stream; one pass over the arrays.

    Args:
        events: the batch.
        width: width of the stream's sensor (pixels).
        height: height of the stream's sensor (pixels).
        previous_ns: time of the stream's last event (ns), BEFORE_ALL_NS before the first.

    Raises:
        ConversionError: another sensor size, arrays that are not those of events, a coordinate or polarity off the
            sensor, or time going back.
    """
    if events.width != width or events.height != height:
        raise not_of_sensor(events, width, height)
    if not _follows(events.t, events.x, events.y, events.p, width, height, previous_ns):
        raise not_following(events, previous_ns)


def not_of_sensor(events: Events, width: int, height: int) -> ConversionError:
    """What is wrong with a batch of another sensor than the stream's, width x height pixels."""
    msg = f"events of a {events.width}x{events.height} sensor came to a {width}x{height} converter: make a new one"
    return ConversionError(msg)


@borrowing_kernel
def _follows(
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    width: int,
    height: int,
    earliest_ns: int,
) -> bool:
    return can_follow(t, x, y, p, earliest_ns) and fit(t, x, y, p, 0, len(t), width, height)


@kernel_part
def can_follow(
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    earliest_ns: int,
) -> bool:
    """Whether these arrays can be those of a batch, and its first event is not before earliest_ns.

    They cannot if their lengths differ, times are not int64, or other integers of other sizes: for those kernels are
    compiled, too.
    """
    if not len(t) == len(x) == len(y) == len(p):
        return False
    is_time, is_place = t.dtype == np.dtype(np.int64), x.itemsize == y.itemsize == COORDINATE_BYTES
    if not (is_time and is_place and p.itemsize == 1):
        return False
    return bool(len(t) == 0 or earliest_ns <= t[0])


@kernel_part
def fit(
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    first: int,
    stop: int,
    width: int,
    height: int,
) -> bool:
    """Whether events first .. stop - 1 of arrays that can be a batch's fit the sensor, and their time neither goes
    back, from the event before them on, nor leaves what is possible."""
    if first == stop:
        return True
    # With some that have been verified before, few events are looked at as quickly as many.
    begin = max(0, min(first - 1, stop - EVENTS_MIN))
    if stop - begin >= EVENTS_MIN and are_readable(t, x, y, p):
        column, row, polarity, goes_back = extremes(t, x, y, p, begin, stop)
    else:
        column, row, polarity, goes_back = _extremes_of_any(t, x, y, p, begin, stop)
    fit_sensor = column < width and row < height and polarity <= 1
    return bool(fit_sensor and not goes_back and t[first] > BEFORE_ALL_NS and t[stop - 1] < TIME_MAX_NS)


@kernel_part
def _extremes_of_any(
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    first: int,
    stop: int,
) -> tuple[int, int, int, bool]:
    """`extremes` of any arrays of integers of the right sizes, and of few events."""
    # One loop an array, by index, without early exit: the compiler vectorises these and nothing else. What is negative,
    # in arrays of signed integers, is far off the sensor as an unsigned one.
    x_max, y_max, p_max = np.uint16(0), np.uint16(0), np.uint8(0)
    for i in range(first, stop):
        x_max = np.uint16(max(x_max, np.uint16(x[i])))
    for i in range(first, stop):
        y_max = np.uint16(max(y_max, np.uint16(y[i])))
    for i in range(first, stop):
        p_max = np.uint8(max(p_max, np.uint8(p[i])))
    steps_back = 0
    for i in range(first + 1, stop):
        steps_back += t[i] < t[i - 1]
    return int(x_max), int(y_max), int(p_max), steps_back != 0


def not_following(events: Events, previous_ns: int) -> ConversionError:
    """What is wrong with a batch that cannot follow, or has events that do not fit."""
    return ConversionError(_what_is_wrong(events, previous_ns))


def _what_is_wrong(events: Events, previous_ns: int) -> str:
    try:
        events.check_arrays()
    except EventsError as err:
        return str(err)
    first_ns, last_ns = int(events.t[0]), int(events.t[-1])
    if first_ns < previous_ns != BEFORE_ALL_NS:
        return f"event time goes back from {previous_ns} to {first_ns} ns: reset the converter to start a new stream"
    steps_back = np.count_nonzero(events.t[1:] < events.t[:-1])
    if steps_back:
        return f"event time goes back {steps_back} times in a batch from {first_ns} ns: sort the events by time"
    if not -TIME_MAX_NS < first_ns <= last_ns < TIME_MAX_NS:
        return f"event times {first_ns} to {last_ns} ns are impossible: give nanoseconds since an epoch"
    place = f"({int(events.x.max())}, {int(events.y.max())})"
    size = f"{events.width}x{events.height}"
    return f"an event at {place} or a polarity of {int(events.p.max())} does not fit a {size} sensor"
