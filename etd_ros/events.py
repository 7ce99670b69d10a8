"""The one in-memory form of events: four parallel arrays and the sensor's size."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from etd_ros.errors import EtdError

EVENT_DTYPE = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
"""Structured form: time (ns), column, row, polarity (1 On, 0 Off)."""

SENSOR_SIZE_MAX = 65535
SENSOR_PIXELS_MAX = 2**25
"""Most pixels that state is kept for; a message that claims more is damaged, and would take all memory."""


class EventsError(EtdError):
    """Arrays that are not events of one sensor."""


@dataclass(frozen=True, slots=True)
class Events:
    """A batch of events in time order. The arrays are shared, never copied, by slicing.

    Attributes:
        t: time on the ROS clock (ns), int64, shape (n,), not decreasing.
        x: column from the left, uint16, shape (n,), below `width`.
        y: row from the top, uint16, shape (n,), below `height`.
        p: polarity, uint8, shape (n,), 1 On and 0 Off.
        width: sensor width (pixels).
        height: sensor height (pixels).
    """

    t: npt.NDArray[np.int64]
    x: npt.NDArray[np.uint16]
    y: npt.NDArray[np.uint16]
    p: npt.NDArray[np.uint8]
    width: int
    height: int

    def __init__(
        self,
        t: npt.NDArray[np.int64],
        x: npt.NDArray[np.uint16],
        y: npt.NDArray[np.uint16],
        p: npt.NDArray[np.uint8],
        width: int,
        height: int,
    ) -> None:
        # What the generated method does, in half its time: every message and every slice makes events.
        _set_t(self, t)
        _set_x(self, x)
        _set_y(self, y)
        _set_p(self, p)
        _set_width(self, width)
        _set_height(self, height)

    @classmethod
    def empty(cls, width: int, height: int) -> Events:
        """No events of a sensor of this size."""
        return cls(
            np.empty(0, np.int64), np.empty(0, np.uint16), np.empty(0, np.uint16), np.empty(0, np.uint8), width, height
        )

    @classmethod
    def from_structured(cls, array: npt.NDArray[np.void], width: int, height: int) -> Events:
        """Events from an array with the fields t (ns), x, y, p, checked.

        Raises:
            EventsError: a field is missing, or `check` fails.
        """
        missing = [name for name in ("t", "x", "y", "p") if name not in (array.dtype.names or ())]
        if missing:
            msg = f"structured events lack the fields {', '.join(missing)}: use EVENT_DTYPE"
            raise EventsError(msg)
        fields = {name: np.ascontiguousarray(array[name], dtype=EVENT_DTYPE[name]) for name in ("t", "x", "y", "p")}
        events = cls(**fields, width=width, height=height)
        events.check()
        return events

    def to_structured(self) -> npt.NDArray[np.void]:
        """A copy as a structured array of EVENT_DTYPE, shape (n,)."""
        array = np.empty(len(self), EVENT_DTYPE)
        array["t"], array["x"], array["y"], array["p"] = self.t, self.x, self.y, self.p
        return array

    def check(self) -> None:
        """Verify what the attributes promise; O(n), for data that does not come from our own decoders.

        Raises:
            EventsError: sizes, lengths, dtypes, order or a coordinate are wrong.
        """
        check_sensor_size(self.width, self.height)
        self.check_arrays()
        if not len(self):
            return
        if (self.t[1:] < self.t[:-1]).any():
            msg = f"events.t decreases at event {int(np.argmax(self.t[1:] < self.t[:-1])) + 1}: sort the events by time"
            raise EventsError(msg)
        if int(self.x.max()) >= self.width or int(self.y.max()) >= self.height or int(self.p.max()) > 1:
            msg = (
                f"an event at ({int(self.x.max())}, {int(self.y.max())}) or a polarity of {int(self.p.max())} "
                f"does not fit a {self.width}x{self.height} sensor"
            )
            raise EventsError(msg)

    def check_arrays(self) -> None:
        """Verify dtypes and lengths.

        Raises:
            EventsError: one is wrong.
        """
        for name in ("t", "x", "y", "p"):
            array = getattr(self, name)
            if array.dtype != EVENT_DTYPE[name] or array.shape != (len(self),):
                msg = f"events.{name} is {array.dtype} {array.shape}, not {EVENT_DTYPE[name]} ({len(self)},)"
                raise EventsError(msg)

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, index: slice) -> Events:
        """The events of a slice, as views."""
        return Events(self.t[index], self.x[index], self.y[index], self.p[index], self.width, self.height)

    def between(self, start_ns: int, end_ns: int) -> Events:
        """The events with start_ns <= t < end_ns, as views."""
        first, last = np.searchsorted(self.t, (start_ns, end_ns))
        return self[int(first) : int(last)]


_set_t, _set_x, _set_y, _set_p, _set_width, _set_height = (
    getattr(Events, field.name).__set__ for field in dataclasses.fields(Events)
)


def concatenate(batches: Sequence[Events]) -> Events:
    """One batch of all events, in the order given.

    Raises:
        EventsError: no batch, or batches of different sensor sizes.
    """
    if not batches or len({(batch.width, batch.height) for batch in batches}) != 1:
        msg = "concatenate needs at least one batch, all of one sensor size"
        raise EventsError(msg)
    first = batches[0]
    if len(batches) == 1:
        return first
    t, x, y, p = (np.concatenate([getattr(batch, name) for batch in batches]) for name in ("t", "x", "y", "p"))
    return Events(t, x, y, p, first.width, first.height)


def check_sensor_size(width: int, height: int) -> None:
    """Refuse sizes that no sensor has.

    Raises:
        EventsError: width or height below 1 or above 65535 pixels.
    """
    if not (1 <= width <= SENSOR_SIZE_MAX and 1 <= height <= SENSOR_SIZE_MAX):
        msg = f"sensor size {width}x{height} is impossible: width and height must lie in 1..{SENSOR_SIZE_MAX}"
        raise EventsError(msg)


def check_pixel_map(width: int, height: int) -> None:
    """Refuse sizes of which no state per pixel can be kept.

    Raises:
        EventsError: an impossible size, or more than 2^25 pixels.
    """
    check_sensor_size(width, height)
    if width * height > SENSOR_PIXELS_MAX:
        msg = f"sensor size {width}x{height} is impossible: no sensor has more than {SENSOR_PIXELS_MAX} pixels"
        raise EventsError(msg)
