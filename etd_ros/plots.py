"""Plots and picture sheets as PNG files in memory. Plots need Matplotlib, sheets do not."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.conversion import FrameEnd
from etd_ros.errors import EtdError
from etd_ros.overlay import FONT, GROUND, TEXT, Picture, draw_overlay

CAPTION_HEIGHT = 18
CAPTION_SCALE = 0.4
GAP = 4
BUSY_PERCENTILES = (3, 97)
BUSY_MARGIN = 0.05
"""On each side (of the sensor's height and width)."""

HISTOGRAM_BINS = 20
DPI = 110
END_COLOURS = {
    FrameEnd.NZGE: "tab:blue",
    FrameEnd.TIME_LIMIT: "tab:red",
    FrameEnd.WINDOW: "tab:green",
    FrameEnd.COUNT: "tab:purple",
}


class PlotError(EtdError):
    """A plot that cannot be drawn."""


@dataclass(frozen=True, slots=True)
class NzgeCurve:
    """NZGE against time, all times in seconds since the first frame's start.

    Attributes:
        growth: for each frame shown, (times, values) while it grew, float64, shape (n,) each.
        end_times: when the recording's frames ended, shape (m,).
        end_values: their NZGE, shape (m,).
        ends: why each of them ended.
        interval: [alpha, beta].
    """

    growth: Sequence[tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]]
    end_times: npt.NDArray[np.float64]
    end_values: npt.NDArray[np.float64]
    ends: Sequence[FrameEnd]
    interval: tuple[float, float]


def caption_frame(data: npt.NDArray[np.uint8], size: tuple[int, int], caption: str) -> Picture:
    """A frame (On blue, Off red, fading as they decay) with a line of text below it.

    Args:
        data: uint8, shape (h, w, 2).
        size: width and height that the frame is scaled to (pixels).
        caption: what to write; ASCII.
    """
    width = size[0]
    scale = width / data.shape[1]
    drawn = draw_overlay(data, (), scale=scale)[: max(1, round(data.shape[0] * scale))]
    bar = np.full((CAPTION_HEIGHT, width, 3), GROUND, np.uint8)
    cv2.putText(bar, caption, (3, CAPTION_HEIGHT - 5), FONT, CAPTION_SCALE, TEXT, 1, cv2.LINE_AA)
    return np.vstack([cv2.resize(drawn, size), bar])


def busy_window(data: npt.NDArray[np.uint8]) -> tuple[slice, slice]:
    """Rows and columns round nearly all events of a frame, in the frame's proportions: small things become visible.

    Args:
        data: uint8, shape (h, w, 2).
    """
    height, width, _ = data.shape
    rows, columns = np.nonzero(data.any(axis=2))
    if not len(rows):
        return slice(0, height), slice(0, width)
    top, bottom = np.percentile(rows, BUSY_PERCENTILES)
    left, right = np.percentile(columns, BUSY_PERCENTILES)
    share = max((bottom - top) / height, (right - left) / width) + 2 * BUSY_MARGIN
    window_height, window_width = (min(size, max(1, round(size * share))) for size in (height, width))
    first_row = int(np.clip((top + bottom - window_height) / 2, 0, height - window_height))
    first_column = int(np.clip((left + right - window_width) / 2, 0, width - window_width))
    return slice(first_row, first_row + window_height), slice(first_column, first_column + window_width)


def sheet_png(sections: Sequence[tuple[str, Sequence[Picture], int]]) -> bytes:
    """A PNG with a headline and a grid of pictures for each section.

    Args:
        sections: (headline, pictures of one size, pictures in a row); ones without pictures are left out.
    """
    blocks = [_grid(headline, pictures, columns) for headline, pictures, columns in sections if pictures]
    width = max(block.shape[1] for block in blocks)
    padded = [cv2.copyMakeBorder(block, 0, 0, 0, width - block.shape[1], cv2.BORDER_CONSTANT) for block in blocks]
    return cv2.imencode(".png", np.vstack(padded))[1].tobytes()


def _grid(headline: str, pictures: Sequence[Picture], columns: int) -> Picture:
    height, width, _ = pictures[0].shape
    rows = -(-len(pictures) // columns)
    grid = np.zeros((CAPTION_HEIGHT + GAP + rows * (height + GAP), columns * (width + GAP), 3), np.uint8)
    cv2.putText(grid, headline, (3, CAPTION_HEIGHT - 4), FONT, 0.5, TEXT, 1, cv2.LINE_AA)
    for index, picture in enumerate(pictures):
        row, column = divmod(index, columns)
        top, left = CAPTION_HEIGHT + GAP + row * (height + GAP), column * (width + GAP)
        grid[top : top + height, left : left + width] = picture
    return grid


def histogram_png(values: npt.NDArray[np.float64], interval: tuple[float, float], title: str) -> bytes:
    """A PNG of the histogram of NZGE values with their mean and [alpha, beta].

    Raises:
        PlotError: Matplotlib is missing.
    """
    figure = _new_figure(6.4, 4.0)
    axes = figure.subplots()
    axes.hist(values, bins=HISTOGRAM_BINS, color="0.6", edgecolor="white")
    axes.axvspan(*interval, color="tab:orange", alpha=0.4, label=f"[{interval[0]:.4f}, {interval[1]:.4f}]")
    axes.axvline(float(values.mean()), color="tab:orange", label=f"mean {values.mean():.4f}")
    axes.set(xlabel="NZGE of a frame with clear contours", ylabel="frames", title=title)
    axes.legend()
    return _png(figure)


def nzge_png(curve: NzgeCurve, title: str) -> bytes:
    """A PNG of NZGE over time: at the ends of all frames, and while the frames shown grew.

    Raises:
        PlotError: Matplotlib is missing.
    """
    figure = _new_figure(9.0, 6.0)
    above, below = figure.subplots(2, 1)
    above.set(title=title, ylabel="NZGE at frames' ends")
    for end, colour in END_COLOURS.items():
        chosen = np.array([value is end for value in curve.ends], np.bool_)
        if chosen.any():
            label = f"{end.value} ({int(chosen.sum())})"
            above.plot(curve.end_times[chosen], curve.end_values[chosen], ".", color=colour, ms=3, label=label)
    for times, values in curve.growth:
        below.plot(times, values, color="0.3", lw=1)
    if curve.growth:
        first_s, last_s = float(curve.growth[0][0][0]), float(curve.growth[-1][0][-1])
        for time_s, value, end in zip(curve.end_times, curve.end_values, curve.ends, strict=True):
            if first_s < time_s <= last_s:
                below.plot(time_s, value, "o", color=END_COLOURS[end], ms=4)
    below.set(xlabel="time since the first frame's start (s)", ylabel="NZGE as frames grow")
    for axes in (above, below):
        axes.axhspan(*curve.interval, color="tab:orange", alpha=0.4, label="[alpha, beta]")
        axes.set_ylim(bottom=0)
    above.legend(loc="lower right")
    return _png(figure)


def check_matplotlib() -> None:
    """Raise PlotError where Matplotlib is missing."""
    _new_figure(1.0, 1.0)


def _new_figure(width_inch: float, height_inch: float) -> Any:
    try:
        from matplotlib.figure import Figure
    except ImportError as err:
        msg = "plots need Matplotlib: install python3-matplotlib, or pip install matplotlib"
        raise PlotError(msg) from err
    return Figure(figsize=(width_inch, height_inch), layout="constrained")


def _png(figure: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()
