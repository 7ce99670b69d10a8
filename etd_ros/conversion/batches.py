"""What every consumer of batches verifies before its kernels index arrays with coordinates."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from etd_ros.borrowing_kernel import borrowing_kernel, kernel_part
from etd_ros.conversion.frame import ConversionError
from etd_ros.events import Events, EventsError

TIME_MAX_NS = 2**62
"""Stamps lie within +-this, so that differences and limits fit 64 bits."""

TIME_BYTES, COORDINATE_BYTES = 8, 2


def check_batch(events: Events, width: int, height: int, previous_ns: int | None) -> None:
    """Verify that a batch may follow in this stream; one pass over the arrays.

    Args:
        events: the batch.
        width: width of the stream's sensor (pixels).
        height: height of the stream's sensor (pixels).
        previous_ns: time of the stream's last event (ns), None before the first.

    Raises:
        ConversionError: another sensor size, arrays that are not those of events, a coordinate or polarity off the
            sensor, or time going back.
    """
    check_size(events, width, height)
    if not _follows(events.t, events.x, events.y, events.p, width, height, earliest_ns(previous_ns)):
        raise not_following(events, previous_ns)


def check_size(events: Events, width: int, height: int) -> None:
    """Verify that a batch is of the stream's sensor, width x height pixels.

    Raises:
        ConversionError: it is not.
    """
    if events.width != width or events.height != height:
        msg = f"events of a {events.width}x{events.height} sensor came to a {width}x{height} converter: make a new one"
        raise ConversionError(msg)


def earliest_ns(previous_ns: int | None) -> int:
    """The earliest time of an event that follows one at previous_ns, or none (ns)."""
    return 1 - TIME_MAX_NS if previous_ns is None else previous_ns


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
    return follows(t, x, y, p, width, height, earliest_ns)


@kernel_part
def follows(
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    width: int,
    height: int,
    earliest_ns: int,
) -> bool:
    """Whether time never goes back nor leaves what is possible, and all coordinates and polarities fit the sensor.

    False as well for arrays of unlike lengths, or of integers of other sizes: for those kernels are compiled, too.
    """
    if not len(t) == len(x) == len(y) == len(p):
        return False
    if t.itemsize != TIME_BYTES or not x.itemsize == y.itemsize == COORDINATE_BYTES or p.itemsize != 1:
        return False
    if len(t) == 0:
        return True
    # One loop an array, by index, without early exit, in 32 bits: the compiler vectorises these and nothing else. What
    # is negative, in arrays of signed integers, is far off the sensor as an unsigned one.
    room = np.int32(0)
    x_max, y_max, p_max = np.int32(width - 1), np.int32(height - 1), np.int32(1)
    for i in range(len(x)):
        room = np.int32(room | np.int32(x_max - np.int32(np.uint16(x[i]))))
    for i in range(len(y)):
        room = np.int32(room | np.int32(y_max - np.int32(np.uint16(y[i]))))
    for i in range(len(p)):
        room = np.int32(room | np.int32(p_max - np.int32(np.uint8(p[i]))))
    steps_back = 0
    for i in range(1, len(t)):
        steps_back += t[i] < t[i - 1]
    return bool(room >= 0 and steps_back == 0 and earliest_ns <= t[0] and t[-1] < TIME_MAX_NS)


def not_following(events: Events, previous_ns: int | None) -> ConversionError:
    """What is wrong with a batch for which `follows` is false."""
    return ConversionError(_what_is_wrong(events, previous_ns))


def _what_is_wrong(events: Events, previous_ns: int | None) -> str:
    try:
        events.check_arrays()
    except EventsError as err:
        return str(err)
    first_ns, last_ns = int(events.t[0]), int(events.t[-1])
    if previous_ns is not None and first_ns < previous_ns:
        return f"event time goes back from {previous_ns} to {first_ns} ns: reset the converter to start a new stream"
    steps_back = np.count_nonzero(events.t[1:] < events.t[:-1])
    if steps_back:
        return f"event time goes back {steps_back} times in a batch from {first_ns} ns: sort the events by time"
    if not -TIME_MAX_NS < first_ns <= last_ns < TIME_MAX_NS:
        return f"event times {first_ns} to {last_ns} ns are impossible: give nanoseconds since an epoch"
    place = f"({int(events.x.max())}, {int(events.y.max())})"
    size = f"{events.width}x{events.height}"
    return f"an event at {place} or a polarity of {int(events.p.max())} does not fit a {size} sensor"
