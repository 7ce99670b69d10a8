"""Adaptive Time-Surface with Linear Time Decay: frames that end when they hold enough information (section 3.1)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from etd_ros.boxes import Box
from etd_ros.conversion.accumulator import AccumulatingConverter, FrameAccumulator
from etd_ros.conversion.cell_map import DURATION_MAX_NS
from etd_ros.conversion.frame import ENDED_BY_NZGE, Frame
from etd_ros.conversion.kernels import BY_NZGE, NEW_BATCH, Step
from etd_ros.conversion.nzge import CELL_SIZE, CELL_SIZE_MAX, LOG_BASE
from etd_ros.events import Events
from etd_ros.parameters import ParameterError, Parameters, parameter

PAPER_INTERVAL = (0.0832, 0.0927)
"""[alpha, beta] from the paper's 100 sampled frames: `interval_from_statistics(mean=0.08795, std=0.02394, n=100)`."""

NZGE_MIN = 1e-6
"""Least alpha: a single event is more."""

ENTROPY_SENSOR, ENTROPY_TARGETS = "sensor", "targets"

_NO_FRAMES: Iterator[Frame] = iter(())
"""Of the many small messages that finish none."""

Regions: TypeAlias = "Callable[[], Sequence[Box] | None]"
"""Tells where NZGE is to be measured now; None: everywhere."""


@dataclass(frozen=True)
class AtsltdConfig(Parameters):
    """When an ATSLTD frame ends."""

    nzge_interval: tuple[float, float] = parameter(
        PAPER_INTERVAL,
        "[alpha, beta]: a frame ends at NZGE >= alpha; above beta it is an overshoot",
        low=NZGE_MIN,
        high=1.0,
    )
    cell_size: int = parameter(CELL_SIZE, "Side r of an entropy cell (pixels)", low=2, high=CELL_SIZE_MAX)
    log_base: float = parameter(LOG_BASE, "Base of the entropy's logarithm; 256 normalises to [0, 1]", low=1.001)
    max_duration_s: float = parameter(
        0.1, "Longest frame (s); quiet or noisy scenes end frames by it", low=1e-6, high=DURATION_MAX_NS / 1e9
    )
    min_duration_s: float = parameter(
        0.0, "Shortest frame that NZGE ends (s); 0 is the paper's", low=0.0, high=DURATION_MAX_NS / 1e9
    )
    entropy_region: str = parameter(
        ENTROPY_SENSOR,
        "Where NZGE is measured: over the whole sensor (paper), or over the targets' search regions once there are any",
        choices=(ENTROPY_SENSOR, ENTROPY_TARGETS),
    )
    fine_share: float = parameter(
        0.45,
        "Fine frames (etd-plus) end at this share of nzge_interval: about half a pixel of motion instead of three",
        low=0.01,
        high=1.0,
    )
    fine_max_duration_s: float = parameter(0.005, "Longest fine frame (s)", low=1e-6, high=DURATION_MAX_NS / 1e9)
    fine_min_duration_s: float = parameter(
        0.001,
        "Shortest fine frame that NZGE ends (s): where events are many, frames would be more than a tracker can take",
        low=0.0,
        high=DURATION_MAX_NS / 1e9,
    )
    check_stride: int = parameter(50, "Distance of the checks of NZGE (events)", low=1, high=10_000)

    def __post_init__(self) -> None:
        super().__post_init__()
        alpha, beta = self.nzge_interval
        if alpha > beta:
            msg = f"parameter nzge_interval = [{alpha}, {beta}] is empty: give [alpha, beta] with alpha <= beta"
            raise ParameterError(msg)

    @property
    def follows_targets(self) -> bool:
        """Whether NZGE is measured in the targets' search regions, so that each frame waits for those of the last."""
        return self.entropy_region == ENTROPY_TARGETS

    def fine(self) -> AtsltdConfig:
        """The same for fine frames, which end at `fine_share` of the interval or after `fine_max_duration_s`, not
        before `fine_min_duration_s`."""
        alpha, beta = (max(NZGE_MIN, self.fine_share * limit) for limit in self.nzge_interval)
        return dataclasses.replace(
            self,
            nzge_interval=(alpha, beta),
            min_duration_s=self.fine_min_duration_s,
            max_duration_s=self.fine_max_duration_s,
        )


