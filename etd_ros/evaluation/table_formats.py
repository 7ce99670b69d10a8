"""Tables as Markdown, LaTeX, HTML, CSV and plain text, in the paper's form: the best value of each column in bold."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape

from etd_ros.evaluation.curves import Speed
from etd_ros.evaluation.paper_figures import METHODS as PAPER_NAMES
from etd_ros.evaluation.tables import DIGITS, MEAN, Entry, Figure, Table, rounded

NOTHING = "–"
PAPER = "paper"
LATEX_CHARACTERS = 64
"""How wide the columns of a table may be beside the systems' names: what LaTeX's article class has room for."""
LATEX_GAP = 2
"""Between columns, in characters."""
EVENTS_PER_MEV = 1e6
SPEED_COLUMNS = ("ms_per_frame", "frames_per_s", "events_per_s")
LATEX_SPECIAL = {
    "_": r"\_", "&": r"\&", "%": r"\%", "#": r"\#", "$": r"\$", "{": r"\{", "}": r"\}",
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "|": r"\textbar{}", "<": r"\textless{}", ">": r"\textgreater{}",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Cell:
    """One number of the table, ready for any format."""

    text: str
    spread: str
    is_best: bool

    @classmethod
    def of(cls, figure: Figure | None, best: float) -> _Cell:
        if figure is None:
            return cls(NOTHING, "", is_best=False)
        spread = "" if figure.spread is None else f"{figure.spread:.{DIGITS}f}"
        return cls(f"{figure.mean:.{DIGITS}f}", spread, is_best=rounded(figure.mean) == best)


@dataclass(frozen=True, slots=True)
class _Column:
    """A column with its sub-columns."""

    title: str
    parts: tuple[str, ...]
    of: Callable[[str], tuple[_Cell, ...]]


def markdown(table: Table) -> str:
    """A table for Markdown; means over repetitions with the standard deviation after ±."""
    columns = list(_columns(table))
    titles = [f"{column.title} {part}".strip() for column in columns for part in column.parts]
    lines = [_line(["system", *titles]), _line(["-", *("-:" for _ in titles)])]
    for system in table.rows:
        cells = [cell for column in columns for cell in column.of(system)]
        lines.append(_line([system, *(_marked(cell, "**{}**", " ± {}") for cell in cells)]))
    return "\n".join(lines) + "\n"


def latex(table: Table) -> str:
    """Tables in the form of the paper's and with its spellings, which need no package: as many as it takes for each to
    fit between a page's margins. There is room for four of the paper's sequences, or two beside its figures."""
    return "\n".join(_latex_page(list(table.rows), columns) for columns in _pages(table))


def _pages(table: Table) -> list[list[_Column]]:
    """The columns of each LaTeX table. The paper's figures stay beside those of the same sequence."""
    pages: list[list[_Column]] = []
    for column in _columns(table):
        width = sum(_latex_width(other, table.rows) for other in (*(pages[-1] if pages else ()), column))
        if not pages or (width > LATEX_CHARACTERS and column.title != PAPER):
            pages.append([])
        pages[-1].append(column)
    return pages


def _latex_width(column: _Column, systems: Iterable[str]) -> int:
    """About how many characters a column is wide, gaps between its parts included."""
    of_systems = [column.of(system) for system in systems]
    parts = [
        max(len(title), *(len(_marked(cells[number], "{}", " ± {}")) for cells in of_systems))
        for number, title in enumerate(column.parts)
    ]
    return max(len(column.title), sum(parts) + LATEX_GAP * (len(parts) - 1)) + LATEX_GAP


def _latex_page(systems: Iterable[str], columns: Sequence[_Column]) -> str:
    width = 1 + sum(len(column.parts) for column in columns)
    heads = " & ".join(rf"\multicolumn{{{len(column.parts)}}}{{c|}}{{{_escaped(column.title)}}}" for column in columns)
    parts = " & ".join(_escaped(part) for column in columns for part in column.parts)
    lines = [
        rf"{{\footnotesize\setlength{{\tabcolsep}}{{3pt}}\begin{{tabular}}{{|{'c|' * width}}}",
        r"\hline",
        rf" & {heads} \\ \cline{{2-{width}}}",
        rf"Method & {parts} \\ \hline\hline",
    ]
    for system in systems:
        cells = [cell for column in columns for cell in column.of(system)]
        values = " & ".join(_marked(cell, r"\textbf{{{}}}", r" $\pm$ {}").replace(NOTHING, "--") for cell in cells)
        lines.append(rf"{_escaped(PAPER_NAMES.get(system, system))} & {values} \\ \hline")
    return "\n".join([*lines, r"\end{tabular}}"]) + "\n"


def html(table: Table) -> str:
    """A table for a page of HTML."""
    columns = list(_columns(table))
    heads = "".join(f'<th colspan="{len(column.parts)}">{escape(column.title)}</th>' for column in columns)
    parts = "".join(f"<th>{part}</th>" for column in columns for part in column.parts)
    rows = []
    for system in table.rows:
        cells = [cell for column in columns for cell in column.of(system)]
        values = "".join(f"<td>{_marked(cell, '<b>{}</b>', ' ± {}')}</td>" for cell in cells)
        rows.append(f"<tr><th>{escape(system)}</th>{values}</tr>")
    head = f'<tr><th rowspan="2">system</th>{heads}</tr><tr>{parts}</tr>'
    return f"<table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table>"


