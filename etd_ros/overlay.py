"""Frames, images, boxes and states as pictures and videos."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.errors import EtdError
from etd_ros.overlay_history import History
from etd_ros.tracking import Search, TargetReport, TargetState

Picture = npt.NDArray[np.uint8]
Colour = tuple[int, int, int]

GROUND: Colour = (28, 22, 20)
ON: Colour = (255, 214, 120)
OFF: Colour = (150, 70, 235)
TEXT: Colour = (225, 225, 225)
TRUTH: Colour = (200, 200, 200)
PROPOSAL: Colour = (255, 130, 200)
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
BAR_HEIGHT, BAR_MARGIN, BAR_GAP = 28, 8, 20
MP4V = int.from_bytes(b"mp4v", "little")
FONT = cv2.FONT_HERSHEY_SIMPLEX
FONT_SCALE = 0.5
PROPOSALS_MAX = 40
"""More of them hide what they are about."""
PROPOSAL_STRENGTHS = (0.2, 0.8)
"""Of the faintest and of the best."""
DASH, TRAIL_THICKNESS = 5, 2
FLASH_STRENGTH, FLASH_REACH, FLASH_THICKNESS = 0.25, 16, 3
NO_TRUTH: Mapping[str, Box] = MappingProxyType({})


class OverlayError(EtdError):
    """A picture that cannot be drawn, or a video that cannot be written."""


def draw_overlay(
    frame_data: npt.NDArray[np.uint8],
    reports: Iterable[TargetReport],
    *,
    image: npt.NDArray[np.uint8] | None = None,
    stamp_ns: int | None = None,
    scale: float | None = None,
    proposals: bool = False,
    truth: Mapping[str, Box] = NO_TRUTH,
    history: History | None = None,
) -> Picture:
    """One picture of a frame: events by polarity, fading as they decay, and the targets' boxes, names and states.

    Where the reports say how a target was looked for, the search region of one that is being recovered is dashed.

    Args:
        frame_data: a frame, uint8, shape (h, w, 2), channels On and Off; or a picture, uint8, shape (h, w) grey or
            (h, w, 3) blue, green, red.
        reports: the targets; those without a box appear in the bar below only.
        image: the intensity image to show beside the events, uint8, shape (h, w).
        stamp_ns: the time to write below (ns).
        scale: picture pixels for one of the sensor; by default the picture is 720 to 960 pixels wide or so.
        proposals: whether to draw the best of the proposals in the reports, thin and the fainter the lower their score.
        truth: true boxes to draw thin and grey, by target (pixels).
        history: draws trails of the boxes' centres, and marks targets that were just found again.

    Returns:
        uint8, shape (rows, columns, 3), blue, green, red; rows and columns are even, as video needs it.

    Raises:
        OverlayError: arrays of other shapes or dtypes, or a scale that is not above 0.
    """
    _check(frame_data, image, scale)
    reports = tuple(reports)
    panels = [_in_colour(frame_data)]
    if image is not None:
        panels.append(_in_colour(image))
    scale = scale or _default_scale(frame_data.shape[1], len(panels))
    drawn = np.hstack(
        [
            _draw_targets(_enlarge(panel, scale), reports, scale, proposals=proposals, truth=truth, history=history)
            for panel in panels
        ]
    )
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
    is_drawable = frame_data.ndim == 2 or (frame_data.ndim == 3 and frame_data.shape[2] in (2, 3))
    if frame_data.dtype != np.uint8 or not is_drawable or not frame_data.size:
        msg = (
            "an overlay needs a frame, uint8 of shape (h, w, 2), or a picture, (h, w) or (h, w, 3), "
            f"not {frame_data.dtype} {frame_data.shape}"
        )
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


def colour_events(frame_data: npt.NDArray[np.uint8]) -> Picture:
    """A frame, uint8, shape (h, w, 2), as a picture of its size: On blue, Off red, fading as they decay."""
    on, off = cv2.split(frame_data)
    levels = cv2.merge([cv2.max(on, off)] * 3)
    picture: Any = cv2.LUT(levels, _shades(ON))
    # Where both polarities fired, the later one shows.
    cv2.copyTo(cv2.LUT(levels, _shades(OFF)), cv2.compare(off, on, cv2.CMP_GT), picture)
    return np.asarray(picture, np.uint8)


def _in_colour(pixels: npt.NDArray[np.uint8]) -> Picture:
    """A frame, a grey picture or one in colour as a picture in colour."""
    if pixels.ndim == 2:
        return np.repeat(pixels[:, :, None], 3, axis=2)
    return colour_events(pixels) if pixels.shape[2] == 2 else pixels


def _shades(colour: Colour) -> Picture:
    """From the ground's colour to this one, shape (1, 256, 3)."""
    strength = np.linspace(0, 1, 256, dtype=np.float32)[:, None]
    shades = np.asarray(GROUND, np.float32) * (1 - strength) + np.asarray(colour, np.float32) * strength
    return shades.astype(np.uint8)[None]


