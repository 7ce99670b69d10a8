"""Removal of background activity: sensor noise has no neighbours, contours have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.conversion.batches import TIME_MAX_NS, check_batch
from etd_ros.events import Events, check_pixel_map
from etd_ros.parameters import Parameters, parameter

NEVER_NS = -TIME_MAX_NS
WINDOW_MAX_S = 10.0


@dataclass(frozen=True)
class NoiseFilterConfig(Parameters):
    """What counts as noise."""

    window_s: float = parameter(
        0.0,
        "An event without one next to it in this time before is noise (s); 0 is off",
        low=0.0,
        high=WINDOW_MAX_S,
    )


class BackgroundActivityFilter:
    """Passes an event if one of its 8 neighbours had an event, of either polarity, at most window_s before it.

    The neighbour's event must come earlier in the stream; it may itself be noise. The pixel's own events do not count,
    so hot pixels are removed as well. What passes does not depend on how the events were cut into batches.
    """

    def __init__(self, width: int, height: int, config: NoiseFilterConfig | None = None) -> None:
        """Prepare for a sensor of width x height pixels.

        Raises:
            EventsError: an impossible sensor size.
        """
        check_pixel_map(width, height)
        self.config = config or NoiseFilterConfig()
        self._width = width
        self._height = height
        self._window_ns = round(self.config.window_s * 1e9)
        self._previous_ns: int | None = None
        # A border of one pixel that never has events spares the kernel all comparisons with the sensor's size.
        self._last_ns = np.full((height + 2, width + 2), NEVER_NS, np.int64)

    def filter(self, events: Events) -> Events:
        """The events of the stream's next batch that pass, in order; the batch itself if the filter is off.

        Raises:
            ConversionError: another sensor size, a coordinate or polarity off the sensor, or time going back.
        """
        check_batch(events, self._width, self._height, self._previous_ns)
        if not len(events):
            return events
        self._previous_ns = int(events.t[-1])
        if not self._window_ns:
            return events
        keep = np.empty(len(events), np.bool_)
        _supported(self._last_ns, events.t, events.x, events.y, self._window_ns, keep)
        t, x, y, p = events.t[keep], events.x[keep], events.y[keep], events.p[keep]
        return Events(t, x, y, p, events.width, events.height)

    def reset(self) -> None:
        """Forget all events: the next batch starts a new stream."""
        self._previous_ns = None
        self._last_ns.fill(NEVER_NS)


@njit(cache=True, nogil=True)
def _supported(
    last_ns: npt.NDArray[np.int64],
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    window_ns: int,
    keep: npt.NDArray[np.bool_],
) -> None:
    for i in range(len(t)):
        row = y[i] + 1
        column = x[i] + 1
        oldest_ns = t[i] - window_ns
        keep[i] = (
            last_ns[row - 1, column - 1] >= oldest_ns
            or last_ns[row - 1, column] >= oldest_ns
            or last_ns[row - 1, column + 1] >= oldest_ns
            or last_ns[row, column - 1] >= oldest_ns
            or last_ns[row, column + 1] >= oldest_ns
            or last_ns[row + 1, column - 1] >= oldest_ns
            or last_ns[row + 1, column] >= oldest_ns
            or last_ns[row + 1, column + 1] >= oldest_ns
        )
        last_ns[row, column] = t[i]
