"""Plots of a comparison as PNG files in memory: curves, speed and accuracy, overlap over time. They need Matplotlib."""

from __future__ import annotations

import io
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from etd_ros.evaluation.cells import CellResult
from etd_ros.evaluation.curves import precision_curve, success_curve
from etd_ros.evaluation.tables import Table, judged
from etd_ros.plots import check_matplotlib

DPI = 110
NS_PER_S = 1e9
PRECISION_PX = 20
"""Where precision is read off (Wu 2013, Sec. 3)."""
LINE_STYLES = ("-", "--", ":")
COLOURS = 10
STRIP_INCHES = 0.2
PANEL_INCHES = 9.0, 0.9
LABEL_ABOVE_PT, LABEL_BELOW_PT = 4, -9
NAME_DECADES, NAME_AP = 0.25, 0.04
"""How much of the speed-accuracy plot a system's name covers: powers of ten of events/s, and AP."""
NOT_SCORED = "0.35"
"""Grey of a strip at labels that are not scored, as those from which a system started again."""

Results = Sequence[CellResult]


@dataclass(frozen=True, slots=True)
class Plot:
    """A plot of a comparison.

    Attributes:
        name: for a file.
        heading: for readers.
        png: the picture.
    """

    name: str
    heading: str
    png: bytes


def plots_of(table: Table, results: Results) -> Iterator[Plot]:
    """All plots of one protocol.

    Args:
        table: of the protocol.
        results: of the protocol.

    Raises:
        PlotError: Matplotlib is missing.
    """
    counting = judged(table.rows)
    compared = [result for result in results if (result.cell.dataset, result.cell.sequence) in counting]
    whole = {system: found for system in table.rows if (found := _without_errors(compared, system))}
    if whole:
        yield Plot("curves", "Success and precision", curves_png(whole))
    if table.means:
        yield Plot("speed_accuracy", "Speed and accuracy", speed_accuracy_png(table))
    for (dataset, sequence), by_target in _by_sequence(results).items():
        heading = f"Overlap over time: {dataset}/{sequence} (grey: labels not scored)"
        yield Plot(f"overlap_{dataset}_{sequence}", heading, overlap_strips_png(by_target))


def _without_errors(results: Iterable[CellResult], system: str) -> list[CellResult]:
    """A system's results, if none of its cells brought an error: curves over other labels could not be compared."""
    found = [result for result in results if result.cell.system == system]
    return found if all(result.error is None for result in found) else []


def _by_sequence(results: Iterable[CellResult]) -> Mapping[tuple[str, str], dict[str, dict[str, CellResult]]]:
    """The first repetition's cells by sequence, target and system."""
    found: defaultdict[tuple[str, str], dict[str, dict[str, CellResult]]] = defaultdict(dict)
    for result in results:
        cell = result.cell
        if cell.repetition == 0 and result.error is None:
            found[cell.dataset, cell.sequence].setdefault(cell.target, {})[cell.system] = result
    return found


def curves_png(by_system: Mapping[str, Results]) -> bytes:
    """A PNG of success and precision curves, over all labels of a system's cells.

    Raises:
        PlotError: Matplotlib is missing.
    """
    figure = _new_figure(10.0, 5.4)
    left, right = figure.subplots(1, 2)
    for number, (system, results) in enumerate(by_system.items()):
        success = success_curve([value for result in results for value in result.overlaps])
        precision = precision_curve([value for result in results for value in result.centre_errors_px])
        style = {"color": f"C{number % COLOURS}", "ls": LINE_STYLES[number // COLOURS % len(LINE_STYLES)], "lw": 1.6}
        left.plot(success.thresholds, success.shares, label=f"{system} [{success.area:.3f}]", **style)
        at_px = precision.shares[PRECISION_PX]
        right.plot(precision.thresholds, precision.shares, label=f"{system} [{at_px:.3f}]", **style)
    left.set(title="success [area under the curve]", xlabel="overlap threshold", ylabel="share of labels")
    right.set(title=f"precision [at {PRECISION_PX} px]", xlabel="centre error threshold (px)")
    for axes in (left, right):
        axes.set_ylim(-0.02, 1.02)
        axes.grid(alpha=0.25)
        axes.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=3)
    return _png(figure)


def speed_accuracy_png(table: Table) -> bytes:
    """A PNG of mean AP against the events that a system takes in a second of its own time, for systems with a mean.

    Raises:
        PlotError: Matplotlib is missing.
    """
    figure = _new_figure(7.0, 4.6)
    from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter

    axes = figure.subplots()
    places = {system: (table.speeds[system].events_per_s, entry.ap.mean) for system, entry in table.means.items()}
    for number, (system, place) in enumerate(places.items()):
        axes.plot(*place, "o", color=f"C{number % COLOURS}")
        above = sum(_is_just_above(other, place) for other in places.values())
        offset = LABEL_ABOVE_PT if above == 0 else LABEL_BELOW_PT * above
        axes.annotate(system, place, xytext=(5, offset), textcoords="offset points", fontsize=8)
    axes.set(xscale="log", xlabel="events/s in the system's own time", ylabel="mean AP", ylim=(-0.02, 1.02))
    axes.margins(x=0.15)
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(EngFormatter())
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.25, which="both")
    return _png(figure)


