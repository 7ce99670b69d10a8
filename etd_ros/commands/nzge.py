"""`nzge RECORDING`: the exact NZGE over time, as frames grow and where they end."""

from __future__ import annotations

import argparse
import csv
import dataclasses
import math
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from etd_ros.commands.clean_streams import without_noise
from etd_ros.commands.progress import with_progress
from etd_ros.commands.recording_options import add_recording_options
from etd_ros.commands.track import read_settings
from etd_ros.conversion import ConversionError, Frame, FrameEnd, NoiseFilterConfig, nzge
from etd_ros.conversion.calibration import frame_data
from etd_ros.engine import CONVERSIONS, FrameSource, nzge_interval
from etd_ros.events import Events, concatenate
from etd_ros.output_files import check_outputs, check_pictures, write_beside, written_beside
from etd_ros.plots import NzgeCurve, check_matplotlib, nzge_png
from etd_ros.recordings import open_recording, recording_files
from etd_ros.settings import Settings
from etd_ros.stream import StreamBatch

COLUMNS = ("stamp_ns", "frame", "start_ns", "events", "nzge", "end")
NS_PER_S = 1e9


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("nzge", help="the information in frames over time", description=__doc__)
    add_recording_options(parser)
    parser.add_argument("--output", type=Path, metavar="CURVE.csv", help=f"a row per point: {','.join(COLUMNS)}")
    parser.add_argument("--plot", type=Path, metavar="CURVE.png", help="plot of the curve (needs Matplotlib)")
    parser.add_argument(
        "--points", type=int, default=20, help="points of the curve in a frame, its end among them (default: 20)"
    )
    parser.add_argument(
        "--frames", type=int, default=12, help="frames of which the plot shows the growth (default: 12)"
    )
    parser.add_argument("--from", type=float, default=0.0, dest="from_s", help="when these begin (s) (default: 0)")
    parser.add_argument("--conversion", choices=CONVERSIONS, default=CONVERSIONS[0], help="how events become frames")
    parser.add_argument(
        "--config", type=Path, metavar="PARAMETERS.yaml", help="a ROS 2 parameter file, as for the nodes"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="one parameter, e.g. atsltd.check_stride=1"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Convert the recording, write the curve, print a summary.

    Raises:
        ConversionError: an option out of range, or a recording that finishes no frame.
    """
    _check_options(options)
    settings = read_settings(options.config, options.set)
    interval = nzge_interval(options.conversion, settings)
    summary = _Summary(options.from_s, options.frames if options.plot else 0)
    with ExitStack() as stack:
        recording = stack.enter_context(open_recording(options.recording, topic=options.topic, size=options.size))
        writer = stack.enter_context(_CurveWriter(options.output)) if options.output else None
        streams = without_noise(recording.streams(settings.stream), settings.noise_filter)
        batches = stack.enter_context(with_progress(streams, "converting"))
        for frame, events in frames_with_events(batches, options.conversion, settings):
            is_shown = summary.add(frame)
            if writer is None and not is_shown:
                continue
            points = growth(frame, events, options.points, settings)
            if is_shown:
                summary.growth.append((frame, points))
            if writer is not None:
                writer.write(frame, points)
        if not summary.frames:
            msg = f"{options.recording}: no frame is finished in it: record longer, or lower atsltd.nzge_interval"
            raise ConversionError(msg)
        if options.plot is not None:
            curve = summary.curve(interval)
            write_beside(options.plot, nzge_png(curve, options.recording.name))
    print(summary.text(interval), end="")
    return 0


@dataclass(frozen=True, slots=True)
class GrowthPoint:
    """NZGE of an unfinished frame.

    Attributes:
        stamp_ns: time of its last event (ns).
        events: number of its events.
        nzge: its exact NZGE, if it ended there.
    """

    stamp_ns: int
    events: int
    nzge: float


def frames_with_events(
    batches: Iterable[StreamBatch], conversion: str, settings: Settings
) -> Iterator[tuple[Frame, Events]]:
    """Every frame and the events in it, in order; events that no frame is finished with are left out."""
    # The noise filter has done its work on the batches, which the events of a frame are taken from.
    settings = dataclasses.replace(settings, noise_filter=NoiseFilterConfig())
    source: FrameSource | None = None
    size = (0, 0)
    held: list[Events] = []
    for batch in batches:
        events = batch.events
        if source is None or (events.width, events.height) != size:
            size = events.width, events.height
            source, held = FrameSource(conversion, *size, settings), []
        elif batch.restart is not None:
            source.reset()
            held = []
        held.append(events)
        for frame in source.frames(events):
            known = concatenate(held)
            yield frame, known[: frame.events]
            held = [known[frame.events :]]


def growth(frame: Frame, events: Events, points: int, settings: Settings) -> list[GrowthPoint]:
    """NZGE at `points` - 1 equally distant numbers of events, up to but not at the frame's end."""
    counts = np.unique(np.linspace(0, len(events), points + 1).round().astype(int))[1:-1]
    return [
        GrowthPoint(int(events.t[count - 1]), int(count), _nzge(events[:count], frame.start_ns, settings))
        for count in counts
    ]


def _nzge(events: Events, start_ns: int, settings: Settings) -> float:
    return nzge(frame_data(events, start_ns), settings.atsltd.cell_size, settings.atsltd.log_base)


def _check_options(options: argparse.Namespace) -> None:
    for name, value in (("--points", options.points), ("--frames", options.frames)):
        if value < 1:
            msg = f"{name} {value} is out of range: give 1 or more"
            raise ConversionError(msg)
    if not math.isfinite(options.from_s):
        msg = f"--from {options.from_s} is no time: give seconds since the first frame's start"
        raise ConversionError(msg)
    inputs = [*recording_files(options.recording), options.config]
    check_outputs(options.output, options.plot, inputs=inputs)
    check_pictures(options.plot)
    if options.plot is not None:
        check_matplotlib()


class _CurveWriter:
    """Writes the CSV file; it appears under its name only when the `with` block succeeds."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stack = ExitStack()
        self._writer: Any = None
        self._frame = 0

    def __enter__(self) -> _CurveWriter:
        self._writer = csv.writer(self._stack.enter_context(written_beside(self._path)), lineterminator="\n")
        self._writer.writerow(COLUMNS)
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.__exit__(*error)

    def write(self, frame: Frame, points: Iterable[GrowthPoint]) -> None:
        """Add a frame's points and its end."""
        for point in points:
            self._writer.writerow((point.stamp_ns, self._frame, frame.start_ns, point.events, f"{point.nzge:.6f}", ""))
        end = (frame.stamp_ns, self._frame, frame.start_ns, frame.events, f"{frame.nzge:.6f}", frame.end.value)
        self._writer.writerow(end)
        self._frame += 1


@dataclass(slots=True)
class _Summary:
    """What is kept of every frame: little enough for hours of recording."""

    from_s: float
    frames_shown: int
    stamps_ns: list[int] = field(default_factory=list)
    durations_ns: list[int] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    ends: list[FrameEnd] = field(default_factory=list)
    growth: list[tuple[Frame, list[GrowthPoint]]] = field(default_factory=list)
    first_ns: int | None = None

    @property
    def frames(self) -> int:
        """Number of frames so far."""
        return len(self.values)

    def add(self, frame: Frame) -> bool:
        """Count a frame; whether its growth is to be shown."""
        self.first_ns = frame.start_ns if self.first_ns is None else self.first_ns
        self.stamps_ns.append(frame.stamp_ns)
        self.durations_ns.append(frame.stamp_ns - frame.start_ns)
        self.values.append(frame.nzge)
        self.ends.append(frame.end)
        is_late_enough = self._seconds(frame.start_ns) >= self.from_s
        return is_late_enough and len(self.growth) < self.frames_shown

    def curve(self, interval: tuple[float, float]) -> NzgeCurve:
        """The curve to plot."""
        end_times = np.array([self._seconds(stamp_ns) for stamp_ns in self.stamps_ns])
        shown = [self._sawtooth(frame, points) for frame, points in self.growth]
        return NzgeCurve(shown, end_times, np.array(self.values), self.ends, interval)

    def text(self, interval: tuple[float, float]) -> str:
        """A few lines on all frames."""
        values = np.array(self.values)
        reasons = {end: self.ends.count(end) for end in FrameEnd if end in self.ends}
        return (
            f"frames: {self.frames} ({', '.join(f'{count} by {end.value}' for end, count in reasons.items())})\n"
            f"duration: median {np.median(self.durations_ns) / 1e6:.3f} ms\n"
            f"NZGE at their ends: mean {values.mean():.4f}, {values.min():.4f} to {values.max():.4f}\n"
            f"[alpha, beta] = [{interval[0]:.4f}, {interval[1]:.4f}]: {np.count_nonzero(values < interval[0])} below, "
            f"{np.count_nonzero(values > interval[1])} above\n"
        )

    def _seconds(self, stamp_ns: int) -> float:
        return (stamp_ns - (self.first_ns or 0)) / NS_PER_S

    def _sawtooth(
        self, frame: Frame, points: list[GrowthPoint]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        stamps_ns = [frame.start_ns, *(point.stamp_ns for point in points), frame.stamp_ns]
        values = [0.0, *(point.nzge for point in points), frame.nzge]
        return np.array([self._seconds(stamp_ns) for stamp_ns in stamps_ns]), np.array(values)
