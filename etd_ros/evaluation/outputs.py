"""The files that a comparison leaves in a folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from etd_ros.evaluation.cell_run import CellTask
from etd_ros.evaluation.cells import CellResult, ProtocolName
from etd_ros.evaluation.plots import plots_of
from etd_ros.evaluation.report import report_html
from etd_ros.evaluation.table_formats import csv_text, latex, markdown
from etd_ros.evaluation.tables import make_table
from etd_ros.output_files import write_beside

FORMATS = {"md": markdown, "tex": latex, "csv": csv_text}


def write_comparison(
    folder: Path,
    tasks: Sequence[CellTask],
    results: Sequence[CellResult],
    protocols: Sequence[ProtocolName],
    systems: Sequence[str],
) -> None:
    """Write tables and plots of each protocol, as in table_one-pass.md, and report.html.

    Raises:
        PlotError: Matplotlib is missing.
        OutputError: a file cannot be written.
        EtdError: a recording cannot be read any more.
    """
    for protocol in protocols:
        found = [result for result in results if result.cell.protocol == protocol]
        table = make_table(found, protocol, systems)
        for suffix, text in FORMATS.items():
            write_beside(folder / f"table_{protocol}.{suffix}", text(table))
        for plot in plots_of(table, found):
            write_beside(folder / f"{plot.name}_{protocol}.png", plot.png)
    write_beside(folder / "report.html", report_html(tasks, results, protocols, systems))
