"""The files that a comparison leaves in a folder."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from etd_ros.evaluation.cells import CellResult, ProtocolName
from etd_ros.evaluation.table_formats import csv_text, latex, markdown
from etd_ros.evaluation.tables import make_table
from etd_ros.output_files import OutputError, write_beside

FORMATS = {"md": markdown, "tex": latex, "csv": csv_text}


def make_folder(folder: Path) -> None:
    """Have a folder to write to, before the work rather than after it.

    Raises:
        OutputError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as err:
        msg = f"{folder}: cannot be made ({err.strerror or err}): name a folder where you may write"
        raise OutputError(msg) from err


def write_tables(
    folder: Path, results: Iterable[CellResult], protocols: Sequence[ProtocolName], systems: Sequence[str]
) -> None:
    """Write a table of each protocol in each format, as in table_one-pass.md.

    Raises:
        OutputError: a file cannot be written.
    """
    found = list(results)
    for protocol in protocols:
        table = make_table(found, protocol, systems)
        for suffix, text in FORMATS.items():
            write_beside(folder / f"table_{protocol}.{suffix}", text(table))