def _is_just_above(other: tuple[float, float], place: tuple[float, float]) -> bool:
    """Whether a system's name would lie on that of another one; places as (events/s, AP)."""
    is_near = abs(math.log10(other[0] / place[0])) < NAME_DECADES and 0 <= other[1] - place[1] < NAME_AP
    return is_near and other > place if other[1] == place[1] else is_near


def overlap_strips_png(by_target: Mapping[str, Mapping[str, CellResult]]) -> bytes:
    """A PNG of the overlap over time: a panel for each target, a strip for each system.

    Args:
        by_target: by target and system, one cell each.

    Raises:
        PlotError: Matplotlib is missing.
    """
    heights = [PANEL_INCHES[1] + STRIP_INCHES * len(cells) for cells in by_target.values()]
    figure = _new_figure(PANEL_INCHES[0], sum(heights))
    grid = figure.subplots(len(by_target), 1, squeeze=False, gridspec_kw={"height_ratios": heights})[:, 0]
    for axes, (target, cells) in zip(grid, by_target.items(), strict=True):
        drawn = _draw_strips(axes, cells)
        axes.set_title(target, fontsize=10, loc="left", parse_math=False)
    grid[-1].set_xlabel("time since the first label scored (s)")
    figure.colorbar(drawn, ax=list(grid), label="overlap", shrink=min(1.0, 2.5 / sum(heights)), pad=0.01)
    return _png(figure)


def _draw_strips(axes: Any, cells: Mapping[str, CellResult]) -> Any:
    stamps_ns = np.unique(np.concatenate([np.asarray(cell.stamps_ns, np.int64) for cell in cells.values()]))
    values = np.full((len(cells), len(stamps_ns)), np.nan)
    for row, cell in enumerate(cells.values()):
        values[row, np.searchsorted(stamps_ns, cell.stamps_ns)] = cell.overlaps
    axes.set_facecolor(NOT_SCORED)
    axes.set_yticks(np.arange(len(cells)) + 0.5, list(cells), fontsize=7)
    axes.invert_yaxis()
    edges_s = (_edges(stamps_ns) - stamps_ns[0]) / NS_PER_S
    return axes.pcolormesh(edges_s, np.arange(len(cells) + 1), values, vmin=0, vmax=1, cmap="RdYlGn")


def _edges(stamps_ns: Any) -> Any:
    """Where each label's colour begins and ends: halfway to its neighbours."""
    if len(stamps_ns) == 1:
        return np.array([stamps_ns[0], stamps_ns[0] + NS_PER_S])
    middles = (stamps_ns[1:] + stamps_ns[:-1]) / 2
    return np.concatenate([[stamps_ns[0] - (middles[0] - stamps_ns[0])], middles, [2.0 * stamps_ns[-1] - middles[-1]]])


def _new_figure(width_inch: float, height_inch: float) -> Any:
    check_matplotlib()
    from matplotlib.figure import Figure

    return Figure(figsize=(width_inch, height_inch), layout="constrained")


def _png(figure: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()