def csv_text(table: Table) -> str:
    """A table for programs: protocol, system, dataset, sequence, AP and AR with their spreads, and the paper's; with a
    system's mean its failures and its speed over all sequences."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    names = ("protocol", "system", "dataset", "sequence", "ap", "ap_spread", "ar", "ar_spread", "paper_ap", "paper_ar")
    writer.writerow((*names, "failures", *SPEED_COLUMNS))
    for system, row in table.rows.items():
        for column in table.columns:
            paper = table.printed(column).get(system, ("", ""))
            writer.writerow((table.protocol, system, *column, *_numbers(row.get(column)), *paper, "", "", "", ""))
        failures, measured = table.failures.get(system), table.speeds[system]
        speeds = (measured.frame_ms, measured.frames_per_s, measured.events_per_s)
        over_all = (
            failures.mean if failures else "", *("" if math.isnan(value) else value for value in speeds)
        )  # fmt: skip
        writer.writerow((table.protocol, system, "", MEAN, *_numbers(table.means.get(system)), "", "", *over_all))
    return file.getvalue()


def plain(table: Table) -> str:
    """A table for the terminal."""
    columns = list(_columns(table))
    lines = [
        ["", *(title for column in columns for title in (column.title, *[""] * (len(column.parts) - 1)))],
        ["", *(part for column in columns for part in column.parts)],
    ]
    for system in table.rows:
        cells = [cell for column in columns for cell in column.of(system)]
        lines.append([system, *(_marked(cell, "{}", " ±{}") for cell in cells)])
    # A title may reach over the columns below it, so that only their own entries set the widths.
    widths = [max(len(line[column]) for line in lines[1:]) for column in range(len(lines[1]))]
    return "".join(_aligned(line, widths) for line in lines)


def _aligned(line: Sequence[str], widths: Sequence[int]) -> str:
    numbers = "  ".join(f"{text:>{width}}" for text, width in zip(line[1:], widths[1:], strict=True))
    return f"{line[0]:<{widths[0]}}  {numbers}".rstrip() + "\n"


def _columns(table: Table) -> Iterator[_Column]:
    datasets = {dataset for dataset, _ in table.columns}
    for key in table.columns:
        yield _scores(table, key, key[1] if len(datasets) == 1 else "/".join(key))
        if paper := table.printed(key):
            yield _paper(paper)
    if len(table.columns) > 1:
        yield _scores(table, MEAN, MEAN)
    if table.protocol == "restarts":
        yield _Column("restarts", ("failures",), lambda system: (_failures(table.failures.get(system)),))
    yield _Column("time", ("ms/frame", "frames/s", "Mev/s"), lambda system: _speed(table.speeds[system]))


def _scores(table: Table, key: tuple[str, str] | str, title: str) -> _Column:
    best_ap, best_ar = table.best(key, "ap"), table.best(key, "ar")

    def of(system: str) -> tuple[_Cell, ...]:
        entry = table.entry(system, key)
        return (
            tuple(_Cell.of(figure, best) for figure, best in ((entry.ap, best_ap), (entry.ar, best_ar)))
            if entry
            else (_Cell.of(None, best_ap), _Cell.of(None, best_ar))
        )

    return _Column(title, ("AP", "AR"), of)


def _paper(paper: Mapping[str, tuple[float, float]]) -> _Column:
    """The paper's own figures, none of them in bold: they are on other labels."""

    def of(system: str) -> tuple[_Cell, ...]:
        values = paper.get(system)
        return tuple(_Cell.of(value if value is None else Figure(value), math.nan) for value in values or (None, None))

    return _Column(PAPER, ("AP", "AR"), of)


def _failures(figure: Figure | None) -> _Cell:
    if figure is None:
        return _Cell(NOTHING, "", is_best=False)
    return _Cell(f"{figure.mean:.1f}".removesuffix(".0"), "" if not figure.spread else f"{figure.spread:.1f}", False)


def _speed(of_system: Speed) -> tuple[_Cell, ...]:
    if math.isnan(of_system.frame_ms):
        return (_Cell(NOTHING, "", is_best=False),) * 3
    shown = (
        f"{of_system.frame_ms:.2f}", f"{of_system.frames_per_s:.0f}", f"{of_system.events_per_s / EVENTS_PER_MEV:.2f}"
    )  # fmt: skip
    return tuple(_Cell(text, "", is_best=False) for text in shown)


def _marked(cell: _Cell, best: str, spread: str) -> str:
    text = best.format(cell.text) if cell.is_best else cell.text
    return text + (spread.format(cell.spread) if cell.spread else "")


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"


def _numbers(entry: Entry | None) -> tuple[float | str, ...]:
    """AP, its spread, AR and its spread; empty where there is none."""
    if entry is None:
        return ("",) * 4
    return tuple(
        "" if value is None else value for value in (entry.ap.mean, entry.ap.spread, entry.ar.mean, entry.ar.spread)
    )


def _escaped(text: str) -> str:
    return "".join(LATEX_SPECIAL.get(character, character) for character in text)
