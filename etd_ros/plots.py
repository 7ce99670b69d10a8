"""Plots and picture sheets as PNG files in memory. Plots need Matplotlib, sheets do not."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.conversion import FrameEnd
from etd_ros.errors import EtdError
from etd_ros.evaluation import mean_score
from etd_ros.evaluation.overlaps import LABEL_GAP_MAX_NS, TargetOverlap
from etd_ros.evaluation.scoring import SUCCESS_IOU
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
STATE_SHADES = {"recovering": "#ffd54f", "lost": "#ef5350"}
OVERLAP_COLOUR = "#1565c0"
PANELS_MAX, PANELS_PER_COLUMN = 64, 8
PANEL_INCHES = 7.0, 1.55
LABELS_MARKED = 60
"""So many labels, or more, make a curve without dots."""
GAP_MIN_NS, GAP_SPACINGS = 100_000_000, 1.5
"""A curve is broken where labels are missing: for so long, and so many times as long as labels usually lie apart."""


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


def overlap_png(overlaps: Mapping[str, TargetOverlap], title: str) -> bytes:
    """A PNG of the overlap with the truth over time, a panel a target with its AP and AR (and the name of a track that
    was matched with it), and the times shaded during which the target was being recovered or lost. Times are seconds
    since the first label or state of any target.

    Raises:
        PlotError: Matplotlib is missing, or there is no target, or more than 64.
    """
    if not 1 <= len(overlaps) <= PANELS_MAX:
        msg = f"{len(overlaps)} targets to plot: give truth of 1 to {PANELS_MAX}"
        raise PlotError(msg)
    columns = -(-len(overlaps) // PANELS_PER_COLUMN)
    rows = -(-len(overlaps) // columns)
    figure = _new_figure(PANEL_INCHES[0] * columns, PANEL_INCHES[1] * rows + 1.0)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    starts_ns = [ns for of in overlaps.values() for ns in (int(of.stamps_ns[0]), *(s.start_ns for s in of.spells[:1]))]
    for axes, (name, overlap) in zip(grid.T.flat, overlaps.items(), strict=False):
        _plot_overlap(axes, name, overlap, min(starts_ns))
    for axes in grid.T.flat[len(overlaps) :]:
        axes.set_axis_off()
    for axes in grid[:, 0]:
        axes.set_ylabel("IoU")
    for axes in grid[-1]:
        axes.set_xlabel("time (s)")
    mean = mean_score({name: overlap.score for name, overlap in overlaps.items()})
    figure.suptitle(f"{title}: mean AP {mean.ap:.3f}, AR {mean.ar:.3f}" if len(overlaps) > 1 else title)
    figure.legend(handles=_overlap_legend(), loc="outside lower center", ncols=4, frameon=False)
    return _png(figure)


def _plot_overlap(axes: Any, name: str, overlap: TargetOverlap, origin_ns: int) -> None:
    for spell in overlap.spells:
        if spell.state in STATE_SHADES:
            ends_s = ((ns - origin_ns) * 1e-9 for ns in (spell.start_ns, spell.end_ns))
            axes.axvspan(*ends_s, color=STATE_SHADES[spell.state], alpha=0.45, lw=0)
    gaps = _gaps(overlap.stamps_ns)
    times_s, values = (overlap.stamps_ns - origin_ns) * 1e-9, overlap.values
    for part_s, part in zip(np.split(times_s, gaps), np.split(values, gaps), strict=True):
        axes.plot(part_s, part, color=OVERLAP_COLOUR, lw=1.4, marker="o", ms=2 if len(part) < LABELS_MARKED else 0)
        axes.fill_between(part_s, part, color=OVERLAP_COLOUR, alpha=0.12, lw=0)
    axes.axhline(SUCCESS_IOU, color="0.5", lw=0.8, ls=":")
    axes.set(ylim=(-0.03, 1.03), yticks=(0, 0.5, 1))
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.01)
    heading, of_target = overlap.heading(name), overlap.score
    axes.set_title(f"{heading}   AP {of_target.ap:.3f}   AR {of_target.ar:.3f}", fontsize=10, loc="left")


def _gaps(stamps_ns: npt.NDArray[np.int64]) -> npt.NDArray[np.intp]:
    """The labels, by number, before which some are missing: the target may have been hidden."""
    apart_ns = np.diff(stamps_ns)
    usual_ns = float(np.median(apart_ns)) if len(apart_ns) else 0.0
    longest_ns = min(LABEL_GAP_MAX_NS, max(GAP_MIN_NS, GAP_SPACINGS * usual_ns))
    return np.flatnonzero(apart_ns > longest_ns) + 1


def _overlap_legend() -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    shades = [Patch(color=colour, alpha=0.45, lw=0, label=state) for state, colour in STATE_SHADES.items()]
    return [
        Line2D([], [], color=OVERLAP_COLOUR, label="overlap with the truth"),
        Line2D([], [], color="0.5", lw=0.8, ls=":", label=f"success ({SUCCESS_IOU:g})"),
        *shades,
    ]


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
