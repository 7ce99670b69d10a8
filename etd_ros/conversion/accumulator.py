"""The unfinished frame and the stream that it belongs to: what all converters share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence

from etd_ros.boxes import Box
from etd_ros.conversion.batches import BEFORE_ALL_NS, check_batch, not_following, not_of_sensor
from etd_ros.conversion.cell_map import CellStore, cell_rectangles, cells_in, count_in, make_cell_map
from etd_ros.conversion.frame import ENDED_BY_TIME, Frame, FrameEnd
from etd_ros.conversion.frame_buffers import FrameBuffers
from etd_ros.conversion.kernels import (
    BY_TIME,
    NO_END,
    NOT_FOLLOWING,
    NOT_PLAIN,
    Step,
    advance,
    advance_plain,
    empty_state,
    finish,
)
from etd_ros.conversion.nzge import CELL_SIZE, LOG_BASE
from etd_ros.events import Events, check_pixel_map


class FrameAccumulator:
    """Collects the events of one frame after the other.

    A finished frame's grey levels are the closed form of the paper's linear time decay (section 3.1, equation 2) with
    times relative to the frame's start: a pixel whose last event in the frame came at t_e has

        max(1, round(255 * (t_e - T_{i-1}) / (T_i - T_{i-1}))),

    halves rounded up, and a pixel without events 0. At least 1 keeps the events at the frame's very start (the paper's
    rule would make them vanish), and 0 means no event. In a frame of no duration every event has 255.

    Attributes:
        start_ns: T_{i-1} of the unfinished frame (ns).
        store, state: its events, and where it stands and when it ends; for the kernels.
    """

    def __init__(self, width: int, height: int, cell_size: int = CELL_SIZE, log_base: float = LOG_BASE) -> None:
        """Prepare a sensor of width x height pixels.

        Raises:
            EventsError: an impossible sensor size.
            ConversionError: cell_size or log_base out of range.
        """
        check_pixel_map(width, height)
        self.width = width
        self.height = height
        self.store: CellStore = make_cell_map(width, height, cell_size, log_base)
        self.state = empty_state()
        self._buffers = FrameBuffers(width, height, len(cells_in(self.store).sample))
        self.start_ns = 0
        self._cell_size = cell_size
        self._counted_cells = cell_rectangles(None, width, height, cell_size)
        self._has_begun = False

    @property
    def events(self) -> int:
        """Number of events in the unfinished frame."""
        return int(self.state["events"][0])

    def accept(self, events: Events) -> None:
        """Verify the next batch of the stream; the stream's first event starts its first frame.

        Raises:
            ConversionError: another sensor size, a coordinate or polarity off the sensor, or time going back.
        """
        check_batch(events, self.width, self.height, self._previous_ns)
        if events.t.size == 0:
            return
        if not self._has_begun:
            self.start_ns = events.t.item(0)
            self._has_begun = True
        self.state["previous_ns"] = events.t.item(-1)
        self.state["block_first"] = self.state["block_stop"] = 0

    @property
    def _previous_ns(self) -> int:
        """Time of the stream's last event (ns), or BEFORE_ALL_NS."""
        return int(self.state["previous_ns"].item())

    def end_frames(self, min_duration_ns: int, max_duration_ns: int, alpha: float, check_stride: int) -> None:
        """Have frames end when NZGE, looked at every check_stride events, is alpha or more and they have lasted for
        min_duration_ns, or after max_duration_ns in any case."""
        state = self.state[0]
        state["min_duration_ns"], state["max_duration_ns"] = min_duration_ns, max_duration_ns
        state["alpha"], state["check_stride"] = alpha, check_stride

    def advance(self, events: Events, first: int) -> Step | None:
        """Add events until the frame ends as `end_frames` says, or the batch is over.

        Args:
            events: a batch.
            first: the first of its events to add, or NEW_BATCH, which accepts it as `accept` does, by the same call of
                a kernel: many messages are so small that calls take longer than their events.

        Returns:
            What ends the frame, or None where the batch is over.

        Raises:
            ConversionError: as `accept` does, but when it comes to the block of events that holds what does not fit.
        """
        if events.width != self.width or events.height != self.height:
            raise not_of_sensor(events, self.width, self.height)
        if not self._has_begun:
            if len(events.t) == 0:
                return None
            self.start_ns = events.t.item(0)
        memory = (self._buffers.unfinished or self._buffers.next_one()).memory
        t, x, y, p = events.t, events.x, events.y, events.p
        step = advance_plain.call(self.store, self.state, t, x, y, p, first, self.start_ns, memory)
        if step is not None and step[0] < 0:
            if step[0] == NOT_PLAIN:
                step = advance(self.store, self.state, t, x, y, p, first, self.start_ns, memory)
            if step[0] == NOT_FOLLOWING:
                # What comes before the block in which it does not has been added.
                self._has_begun = self._has_begun or step[1] > 0
                raise not_following(events, self._previous_ns if step[1] == 0 else BEFORE_ALL_NS)
            step = None if step[0] == NO_END else step
        self._has_begun = True
        return step

    def count_in(self, boxes: Sequence[Box] | None) -> None:
        """Measure NZGE in these boxes, None for everywhere; between two frames."""
        wanted = cell_rectangles(boxes, self.width, self.height, self._cell_size)
        if wanted != self._counted_cells:
            count_in(self.store, wanted, self._cell_size)
            self._counted_cells = wanted

    def add(self, events: Events, first: int, stop: int, limit_ns: int) -> Step | None:
        """Add events first .. stop - 1 with t <= limit_ns. For converters that do not call `end_frames`, whose longest
        duration it replaces."""
        part = events if stop == len(events) else events[:stop]
        self.state["max_duration_ns"] = limit_ns - self.start_ns
        return self.advance(part, first)

    def finish(self, stamp_ns: int, end: FrameEnd) -> Frame:
        """Read the frame out and start the next one at stamp_ns."""
        nzge, events = finish.call(self.store, self.state, stamp_ns - self.start_ns, self._buffers.memory)
        return self.hand_out(stamp_ns, end, nzge, events)

    def hand_out(self, stamp_ns: int, end: FrameEnd, nzge: float, events: int) -> Frame:
        """The frame that a kernel has put into the buffers' memory; the next one starts at stamp_ns."""
        frame = Frame(stamp_ns, self.start_ns, self._buffers.hand_out(), events, nzge, end)
        self.start_ns = stamp_ns
        return frame

    def skip_late(self, max_duration_ns: int, step: Step) -> Frame | None:
        """End the frame at its longest duration because an event later than that has come, which `step` has met.

        The next frame starts there, or at that event if it would be over before it as well.

        Returns:
            The frame, or None if it holds no events.
        """
        end, _, event_ns, nzge, events = step
        limit_ns = self.start_ns + max_duration_ns
        frame = None
        if end == BY_TIME:
            frame = self.hand_out(limit_ns, ENDED_BY_TIME, nzge, events)
        elif events:
            frame = self.finish(limit_ns, ENDED_BY_TIME)
        self.start_ns = event_ns if event_ns > limit_ns + max_duration_ns else limit_ns
        return frame

    def reset(self) -> None:
        """Forget the unfinished frame and the stream."""
        finish.call(self.store, self.state, 0, self._buffers.memory)
        self._buffers.clear()
        self.state["previous_ns"] = BEFORE_ALL_NS
        self.state["expected"], self.state["expected_events"] = 0.0, 0
        self._has_begun = False


class AccumulatingConverter(ABC):
    """A `Converter` on a frame accumulator; subclasses say in `_frames` where frames end."""

    def __init__(self, accumulator: FrameAccumulator) -> None:
        self._accumulator = accumulator

    @abstractmethod
    def convert(self, events: Events) -> Iterator[Frame]:
        """Take a batch that follows the last one in time; yield the frames that it finishes.

        The batch is worked off as the iterator advances: exhaust it before the next batch.

        Raises:
            ConversionError: another sensor size, a coordinate or polarity off the sensor, or time going back. See
                `Converter.convert`.
        """

    def reset(self) -> None:
        """Forget the unfinished frame: the next batch starts a new stream."""
        self._accumulator.reset()
