"""`calibrate RECORDING`: the NZGE interval of a sensor, from frames with clear contours, as YAML for the nodes."""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml
from rich.console import Console
from rich.progress import Progress

from etd_ros.commands.clean_streams import without_noise
from etd_ros.commands.progress import with_progress
from etd_ros.commands.recording_options import add_recording_options
from etd_ros.commands.track import read_settings
from etd_ros.conversion import ConversionError
from etd_ros.conversion.calibration import (
    SAMPLES_MIN,
    Calibration,
    CalibrationConfig,
    Sample,
    calibrate,
    clear_frames,
)
from etd_ros.output_files import check_outputs, check_pictures, write_beside
from etd_ros.overlay import Picture
from etd_ros.parameters import ParameterError
from etd_ros.plots import busy_window, caption_frame, check_matplotlib, histogram_png, sheet_png
from etd_ros.recordings import open_recording, recording_files
from etd_ros.settings import Settings
from etd_ros.stream import StreamBatch

NEIGHBOUR_SCALES = (0.5, 1.0, 2.0)
COMPARED = 6
"""Instants at which the sheet shows the shorter and the longer frame too."""

COMPARED_WIDTH = 256
CHOSEN_WIDTH = 152
BAR_WIDTH = 50
TEXT_BINS = 12
DECIMALS = 4
"""Of alpha and beta, as in the paper."""


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("calibrate", help="find a sensor's NZGE interval", description=__doc__)
    add_recording_options(parser)
    parser.add_argument("--output", type=Path, metavar="FILE.yaml", help="parameter file for the nodes and for track")
    parser.add_argument("--sheet", type=Path, metavar="FILE.png", help="pictures of the frames that were chosen")
    parser.add_argument("--histogram", type=Path, metavar="FILE.png", help="plot of their NZGE (needs Matplotlib)")
    parser.add_argument("--samples", type=int, default=100, help="instants to take a frame at (default: %(default)s)")
    parser.add_argument(
        "--significance", type=float, default=0.05, help="of the t-interval, in (0, 1) (default: %(default)s)"
    )
    parser.add_argument(
        "--config", type=Path, metavar="PARAMETERS.yaml", help="a ROS 2 parameter file, as for the nodes"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="one parameter, e.g. noise_filter.window_s=0.01",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Sample frames, compute the interval, print and write it.

    Raises:
        ConversionError: too few clear frames, or an option out of range.
        ParameterError: a significance at which the interval is no longer one of NZGE.
    """
    _check_options(options)
    settings = read_settings(options.config, options.set)
    name = options.recording.name
    sheet = _Sheet(options.samples) if options.sheet else None
    values: list[float] = []
    for sample in _samples(options, settings):
        values.append(sample.nzge)
        if sheet is not None:
            sheet.add(sample)
    try:
        calibration = calibrate(np.array(values), options.significance)
    except ConversionError as err:
        msg = f"{options.recording}: {err}"
        raise ConversionError(msg) from err
    # An interval that the nodes would refuse is refused here, before anything is written.
    try:
        dataclasses.replace(settings.atsltd, nzge_interval=_rounded(calibration.interval))
    except ParameterError as err:
        msg = f"--significance {options.significance:g} gives no interval of NZGE: {err}"
        raise ParameterError(msg) from err
    if sheet is not None:
        write_beside(options.sheet, sheet.png(name))
    if options.histogram is not None:
        write_beside(options.histogram, histogram_png(calibration.values, calibration.interval, name))
    if options.output is not None:
        write_beside(options.output, parameter_file(calibration, settings, name, options.significance))
    _print(calibration, options.samples)
    return 0


def parameter_file(calibration: Calibration, settings: Settings, recording: str, significance: float) -> str:
    """A ROS 2 parameter file with the interval and what it holds for: cells, logarithm, noise filter."""
    parameters = {
        "noise_filter": {"window_s": settings.noise_filter.window_s},
        "atsltd": {
            "nzge_interval": list(_rounded(calibration.interval)),
            "cell_size": settings.atsltd.cell_size,
            "log_base": settings.atsltd.log_base,
        },
    }
    lines = [
        f"# NZGE interval, made by: python -m etd_ros calibrate {json.dumps(recording)}",
        f"# {len(calibration.values)} frames with clear contours: mean {calibration.mean:.5f}, "
        f"standard deviation {calibration.std:.5f}, significance {significance:g}",
        yaml.safe_dump({"/**": {"ros__parameters": parameters}}, sort_keys=False, default_flow_style=None),
    ]
    return "\n".join(lines)


def _rounded(interval: tuple[float, float]) -> tuple[float, float]:
    return round(interval[0], DECIMALS), round(interval[1], DECIMALS)


@dataclass(slots=True)
class _Sheet:
    """Pictures of the frames as they come, so that their events need not be kept."""

    instants: int
    height_per_width: float = 0.0
    """Of the first frame; a recording in which the sensor size changes has others, which are stretched."""
    chosen: list[Picture] = field(default_factory=list)
    compared: list[Picture] = field(default_factory=list)

    def add(self, sample: Sample) -> None:
        """Draw a sample's frame, and at some instants the shorter and the longer one."""
        data = sample.frame_data()
        self.height_per_width = self.height_per_width or data.shape[0] / data.shape[1]
        window = busy_window(data)
        if len(self.chosen) % max(1, self.instants // COMPARED) == 0:
            captions = ("half the events", f"chosen: NZGE {sample.nzge:.4f}", "twice the events")
            for scale, caption in zip(NEIGHBOUR_SCALES, captions, strict=True):
                picture = caption_frame(sample.frame_data(scale)[window], self._size(COMPARED_WIDTH), caption)
                self.compared.append(picture)
        caption = f"{sample.nzge:.4f} {sample.duration_s * 1e3:.4g} ms"
        self.chosen.append(caption_frame(data[window], self._size(CHOSEN_WIDTH), caption))

    def png(self, name: str) -> bytes:
        return sheet_png(
            [
                (f"{name}: the frame chosen at some instants, between a shorter and a longer one", self.compared, 6),
                (f"all {len(self.chosen)} frames chosen: NZGE, duration", self.chosen, 10),
            ]
        )

    def _size(self, width: int) -> tuple[int, int]:
        return width, max(1, round(width * self.height_per_width))


def _check_options(options: argparse.Namespace) -> None:
    if options.samples < SAMPLES_MIN:
        msg = f"--samples {options.samples} is out of range: an interval needs {SAMPLES_MIN} frames or more, as in 100"
        raise ConversionError(msg)
    if not 0 < options.significance < 1:
        msg = f"--significance {options.significance:g} is out of range: give a number between 0 and 1, as in 0.05"
        raise ConversionError(msg)
    inputs = [*recording_files(options.recording), options.config]
    check_outputs(options.output, options.sheet, options.histogram, inputs=inputs)
    check_pictures(options.sheet, options.histogram)
    if options.histogram is not None:
        check_matplotlib()


def _samples(options: argparse.Namespace, settings: Settings) -> Iterator[Sample]:
    """Clear frames at instants equally far apart in events: the recording is read once to count these."""
    with open_recording(options.recording, topic=options.topic, size=options.size) as recording:

        def streams() -> Iterator[StreamBatch]:
            return without_noise(recording.streams(settings.stream), settings.noise_filter)

        with with_progress(streams(), "counting") as batches:
            total = sum(len(batch.events) for batch in batches)
        console = Console(stderr=True)
        with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
            task = progress.add_task("sampling clear frames", total=total)

            def counted() -> Iterator[StreamBatch]:
                for batch in streams():
                    yield batch
                    progress.advance(task, len(batch.events))

            grid = settings.atsltd.cell_size, settings.atsltd.log_base
            yield from clear_frames(counted(), max(1, total // options.samples), CalibrationConfig(), *grid)


def _print(calibration: Calibration, samples: int) -> None:
    alpha, beta = calibration.interval
    print(f"frames with clear contours: {len(calibration.values)} ({samples} asked for)")
    print(f"NZGE: mean {calibration.mean:.5f}, standard deviation {calibration.std:.5f}")
    print(f"[alpha, beta] = [{alpha:.{DECIMALS}f}, {beta:.{DECIMALS}f}]")
    print(text_histogram(calibration), end="")


def text_histogram(calibration: Calibration) -> str:
    """A line per bin: from where on, a bar, the number of frames; bins that [alpha, beta] touches are marked."""
    counts, edges = np.histogram(calibration.values, bins=TEXT_BINS)
    alpha, beta = calibration.interval
    lines = []
    for count, low, high in zip(counts, edges, edges[1:], strict=False):
        mark = "|" if low <= beta and high >= alpha else " "
        bar = "\u2588" * round(BAR_WIDTH * count / counts.max())
        lines.append(f"{low:.4f} {mark} {bar} {count}\n")
    return "".join(lines)
