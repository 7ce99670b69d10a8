"""An event frame, and what turns events into frames."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np
import numpy.typing as npt

from etd_ros.errors import EtdError
from etd_ros.events import Events


class ConversionError(EtdError):
    """Events that do not fit the converter, or a converter that cannot be built."""


class FrameEnd(str, Enum):
    """Why a frame was finished."""

    NZGE = "nzge"
    """Its information reached the confidence interval."""
    TIME_LIMIT = "time_limit"
    """It had lasted for the longest time allowed."""
    WINDOW = "window"
    """A fixed time window was over."""
    COUNT = "count"
    """A fixed number of events was reached."""


@dataclass(frozen=True, slots=True)
class Frame:
    """A finished frame.

    Attributes:
        stamp_ns: T_i, the time of its end (ns).
        start_ns: T_{i-1}, the time of its start (ns).
        data: uint8, shape (height, width, 2), channel 0 On and 1 Off; 0 no event, 255 an event at T_i.
        events: number of events in it.
        nzge: its exact Non-Zero Grid Entropy.
        end: why it was finished.
    """

    stamp_ns: int
    start_ns: int
    data: npt.NDArray[np.uint8]
    events: int
    nzge: float
    end: FrameEnd

    def __init__(
        self,
        stamp_ns: int,
        start_ns: int,
        data: npt.NDArray[np.uint8],
        events: int,
        nzge: float,
        end: FrameEnd,
    ) -> None:
        # What the generated method does, in half its time.
        _set_stamp_ns(self, stamp_ns)
        _set_start_ns(self, start_ns)
        _set_data(self, data)
        _set_events(self, events)
        _set_nzge(self, nzge)
        _set_end(self, end)


_set_stamp_ns, _set_start_ns, _set_data, _set_events, _set_nzge, _set_end = (
    getattr(Frame, field.name).__set__ for field in dataclasses.fields(Frame)
)


class Converter(Protocol):
    """Events in, frames out. The frames do not depend on how the events were cut into batches."""

    def convert(self, events: Events) -> Iterator[Frame]:
        """Take a batch that follows the last one in time; yield the frames that it finishes.

        Raises:
            ConversionError: the batch is of another sensor size than the converter.
        """
        ...

    def reset(self) -> None:
        """Forget the unfinished frame: the next batch starts a new stream."""
        ...
