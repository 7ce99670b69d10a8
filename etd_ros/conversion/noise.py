"""Removal of background activity: sensor noise has no neighbours, contours have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from etd_ros.borrowing_kernel import borrowing_kernel
from etd_ros.buffers import ArrayPool
from etd_ros.conversion.batches import BEFORE_ALL_NS, check_batch
from etd_ros.events import Events, check_pixel_map
from etd_ros.parameters import Parameters, parameter

WINDOW_MAX_S = 10.0
INT32_MAX = 2**31 - 1

ONE = np.uint64(1)
TWO = np.uint64(2)


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

    Each pixel holds the time of its neighbours' last event: an event reads one value and writes eight, which takes no
    branch, so that noise costs no more than contours. Times count from a base that follows the stream, so that they fit
    32 bits where the window does.
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
        self._previous_ns = BEFORE_ALL_NS
        dtype: type[np.signedinteger] = np.int32 if self._window_ns <= INT32_MAX else np.int64
        self._never = int(np.iinfo(dtype).min)
        # Half of 64 bits keeps base + span in them.
        self._span_ns = INT32_MAX if dtype is np.int32 else 2**62
        self._base_ns = 0
        # A border of one pixel that never has events spares the kernel all comparisons with the sensor's size.
        self._stride = np.uint64(width + 2)
        self._neighbour_ns = np.full((height + 2) * (width + 2), self._never, dtype)
        _rebase(self._neighbour_ns, 0, self._never)  # Compiled now, not in the middle of a stream.
        self._indices = ArrayPool(np.uint32)
        self._columns = ArrayPool(np.int64, np.uint16, np.uint16, np.uint8)

    def filter(self, events: Events) -> Events:
        """The events of the stream's next batch that pass, in order; the batch itself if the filter is off.

        Their arrays are used again when nobody refers to them any more.

        Raises:
            ConversionError: another sensor size, a coordinate or polarity off the sensor, or time going back.
        """
        check_batch(events, self._width, self._height, self._previous_ns)
        if not len(events):
            return events
        if self._previous_ns == BEFORE_ALL_NS:
            self._base_ns = int(events.t[0])
        self._previous_ns = int(events.t[-1])
        if not self._window_ns:
            return events
        indices = self._find_passing(events)
        t, x, y, p = self._columns.take(len(indices))
        _gather(events.t, events.x, events.y, events.p, indices, t, x, y, p)
        return Events(t, x, y, p, events.width, events.height)

    def reset(self) -> None:
        """Forget all events: the next batch starts a new stream."""
        self._previous_ns = BEFORE_ALL_NS
        self._neighbour_ns.fill(self._never)

    def _find_passing(self, events: Events) -> npt.NDArray[np.uint32]:
        """Indices of the events that pass."""
        (passing,) = self._indices.take(len(events))
        first = count = 0
        while first < len(events):
            end = self._within_span(events.t, first)
            count = _supported(
                self._neighbour_ns,
                self._stride,
                events.t[first:end],
                events.x[first:end],
                events.y[first:end],
                first,
                self._base_ns,
                self._window_ns,
                passing,
                count,
            )
            first = end
        return passing[:count]

    def _within_span(self, t: npt.NDArray[np.int64], first: int) -> int:
        """End of the events from `first` on whose times fit the map, moving its base to `first` if that one does not.

        The base moves once in two seconds (in a century, with windows above that), so neither the pass over the map
        nor the kernel's restart counts.
        """
        shift_ns = int(t[first]) - self._base_ns
        if shift_ns > self._span_ns:
            _rebase(self._neighbour_ns, shift_ns, self._never)
            self._base_ns += shift_ns
        latest_ns = self._base_ns + self._span_ns
        return len(t) if t[-1] <= latest_ns else int(np.searchsorted(t, latest_ns, side="right"))


@borrowing_kernel
def _supported(
    neighbour_ns: npt.NDArray[np.signedinteger],
    stride: np.uint64,
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    first: int,
    base_ns: int,
    window_ns: int,
    passing: npt.NDArray[np.uint32],
    count: int,
) -> int:
    """Append the indices (from `first` on) of the events that pass to the `count` ones in `passing`; the new count."""
    # Unsigned indices spare the test for negative ones that count from the end.
    found = np.uint64(count)
    for i in range(len(t)):
        since_base_ns = t[i] - base_ns
        above = np.uint64(y[i]) * stride + np.uint64(x[i])
        own = above + stride
        below = own + stride
        latest_ns = neighbour_ns[own + ONE]
        neighbour_ns[above] = since_base_ns
        neighbour_ns[above + ONE] = since_base_ns
        neighbour_ns[above + TWO] = since_base_ns
        neighbour_ns[own] = since_base_ns
        neighbour_ns[own + TWO] = since_base_ns
        neighbour_ns[below] = since_base_ns
        neighbour_ns[below + ONE] = since_base_ns
        neighbour_ns[below + TWO] = since_base_ns
        # Always written, counted only if it passes: noise is unpredictable, and so would be a branch.
        passing[found] = first + i
        found += np.uint64(latest_ns >= since_base_ns - window_ns)
    return int(found)


@borrowing_kernel
def _rebase(neighbour_ns: npt.NDArray[np.signedinteger], shift_ns: int, never: int) -> None:
    """Let times count from a base shift_ns later; those that do not fit any more are as good as never."""
    for i in range(len(neighbour_ns)):
        neighbour_ns[i] = max(neighbour_ns[i], never + shift_ns) - shift_ns


@borrowing_kernel
def _gather(
    t: npt.NDArray[np.int64],
    x: npt.NDArray[np.uint16],
    y: npt.NDArray[np.uint16],
    p: npt.NDArray[np.uint8],
    indices: npt.NDArray[np.uint32],
    t_out: npt.NDArray[np.int64],
    x_out: npt.NDArray[np.uint16],
    y_out: npt.NDArray[np.uint16],
    p_out: npt.NDArray[np.uint8],
) -> None:
    for target in range(len(indices)):
        source = indices[target]
        t_out[target] = t[source]
        x_out[target] = x[source]
        y_out[target] = y[source]
        p_out[target] = p[source]
