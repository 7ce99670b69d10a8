"""The comparison as a table: a row for each system, AP and AR for each sequence, and their means."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev

from etd_ros.evaluation.cells import CellResult, ProtocolName
from etd_ros.evaluation.curves import Speed, speed
from etd_ros.evaluation.paper_figures import printed

DIGITS = 3
MEAN = "mean"

Column = tuple[str, str] | str
"""A sequence as (dataset, name), or MEAN."""


@dataclass(frozen=True, slots=True)
class Figure:
    """AP or AR of a system.

    Attributes:
        mean: over repetitions and targets, as the paper's Sec. 4.1 has it; or over the sequences' means.
        spread: standard deviation over the repetitions, each taken as a whole; None where there is one only.
    """

    mean: float
    spread: float | None = None


@dataclass(frozen=True, slots=True)
class Entry:
    """What a system reached in a column.

    Attributes:
        ap, ar: average precision and robustness.
    """

    ap: Figure
    ar: Figure


@dataclass(frozen=True, slots=True)
class Table:
    """Results of one protocol.

    Attributes:
        protocol: its name.
        columns: sequences, in order, as (dataset, name).
        rows: by system, in order, an entry for each column that has one: a system that brought an error for any target
            or repetition of a sequence has none there.
        means: by system, the means over all columns in which any system has an entry; for systems with one in each.
        speeds: by system, over all of its cells.
        failures: by system, failed labels of all targets that brought a result; mean and spread over the repetitions.
    """

    protocol: ProtocolName
    columns: Sequence[tuple[str, str]]
    rows: Mapping[str, Mapping[tuple[str, str], Entry]]
    means: Mapping[str, Entry]
    speeds: Mapping[str, Speed]
    failures: Mapping[str, Figure]

    def printed(self, column: tuple[str, str]) -> dict[str, tuple[float, float]]:
        """What the paper printed for a column, by system; empty where it has no such sequence."""
        return printed(column[1])

    def entry(self, system: str, column: Column) -> Entry | None:
        """What a system reached in a column, or over all of them."""
        return self.means.get(system) if isinstance(column, str) else self.rows[system].get(column)

    def best(self, column: Column, of: str) -> float:
        """The best value of `ap` or `ar` in a column to the digits shown; NaN in an empty one."""
        entries = (self.entry(system, column) for system in self.rows)
        return max((rounded(getattr(entry, of).mean) for entry in entries if entry), default=math.nan)


def rounded(value: float) -> float:
    """To the digits that tables show."""
    return round(value, DIGITS)


def make_table(results: Iterable[CellResult], protocol: ProtocolName, systems: Sequence[str]) -> Table:
    """The table of a protocol.

    Args:
        results: of any protocols and systems; those of others are passed over.
        protocol: which one.
        systems: the rows.
    """
    chosen = [result for result in results if result.cell.protocol == protocol and result.cell.system in systems]
    columns = list(dict.fromkeys((result.cell.dataset, result.cell.sequence) for result in chosen))
    by_place: defaultdict[tuple[str, tuple[str, str]], list[CellResult]] = defaultdict(list)
    for result in chosen:
        by_place[result.cell.system, (result.cell.dataset, result.cell.sequence)].append(result)
    rows = {
        system: {
            column: _entry([found])
            for column in columns
            if (found := by_place[system, column]) and all(result.error is None for result in found)
        }
        for system in systems
    }
    counting = judged(rows)
    means = {
        system: _entry([by_place[system, column] for column in row])
        for system, row in rows.items()
        if row and row.keys() == counting
    }
    speeds = {system: speed_of(chosen, system) for system in systems}
    failures = {system: figure for system in systems if (figure := _failures(chosen, system))}
    return Table(protocol, columns, rows, means, speeds, failures)


def judged(rows: Mapping[str, Mapping[tuple[str, str], Entry]]) -> set[tuple[str, str]]:
    """The columns in which any system has an entry: what none could be run on, such as a damaged recording, says
    nothing of any of them."""
    return {column for row in rows.values() for column in row}


def speed_of(results: Iterable[CellResult], system: str) -> Speed:
    """Over all of a system's cells that brought a result."""
    found = [result for result in results if result.cell.system == system and result.error is None]
    return speed(
        sum(result.frames for result in found),
        sum(result.events for result in found),
        sum(result.seconds for result in found),
    )


def _failures(results: Iterable[CellResult], system: str) -> Figure | None:
    by_repetition: defaultdict[int, int] = defaultdict(int)
    for result in results:
        if result.cell.system == system and result.error is None:
            by_repetition[result.cell.repetition] += result.failures
    return _figure(list(by_repetition.values())) if by_repetition else None


def _entry(sequences: Sequence[Sequence[CellResult]]) -> Entry:
    """Of one system: the mean over the sequences in each repetition that all of them have, then mean and spread of
    these."""
    return Entry(*(_figure(_by_repetition(sequences, of)) for of in ("ap", "ar")))


def _by_repetition(sequences: Sequence[Sequence[CellResult]], of: str) -> list[float]:
    found = [_means_over_targets(results, of) for results in sequences]
    common = [repetition for repetition in found[0] if all(repetition in means for means in found)]
    return [fmean(means[repetition] for means in found) for repetition in common]


def _means_over_targets(results: Iterable[CellResult], of: str) -> dict[int, float]:
    """Of one sequence, by repetition."""
    values: defaultdict[int, list[float]] = defaultdict(list)
    for result in results:
        values[result.cell.repetition].append(getattr(result, of))
    return {repetition: fmean(found) for repetition, found in values.items()}


def _figure(values: Sequence[float]) -> Figure:
    return Figure(fmean(values), stdev(values) if len(values) > 1 else None)