def _enlarge(panel: Picture, scale: float) -> Picture:
    size = max(1, round(panel.shape[1] * scale)), max(1, round(panel.shape[0] * scale))
    interpolation = cv2.INTER_NEAREST if scale >= 1 else cv2.INTER_AREA
    return np.asarray(cv2.resize(panel, size, interpolation=interpolation), np.uint8)


def _draw_targets(
    panel: Picture,
    reports: Sequence[TargetReport],
    scale: float,
    *,
    proposals: bool,
    truth: Mapping[str, Box],
    history: History | None,
) -> Picture:
    if proposals:
        for report in reports:
            if report.search is not None:
                _draw_proposals(panel, report.search, scale)
    for box in truth.values():
        cv2.rectangle(panel, *_corners(panel, box, scale), TRUTH, 1)
    for report in reports:
        colour = STATE_COLOURS[report.state]
        if history is not None:
            _draw_trail(panel, history.trail(report.name), report.box, scale, colour)
        if report.box is not None:
            if history is not None and (flash := history.flash(report.name)) > 0:
                _draw_flash(panel, report.box, scale, colour, flash)
            _draw_box(panel, report.box, scale, colour)
            _draw_name(panel, report.box, scale, report.name, colour)
        elif report.search is not None and report.state is TargetState.RECOVERING:
            _draw_region(panel, report.search.region, scale, colour)
            _draw_name(panel, report.search.region, scale, report.name, colour)
    return panel


def _corners(panel: Picture, box: Box, scale: float) -> tuple[tuple[int, int], tuple[int, int]]:
    """A box partly off the sensor is drawn to the border; OpenCV cannot take coordinates of any size."""
    rows, columns, _ = panel.shape
    left, right = (int(np.clip(x * scale, -2, columns + 2)) for x in (box.x, box.x + box.w))
    top, bottom = (int(np.clip(y * scale, -2, rows + 2)) for y in (box.y, box.y + box.h))
    return (left, top), (right, bottom)


def _draw_proposals(panel: Picture, search: Search, scale: float) -> None:
    """The best ones, the better the clearer and the further in front."""
    scores = search.candidates.scores[:PROPOSALS_MAX]
    if not len(scores):
        return
    best = float(scores.max())
    shares = np.interp(scores / best if best > 0 else np.ones(len(scores)), (0, 1), PROPOSAL_STRENGTHS)
    strength = np.zeros(panel.shape[:2], np.uint8)
    for box, share in reversed(list(zip(search.candidates.boxes, shares, strict=False))):
        cv2.rectangle(strength, *_corners(panel, Box(*box.tolist()), scale), round(255 * float(share)), 1)
    _blend(panel, strength, PROPOSAL)


