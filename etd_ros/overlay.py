"""Frames, images, boxes and states as pictures and videos."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.errors import EtdError
from etd_ros.tracking import TargetReport, TargetState

Picture = npt.NDArray[np.uint8]
Colour = tuple[int, int, int]

GROUND: Colour = (28, 22, 20)
ON: Colour = (255, 214, 120)
OFF: Colour = (150, 70, 235)
TEXT: Colour = (225, 225, 225)
STATE_COLOURS: dict[TargetState, Colour] = {
    TargetState.TRACKING: (90, 230, 90),
    TargetState.RECOVERING: (0, 210, 255),
    TargetState.LOST: (70, 70, 255),
    TargetState.IDLE: (160, 160, 160),
}
"""Colours are blue, green, red, as OpenCV has them."""

WIDTH_ONE_PANEL = 720
WIDTH_TWO_PANELS = 960
SCALE_MIN = 0.5
BAR_HEIGHT = 28
MP4V = int.from_bytes(b"mp4v", "little")
FONT = cv2.FONT_HERSHEY_SIMPLEX
FONT_SCALE = 0.5


class OverlayError(EtdError):
    """A picture that cannot be drawn, or a video that cannot be written."""


def draw_overlay(
    frame_data: npt.NDArray[np.uint8],
    reports: Iterable[TargetReport],
    *,
    image: npt.NDArray[np.uint8] | None = None,
    stamp_ns: int | None = None,
    scale: float | None = None,
) -> Picture:
    """One picture of a frame: events by polarity, fading as they decay, and the targets' boxes, names and states.

    Args:
        frame_data: uint8, shape (h, w, 2), channels On and Off.
        reports: the targets; those without a box appear in the bar below only.
        image: the intensity image to show beside the events, uint8, shape (h, w).
        stamp_ns: the time to write below (ns).
        scale: picture pixels for one of the sensor; by default the picture is 720 to 960 pixels wide or so.

    Returns:
        uint8, shape (rows, columns, 3), blue, green, red; rows and columns are even, as video needs it.

    Raises:
        OverlayError: arrays of other shapes or dtypes, or a scale that is not above 0.
    """
    _check(frame_data, image, scale)
    reports = tuple(reports)
    panels = [_colour_events(frame_data)]
    if image is not None:
        panels.append(np.repeat(image[:, :, None], 3, axis=2))
    scale = scale or _default_scale(frame_data.shape[1], len(panels))
    drawn = np.hstack([_draw_targets(_enlarge(panel, scale), reports, scale) for panel in panels])
    picture = np.vstack([drawn, _bar(drawn.shape[1], reports, stamp_ns)])
    rows, columns, _ = picture.shape
    return np.pad(picture, ((0, rows % 2), (0, columns % 2), (0, 0)))


class VideoWriter:
    """A context manager that writes pictures to an MP4 file, which appears when all went well.

    The first picture gives the video's size; pictures of another size are fitted into it. Without pictures
    no file is made.
    """

    def __init__(self, path: Path | str, fps: float) -> None:
        """Check that `path` can be written.

        Raises:
            OverlayError: not an .mp4 name, a folder, or in a folder that is not there or not writable.
        """
        self._path = Path(path)
        self._partial = self._path.with_name(f".{self._path.stem}.partial-{os.getpid()}.mp4")
        self._fps = fps
        self._writer: Any = None
        self._shape = (0, 0)
        if self._path.suffix.lower() != ".mp4":
            msg = f"{self._path}: videos are MP4 files; name it something.mp4"
            raise OverlayError(msg)
        if (self._path.exists() and not self._path.is_file()) or not os.access(self._path.parent, os.W_OK):
            msg = f"{self._path}: cannot be written; give a file in a folder that exists and may be written to"
            raise OverlayError(msg)

    def __enter__(self) -> VideoWriter:
        return self

    def write(self, picture: Picture) -> None:
        """Append a picture, uint8, shape (rows, columns, 3), blue, green, red.

        Raises:
            OverlayError: the video cannot be opened.
        """
        if self._writer is None:
            self._shape = picture.shape[0], picture.shape[1]
            self._writer = self._open()
        self._writer.write(_fit(picture, self._shape))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._writer is None:
            return
        self._writer.release()
        if kind is None:
            self._partial.replace(self._path)
        else:
            self._partial.unlink(missing_ok=True)

    def _open(self) -> Any:
        rows, columns = self._shape
        writer = cv2.VideoWriter(str(self._partial), MP4V, self._fps, (columns, rows))
        if not writer.isOpened():
            self._partial.unlink(missing_ok=True)
            msg = f"{self._path}: OpenCV {cv2.__version__} cannot write an MP4 video of {columns}x{rows} there"
            raise OverlayError(msg)
        return writer


def _check(frame_data: npt.NDArray[np.uint8], image: npt.NDArray[np.uint8] | None, scale: float | None) -> None:
    if frame_data.dtype != np.uint8 or frame_data.ndim != 3 or frame_data.shape[2] != 2 or not frame_data.size:
        msg = f"an overlay needs a frame, uint8 of shape (h, w, 2), not {frame_data.dtype} {frame_data.shape}"
        raise OverlayError(msg)
    if image is not None and (image.dtype != np.uint8 or image.shape != frame_data.shape[:2]):
        msg = f"an overlay needs an image, uint8 of shape {frame_data.shape[:2]}, not {image.dtype} {image.shape}"
        raise OverlayError(msg)
    if scale is not None and not scale > 0:
        msg = f"overlay scale {scale} is not above 0"
        raise OverlayError(msg)


def _default_scale(width: int, panels: int) -> float:
    """Whole factors for small sensors, so that pixels stay square and even; down to half for large ones."""
    scale = (WIDTH_ONE_PANEL if panels == 1 else WIDTH_TWO_PANELS) / (panels * width)
    return float(round(scale)) if scale > 1 else max(SCALE_MIN, scale)


def _colour_events(frame_data: npt.NDArray[np.uint8]) -> Picture:
    on, off = (frame_data[:, :, channel, None].astype(np.float32) / 255 for channel in (0, 1))
    # Where both polarities fired, the later one shows.
    colour = np.where(on >= off, np.asarray(ON, np.float32), np.asarray(OFF, np.float32))
    strength = np.maximum(on, off)
    return np.asarray(np.asarray(GROUND, np.float32) * (1 - strength) + colour * strength, np.uint8)


def _enlarge(panel: Picture, scale: float) -> Picture:
    size = max(1, round(panel.shape[1] * scale)), max(1, round(panel.shape[0] * scale))
    interpolation = cv2.INTER_NEAREST if scale >= 1 else cv2.INTER_AREA
    return np.asarray(cv2.resize(panel, size, interpolation=interpolation), np.uint8)


def _draw_targets(panel: Picture, reports: Iterable[TargetReport], scale: float) -> Picture:
    for report in reports:
        if report.box is not None:
            _draw_box(panel, report.box, scale, report.name, STATE_COLOURS[report.state])
    return panel


def _draw_box(panel: Picture, box: Box, scale: float, name: str, colour: Colour) -> None:
    rows, columns, _ = panel.shape
    # A box partly off the sensor is drawn to the border; OpenCV cannot take coordinates of any size.
    left, right = (int(np.clip(x * scale, -2, columns + 2)) for x in (box.x, box.x + box.w))
    top, bottom = (int(np.clip(y * scale, -2, rows + 2)) for y in (box.y, box.y + box.h))
    cv2.rectangle(panel, (left, top), (right, bottom), colour, 2)
    (text_width, text_height), _ = cv2.getTextSize(name, FONT, FONT_SCALE, 1)
    x = max(0, min(left - 1, columns - text_width - 6))
    y = max(text_height + 6, top - 1)
    cv2.rectangle(panel, (x, y - text_height - 6), (x + text_width + 6, y), colour, cv2.FILLED)
    cv2.putText(panel, name, (x + 3, y - 4), FONT, FONT_SCALE, GROUND, 1, cv2.LINE_AA)


def _bar(width: int, reports: Iterable[TargetReport], stamp_ns: int | None) -> Picture:
    """The stamp, and each target's name, state and score in its state's colour, as far as they go."""
    bar = np.full((BAR_HEIGHT, width, 3), GROUND, np.uint8)
    words = [] if stamp_ns is None else [(f"{stamp_ns // 10**9}.{stamp_ns % 10**9 // 10**6:03d} s", TEXT)]
    for report in reports:
        score = "" if report.box is None else f" {report.score:.2f}"
        words.append((f"{report.name} {report.state.value}{score}", STATE_COLOURS[report.state]))
    x = 8
    for text, colour in words:
        cv2.putText(bar, text, (x, BAR_HEIGHT - 9), FONT, FONT_SCALE, colour, 1, cv2.LINE_AA)
        x += cv2.getTextSize(text, FONT, FONT_SCALE, 1)[0][0] + 20
    return bar


def _fit(picture: Picture, shape: tuple[int, int]) -> Picture:
    """A picture in the middle of one of another shape, as large as it goes."""
    rows, columns, _ = picture.shape
    if (rows, columns) == shape:
        return picture
    factor = min(shape[0] / rows, shape[1] / columns)
    size = min(shape[1], max(1, round(columns * factor))), min(shape[0], max(1, round(rows * factor)))
    fitted = np.full((*shape, 3), GROUND, np.uint8)
    top, left = (shape[0] - size[1]) // 2, (shape[1] - size[0]) // 2
    fitted[top : top + size[1], left : left + size[0]] = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return fitted
