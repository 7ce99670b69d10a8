"""Tracking in the Rerun viewer: pictures, boxes, scores and changes of state on the time of the data.

Boxes, scores and NZGE go there for every frame, but many frames at a time, and pictures at most 30 times a second:
logging costs a little for each call, and fine frames come by the hundred.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.afterglow import Afterglow, FrameData
from etd_ros.cadence import Cadence
from etd_ros.errors import EtdError
from etd_ros.output_files import check_outputs, renamed_at_the_end
from etd_ros.overlay import STATE_COLOURS, colour_events
from etd_ros.tracking import TargetReport, TargetState

SPAWN = "spawn"
APPLICATION = "etd_ros"
TIMELINE = "stamp"
PICTURES_PER_S, PIXELS_PER_S = 30, 6e6
"""At most; a large sensor has fewer pictures, because each takes a fortieth of a second of a core."""
PNG_OPTIONS = (cv2.IMWRITE_PNG_COMPRESSION, 1)
JPEG_OPTIONS = (cv2.IMWRITE_JPEG_QUALITY, 90)
RGB_COLOURS = {state: colour[::-1] for state, colour in STATE_COLOURS.items()}
LOG_LEVELS = {
    TargetState.TRACKING: "INFO",
    TargetState.RECOVERING: "WARN",
    TargetState.LOST: "ERROR",
    TargetState.IDLE: "DEBUG",
}
ROOM_MIN_MIB = 64
VIEWER_ADDRESS = re.compile(r"rerun(\+https?)?://[^/]+/proxy")


class RerunError(EtdError):
    """The Rerun SDK is missing, or what was asked for cannot be logged to."""


def check_rerun(destination: str) -> None:
    """Refuse what `rerun_log` could not log to.

    Args:
        destination: a file to write (FILE.rrd), `spawn` to start a viewer, or the address of a viewer that runs
            (rerun+http://HOST:9876/proxy).

    Raises:
        RerunError: the Rerun SDK is missing, the destination is none of these, or there is no display for a viewer.
        OutputError: the file cannot be written.
    """
    _import_rerun()
    if destination == SPAWN:
        if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            msg = "no display to start the Rerun viewer on: log to FILE.rrd, or to a viewer on another machine"
            raise RerunError(msg)
    elif "://" in destination:
        if not VIEWER_ADDRESS.fullmatch(destination):
            msg = f"{destination}: no address of a Rerun viewer: give one as rerun+http://HOST:9876/proxy"
            raise RerunError(msg)
    elif not destination.endswith(".rrd"):
        msg = f"{destination}: Rerun recordings are .rrd files: name it something.rrd"
        raise RerunError(msg)
    else:
        check_outputs(Path(destination))


def is_file(destination: str) -> bool:
    """Whether it is a file that is logged to, not a viewer."""
    return destination != SPAWN and "://" not in destination


@contextmanager
def rerun_log(destination: str) -> Iterator[RerunLog]:
    """A log to `destination`, as `check_rerun` describes it; a file gets its name when the block succeeds.

    Raises:
        RerunError: as `check_rerun`, the viewer cannot be started, or the disk is almost full.
        OutputError: the file cannot be written.
    """
    check_rerun(destination)
    recording = _import_rerun().RecordingStream(APPLICATION)
    opened = _file(recording, Path(destination)) if is_file(destination) else _viewer(recording, destination)
    with opened as log:
        yield log


@contextmanager
def _file(recording: Any, path: Path) -> Iterator[RerunLog]:
    with renamed_at_the_end(path) as partial:
        recording.save(partial)
        recording.send_blueprint(_blueprint())
        log = RerunLog(recording, lambda: _check_room(path))
        try:
            yield log
            log.flush()
        finally:
            recording.disconnect()


def _check_room(path: Path) -> None:
    """The SDK only prints that a disk is full, and writes on."""
    if shutil.disk_usage(path.parent).free < ROOM_MIN_MIB * 2**20:
        msg = f"{path}: less than {ROOM_MIN_MIB} MiB are free there, so logging stops: make room, or log elsewhere"
        raise RerunError(msg)


@contextmanager
def _viewer(recording: Any, destination: str) -> Iterator[RerunLog]:
    try:
        if destination == SPAWN:
            _spawn(recording)
        else:
            recording.connect_grpc(destination)
    except (RuntimeError, ValueError) as err:
        msg = f"the Rerun viewer at {destination} does not start: {' '.join(str(err).split())}; log to FILE.rrd instead"
        raise RerunError(msg) from err
    recording.send_blueprint(_blueprint())
    log = RerunLog(recording, lambda: None)
    try:
        yield log
        log.flush()
    finally:
        recording.disconnect()


def _spawn(recording: Any) -> None:
    """The SDK looks for the viewer's executable on the PATH, where that of a virtual environment need not be."""
    path = os.environ.get("PATH", os.defpath)
    os.environ["PATH"] = os.pathsep.join((str(Path(sys.executable).parent), path))
    try:
        recording.spawn()
    finally:
        os.environ["PATH"] = path


@dataclass(frozen=True, slots=True)
class _Row:
    """What a frame brought, until it is sent."""

    stamp_ns: int
    reports: tuple[TargetReport, ...]
    nzge: float | None


class RerunLog:
    """Takes every frame; made by `rerun_log`."""

    def __init__(self, recording: Any, drain: Callable[[], object]) -> None:
        self._rerun = _import_rerun()
        self._recording = recording
        self._drain = drain
        self._afterglow = Afterglow()
        self._new_image: FrameData | None = None
        self._shape: tuple[int, ...] = ()
        self._rate = Cadence(1 / PICTURES_PER_S)
        self._rows: list[_Row] = []
        self._states: dict[str, TargetState] = {}

    def add(
        self,
        stamp_ns: int,
        frame_data: FrameData,
        reports: tuple[TargetReport, ...],
        image: npt.NDArray[np.uint8] | None = None,
        nzge: float | None = None,
    ) -> None:
        """Take the next frame and its boxes.

        Args:
            stamp_ns: when the frame ended (ns).
            frame_data: uint8, shape (h, w, 2), channels On and Off; kept for some milliseconds, not copied.
            reports: the targets after the frame.
            image: the intensity image at the stamp, uint8, shape (h, w).
            nzge: the frame's Non-Zero Grid Entropy, where it is known.

        Raises:
            RerunError: the disk is almost full.
        """
        self._afterglow.take(stamp_ns, frame_data)
        self._new_image = self._new_image if image is None else image
        self._rows.append(_Row(stamp_ns, reports, nzge))
        self._log_changes(stamp_ns, reports)
        if frame_data.shape != self._shape:
            self._shape = frame_data.shape
            self._rate = Cadence(max(1 / PICTURES_PER_S, frame_data.size / 2 / PIXELS_PER_S))
        if self._rate.is_due(stamp_ns):
            self._log_picture(stamp_ns)
            self.flush()

    def flush(self) -> None:
        """Send what has gathered.

        Raises:
            RerunError: the disk is almost full.
        """
        rows, self._rows = self._rows, []
        if rows:
            self._send_boxes(rows)
            self._send_scores(rows)
        self._drain()

    def _log_changes(self, stamp_ns: int, reports: tuple[TargetReport, ...]) -> None:
        states = {report.name: report.state for report in reports}
        for name, state in states.items():
            before = self._states.get(name)
            if before is state:
                continue
            text = f"{name}: {state.value}" if before is None else f"{name}: {before.value} -> {state.value}"
            self._set_time(stamp_ns)
            self._recording.log("states", self._rerun.TextLog(text, level=LOG_LEVELS[state]))
        self._states = states

    def _log_picture(self, stamp_ns: int) -> None:
        """Events without loss, because compression would smear single pixels; the newest image, if it is not logged
        yet, as JPEG, a fifth of the size."""
        self._set_time(stamp_ns)
        _, events = cv2.imencode(".png", colour_events(self._afterglow.frame()), PNG_OPTIONS)
        self._recording.log("events", self._rerun.EncodedImage(contents=events.tobytes(), media_type="image/png"))
        if self._new_image is not None:
            _, encoded = cv2.imencode(".jpg", self._new_image, JPEG_OPTIONS)
            picture = self._rerun.EncodedImage(contents=encoded.tobytes(), media_type="image/jpeg")
            self._recording.log("reconstruction", picture)
            self._new_image = None

    def _send_boxes(self, rows: Sequence[_Row]) -> None:
        found = [[report for report in row.reports if report.box is not None] for row in rows]
        reports = list(chain.from_iterable(found))
        boxes = np.array([report.box for report in reports], np.float64).reshape(-1, 4)
        columns = self._rerun.Boxes2D.columns(
            centers=boxes[:, :2] + boxes[:, 2:] / 2,
            half_sizes=boxes[:, 2:] / 2,
            labels=[report.name for report in reports],
            colors=np.array([RGB_COLOURS[report.state] for report in reports], np.uint8).reshape(-1, 3),
        )
        stamps = [row.stamp_ns for row in rows]
        self._send("boxes", stamps, columns.partition(list(map(len, found))))

    def _send_scores(self, rows: Sequence[_Row]) -> None:
        series: dict[str, list[tuple[int, float]]] = {}
        for row in rows:
            if row.nzge is not None:
                series.setdefault("nzge", []).append((row.stamp_ns, row.nzge))
            for report in row.reports:
                entity = f"scores/{self._rerun.escape_entity_path_part(report.name)}"
                series.setdefault(entity, []).append((row.stamp_ns, report.score))
        for entity, points in series.items():
            stamps, values = zip(*points, strict=True)
            self._send(entity, stamps, self._rerun.Scalars.columns(scalars=values))

    def _send(self, entity: str, stamps_ns: Sequence[int], columns: Any) -> None:
        times = np.array(stamps_ns, "datetime64[ns]")
        self._recording.send_columns(entity, [self._rerun.TimeColumn(TIMELINE, timestamp=times)], columns)

    def _set_time(self, stamp_ns: int) -> None:
        self._recording.set_time(TIMELINE, timestamp=np.datetime64(stamp_ns, "ns"))


def _blueprint() -> Any:
    """Events and image above, both with the boxes; scores, NZGE and changes of state below."""
    import rerun.blueprint as views

    pictures = [
        views.Spatial2DView(name=name, contents=[f"/{name}", "/boxes"]) for name in ("events", "reconstruction")
    ]
    figures = [
        views.TimeSeriesView(name="scores", origin="/scores"),
        views.TimeSeriesView(name="nzge", origin="/nzge"),
        views.TextLogView(name="states", origin="/states"),
    ]
    layout = views.Vertical(views.Horizontal(*pictures), views.Horizontal(*figures), row_shares=[2, 1])
    return views.Blueprint(layout, collapse_panels=True)


def _import_rerun() -> Any:
    try:
        import rerun
    except ImportError as err:
        msg = "the Rerun viewer needs its SDK: pip install rerun-sdk"
        raise RerunError(msg) from err
    return rerun