def _draw_region(panel: Picture, region: Box, scale: float, colour: Colour) -> None:
    strength = np.zeros(panel.shape[:2], np.uint8)
    cv2.rectangle(strength, *_corners(panel, region, scale), 255, 1)
    rows, columns = np.ogrid[: panel.shape[0], : panel.shape[1]]
    # Diagonal stripes dash lines in both directions.
    strength[(rows + columns) // DASH % 2 == 1] = 0
    _blend(panel, strength, colour)


def _draw_trail(panel: Picture, trail: npt.NDArray[np.float64], box: Box | None, scale: float, colour: Colour) -> None:
    """Behind the box, so that it does not hide the target."""
    if len(trail) < 2:
        return
    rows, columns, _ = panel.shape
    points = np.clip(trail[:, :2] * scale, 0, (columns - 1, rows - 1)).astype(np.int32)
    # Only the part of the panel that the trail reaches is blended, which is most of the time it would take.
    first = np.maximum(points.min(axis=0) - TRAIL_THICKNESS, 0)
    part = panel[first[1] : points[:, 1].max() + TRAIL_THICKNESS, first[0] : points[:, 0].max() + TRAIL_THICKNESS]
    strength = np.zeros(part.shape[:2], np.uint8)
    inside = (points - first).tolist()
    for start, end, freshness in zip(inside[:-1], inside[1:], trail[1:, 2], strict=True):
        cv2.line(strength, start, end, round(255 * float(freshness)), TRAIL_THICKNESS)
    if box is not None:
        corners = np.array(_corners(panel, box, scale)) - first
        first_corner, last_corner = corners.tolist()
        cv2.rectangle(strength, first_corner, last_corner, 0, cv2.FILLED)
    _blend(part, strength, colour)


def _draw_box(panel: Picture, box: Box, scale: float, colour: Colour) -> None:
    cv2.rectangle(panel, *_corners(panel, box, scale), colour, 2)


def _draw_flash(panel: Picture, box: Box, scale: float, colour: Colour, flash: float) -> None:
    """The box lights up, and a ring runs away from it."""
    (left, top), (right, bottom) = _corners(panel, box, scale)
    reach = round(FLASH_REACH * (1 - flash))
    strength = np.zeros(panel.shape[:2], np.uint8)
    cv2.rectangle(strength, (left, top), (right, bottom), round(255 * FLASH_STRENGTH * flash), cv2.FILLED)
    ring = (left - reach, top - reach), (right + reach, bottom + reach)
    cv2.rectangle(strength, *ring, round(255 * flash), FLASH_THICKNESS)
    _blend(panel, strength, colour)


def _draw_name(panel: Picture, box: Box, scale: float, name: str, colour: Colour) -> None:
    """A tag on the box's upper left corner."""
    (left, top), _ = _corners(panel, box, scale)
    (text_width, text_height), _ = cv2.getTextSize(name, FONT, FONT_SCALE, 1)
    x = max(0, min(left - 1, panel.shape[1] - text_width - 6))
    y = max(text_height + 6, top - 1)
    cv2.rectangle(panel, (x, y - text_height - 6), (x + text_width + 6, y), colour, cv2.FILLED)
    cv2.putText(panel, name, (x + 3, y - 4), FONT, FONT_SCALE, GROUND, 1, cv2.LINE_AA)


def _blend(panel: Picture, strength: npt.NDArray[np.uint8], colour: Colour) -> None:
    """Lay a colour over a panel, as opaque as `strength`, shape (rows, columns), says at each pixel."""
    touched = strength > 0
    share = strength[touched].astype(np.float32)[:, None] / 255
    panel[touched] = (panel[touched] * (1 - share) + np.asarray(colour, np.float32) * share).astype(np.uint8)


def _bar(width: int, reports: Sequence[TargetReport], stamp_ns: int | None) -> Picture:
    """The stamp, and each target's name, state and score in its state's colour; those that do not fit are counted."""
    bar = np.full((BAR_HEIGHT, width, 3), GROUND, np.uint8)
    words = [] if stamp_ns is None else [(f"{stamp_ns // 10**9}.{stamp_ns % 10**9 // 10**6:03d} s", TEXT)]
    for report in reports:
        score = "" if report.box is None or math.isnan(report.score) else f" {report.score:.2f}"
        words.append((f"{report.name} {report.state.value}{score}", STATE_COLOURS[report.state]))
    x = BAR_MARGIN
    for index, (text, colour) in enumerate(words):
        left = len(words) - index
        end = x + _text_width(text) + (BAR_GAP + _text_width(f"+{left - 1}") if left > 1 else 0)
        is_too_long = end > width - BAR_MARGIN
        shown, shown_colour = (f"+{left}", TEXT) if is_too_long else (text, colour)
        cv2.putText(bar, shown, (x, BAR_HEIGHT - 9), FONT, FONT_SCALE, shown_colour, 1, cv2.LINE_AA)
        if is_too_long:
            break
        x += _text_width(text) + BAR_GAP
    return bar


def _text_width(text: str) -> int:
    return int(cv2.getTextSize(text, FONT, FONT_SCALE, 1)[0][0])


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
