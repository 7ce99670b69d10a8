"""The comparison as one page of HTML that needs nothing beside it: tables, plots, and pictures of failures."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Iterator, Sequence
from html import escape

import cv2

from etd_ros.evaluation.cell_run import CellTask, Workplace
from etd_ros.evaluation.cells import Cell, CellResult, ProtocolName
from etd_ros.evaluation.failures import Failure, failure_pictures, labels_before_answer, longest_failures
from etd_ros.evaluation.plots import plots_of
from etd_ros.evaluation.table_formats import html
from etd_ros.evaluation.tables import make_table
from etd_ros.overlay import Picture
from etd_ros.systems.registry import SYSTEMS

JPEG_QUALITY = 88
FAILURES_SHOWN = 2
"""Of each system and protocol, each of another target."""
FAILURES = (
    "<h3>Failures</h3><p>Of each system the longest times over which its overlap was below 0.5, of two targets at most:"
    ' where each begins, and its middle. <span class="label">Green: label.</span> '
    '<span class="answer">Red: answer.</span></p>'
)
RULES = {
    "one-pass": "Causal, a single pass: each label but the first is compared with the last answer at or before it.",
    "restarts": "The paper's protocol (Sec. 4.1): after a label overlapped by less than 0.5 the system starts again "
    "from the next label, which is not scored.",
}
STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #1c1e21; max-width: 1180px; margin: 2em auto; padding: 0 1.2em }
h1 { font-size: 1.7em } h2 { margin-top: 2em; border-bottom: 1px solid #ccc } h3 { margin: 1.4em 0 .3em }
h4 { margin: 1.2em 0 .2em } .failure { margin: .5em 0 .3em }
p { max-width: 75ch } img { max-width: 100% }
.wide { overflow-x: auto }
table { border-collapse: collapse; font-size: 13px } td, th { border: 1px solid #ccc; padding: .25em .6em }
td { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap } tbody th { text-align: left }
thead th { background: #f0f2f5 }
.failures { display: grid; grid-template-columns: repeat(auto-fill, minmax(420px, 1fr)); gap: 1.2em }
figure { margin: 0 } figcaption { font-size: 13px } .label { color: #188038 } .answer { color: #d93025 }
"""


def report_html(
    tasks: Sequence[CellTask], results: Sequence[CellResult], protocols: Sequence[ProtocolName], systems: Sequence[str]
) -> str:
    """The page. Recordings are read again for the pictures.

    Raises:
        PlotError: Matplotlib is missing.
        EtdError: a recording cannot be read any more.
    """
    parts = [f"<h1>{len(systems)} systems on {_counted(results)}</h1>", _list_of_systems(systems)]
    by_place = {
        (protocol, name): [
            result for result in results if (result.cell.protocol, result.cell.system) == (protocol, name)
        ]
        for protocol in protocols
        for name in systems
    }
    failures = {place: longest_failures(found, FAILURES_SHOWN) for place, found in by_place.items()}
    pictures = _pictures([failure for found in failures.values() for failure in found], tasks)
    for protocol in protocols:
        parts += _protocol(protocol, [result for result in results if result.cell.protocol == protocol], systems)
        parts.append(FAILURES)
        for name in systems:
            shown = failures[protocol, name]
            parts.append(f"<h4>{escape(name)}</h4>{_about(by_place[protocol, name], shown)}")
            parts += [_failure(failure, pictures[failure.result.cell]) for failure in shown]
    head = '<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>etd_ros: comparison</title>'
    body = "\n".join(parts)
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head>{head}<style>{STYLE}</style></head>\n<body>\n{body}\n</body></html>\n'
    )


def _counted(results: Iterable[CellResult]) -> str:
    cells = [result.cell for result in results]
    sequences = {(cell.dataset, cell.sequence) for cell in cells}
    targets = {(cell.dataset, cell.sequence, cell.target) for cell in cells}
    return f"{len(sequences)} sequences with {len(targets)} targets"


def _list_of_systems(systems: Iterable[str]) -> str:
    rows = (
        f"<tr><th>{escape(name)}</th><td style='text-align:left'>{escape(SYSTEMS[name].description)}</td></tr>"
        for name in systems
    )
    return f"<table><tbody>{''.join(rows)}</tbody></table>"


def _protocol(protocol: ProtocolName, results: Sequence[CellResult], systems: Sequence[str]) -> Iterator[str]:
    table = make_table(results, protocol, systems)
    yield f"<h2>{protocol}</h2><p>{RULES[protocol]}</p>"
    yield f'<div class="wide">{html(table)}</div>'
    if any(table.printed(column) for column in table.columns):
        yield "<p>Columns headed “paper” are its printed figures, on labels that were not published.</p>"
    yield from _errors(results)
    for plot in plots_of(table, results):
        yield f"<h3>{escape(plot.heading)}</h3>{_png(plot.png)}"


def _errors(results: Iterable[CellResult]) -> Iterator[str]:
    errors = dict.fromkeys((result.cell.system, result.error) for result in results if result.error is not None)
    if errors:
        items = "".join(f"<li>{escape(system)}: {escape(error or '')}</li>" for system, error in errors)
        yield f"<p>Without a result:</p><ul>{items}</ul>"


def _pictures(failures: Iterable[Failure], tasks: Iterable[CellTask]) -> dict[Cell, list[tuple[str, Picture]]]:
    """By cell. Those of a recording follow each other, so that it is read once."""
    by_cell = {task.cell: task for task in tasks}
    workplace = Workplace()
    in_order = sorted(failures, key=lambda failure: str(by_cell[failure.result.cell].recording))
    return {
        failure.result.cell: failure_pictures(failure, by_cell[failure.result.cell], workplace) for failure in in_order
    }


def _about(results: Sequence[CellResult], failures: Sequence[Failure]) -> str:
    """What there are no pictures of."""
    if all(result.error is not None for result in results):
        return "<p>Without a result.</p>"
    waited = sum(map(labels_before_answer, results))
    said = [
        "" if failures else "From its first answer on no overlap is below 0.5.",
        f"Missed before its first answer: {waited} label{'s' if waited > 1 else ''}." if waited else "",
    ]
    return f"<p>{' '.join(filter(None, said))}</p>" if any(said) else ""


def _failure(failure: Failure, pictures: Iterable[tuple[str, Picture]]) -> str:
    cell = failure.result.cell
    head = f"{cell.sequence}/{cell.target}: {failure.duration_s:.2f} s"
    figures = "".join(
        f"<figure>{_jpeg(picture, caption)}<figcaption>{escape(caption)}</figcaption></figure>"
        for caption, picture in pictures
    )
    return f'<p class="failure">{escape(head)}</p><div class="failures">{figures}</div>'


def _png(png: bytes) -> str:
    return f'<img alt="" src="data:image/png;base64,{base64.b64encode(png).decode()}">'


def _jpeg(picture: Picture, caption: str) -> str:
    data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
    return f'<img alt="{escape(caption)}" src="data:image/jpeg;base64,{base64.b64encode(data).decode()}">'
