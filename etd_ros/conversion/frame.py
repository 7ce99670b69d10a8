"""An event frame, and what turns events into frames."""

from __future__ import annotations

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


ENDED_BY_NZGE, ENDED_BY_TIME = FrameEnd.NZGE, FrameEnd.TIME_LIMIT
"""For each frame: to look a member up in an enumeration takes .2 us on Python 3.11."""


@dataclass(slots=True)
class Frame:
    """A finished frame. It is not made frozen: that would take three times as long.

    Attributes:
        stamp_ns: T_i, the time of its end (ns).
        start_ns: T_{i-1}, the time of its start (ns).
        data: uint8, shape (height, width, 2), channel 0 On and 1 Off; 0 no event, 255 an event at T_i. Read-only where
            a converter made it: its memory is used again once nobody holds it.
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


class Converter(Protocol):
    """Events in, frames out. The frames do not depend on how the events were cut into batches."""

    def convert(self, events: Events) -> Iterator[Frame]:
        """Take a batch that follows the last one in time; yield the frames that it finishes.

        Raises:
            ConversionError: another sensor size, a coordinate or polarity off the sensor, or time going back. A large
                batch may be verified as it is worked off, so that the iterator raises what concerns later events: what
                comes before them, but for some hundred events, is in frames then.
        """
        ...

    def reset(self) -> None:
        """Forget the unfinished frame: the next batch starts a new stream."""
        ...