class AtsltdConverter(AccumulatingConverter):
    """Events to ATSLTD frames; a `Converter`.

    A frame starts at T_{i-1}, the end of the last one (the stream's first event starts the first). It ends with its
    k-th event, T_i = t_k, at the first check that finds NZGE >= alpha (exact, of the frame as it would be read out
    then), t_k > T_{i-1} and t_k >= T_{i-1} + min_duration_s. Checks lie on the multiples of check_stride, counted from
    the frame's first event, so that batches do not matter, and are left out where they cannot or will hardly succeed:

    - where a bound of NZGE is below alpha: no cell has more entropy than with distinct grey levels (paper equation 4),
      which its number of event pixels tells, and that is counted as the events come. It holds for alpha up to half of
      what a full channel can have, 0.25 for the defaults; for a larger alpha it is not used;
    - where the bound less what equal levels had cost it at the last look at levels of this frame (at first in a sample
      of the cells, then in the check that failed) is below alpha. That is a prediction, so there is an exact check
      anyway when the frame has grown by an eighth of its events since that look;
    - from the ninth failed check of a frame on the distance doubles, up to that eighth: a frame whose NZGE stays just
      below alpha costs no more than a few readouts.

    So while NZGE stays at alpha or above, a frame ends at most an eighth of its events and one stride late
    (docs/conversion.md: how late, measured).

    Where `regions` names boxes, NZGE is measured in the cells that have a pixel in one of them, and a small target in
    a quiet scene ends frames as a busy background does not. It is asked once, before a frame's first event.

    If an event comes later than max_duration_s after the frame's start, or the time of `last_at_most` where that is
    shorter, the frame ends there without it (`FrameEnd.TIME_LIMIT`).
    """

    def __init__(
        self, width: int, height: int, config: AtsltdConfig | None = None, *, regions: Regions = lambda: None
    ) -> None:
        """Prepare for a sensor of width x height pixels.

        Args:
            width: pixels.
            height: pixels.
            config: when frames end.
            regions: the targets' search regions; asked if config.entropy_region says so.

        Raises:
            EventsError: an impossible sensor size.
        """
        self.config = config or AtsltdConfig()
        self.overshoots = 0
        """Frames so far whose NZGE had passed beta when it was checked."""
        self._at_least_s, self._at_most_s = 0.0, math.inf
        self._next_durations_ns: tuple[int, int] | None = None
        self._regions = regions if self.config.follows_targets else None
        self._is_changing = self._regions is not None
        super().__init__(FrameAccumulator(width, height, self.config.cell_size, self.config.log_base))
        self._take_on(*self._durations_ns())

    def last_at_least(self, duration_s: float) -> None:
        """Have the frames from the next one on last at least so long (s), or as configured where that is longer."""
        self._at_least_s = duration_s
        self._next_durations_ns = self._durations_ns()
        self._is_changing = True

    def last_at_most(self, duration_s: float) -> None:
        """Have the frames from the next one on last at most so long (s), or as configured where that is shorter. They
        last as long as `last_at_least` says nevertheless."""
        self._at_most_s = duration_s
        self._next_durations_ns = self._durations_ns()
        self._is_changing = True

    def _durations_ns(self) -> tuple[int, int]:
        config = self.config
        longest_s = min(max(self._at_most_s, self._at_least_s), config.max_duration_s)
        return round(max(self._at_least_s, config.min_duration_s) * 1e9), max(1, round(longest_s * 1e9))

    def convert(self, events: Events) -> Iterator[Frame]:
        """See `Converter.convert`; the events up to the first frame are added at once."""
        if self._is_changing:
            self._begin_frame()
        step = self._accumulator.advance(events, NEW_BATCH)
        return self._frames(events, step) if step is not None else _NO_FRAMES

    def _begin_frame(self) -> None:
        """Take on what has been asked for the next frame, if one begins."""
        accumulator = self._accumulator
        if self._regions is not None and accumulator.events == 0:
            accumulator.count_in(self._regions())
        if self._next_durations_ns is not None and accumulator.events == 0:
            # Not before: the frame under way may hold events from after its new end.
            self._take_on(*self._next_durations_ns)
            self._next_durations_ns = None
            self._is_changing = self._regions is not None

    def _take_on(self, min_duration_ns: int, max_duration_ns: int) -> None:
        self._max_duration_ns = max_duration_ns
        config = self.config
        self._accumulator.end_frames(min_duration_ns, max_duration_ns, config.nzge_interval[0], config.check_stride)

    def _frames(self, events: Events, step: Step | None) -> Iterator[Frame]:
        """The frames of a batch, by steps from one to the next; the first step has been made."""
        accumulator, count = self._accumulator, len(events.t)
        _, beta = self.config.nzge_interval
        frame: Frame | None
        while step is not None:
            end, i, event_ns, nzge, frame_events = step
            if end == BY_NZGE:
                frame = accumulator.hand_out(event_ns, ENDED_BY_NZGE, nzge, frame_events)
                if nzge > beta:
                    self.overshoots += 1
            else:
                frame = accumulator.skip_late(self._max_duration_ns, step)
            if frame is not None:
                yield frame
            if i == count:
                return
            if self._is_changing:
                self._begin_frame()
            step = accumulator.advance(events, i)
