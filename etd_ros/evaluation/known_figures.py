"""Figures of simulated targets that a file keeps, and which of them a run changes.

Not re-exported by `etd_ros.evaluation`, as suite.py is not.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from etd_ros.evaluation.suite import COLUMNS, TargetResult
from etd_ros.evaluation.table import read_rows

TOLERANCE = 0.02
"""What AP or AR may differ by: processors round sums otherwise, and a box that is found a frame later for it costs some
thousandths."""
DECIMALS = 3
"""Of figures in the file; differences are told to as many, so that what is equal there is."""


class Figures(NamedTuple):
    """Average precision and robustness of a target."""

    ap: float
    ar: float


class TargetKey(NamedTuple):
    """A target of a sequence, by their names."""

    sequence: str
    target: str


@dataclass(frozen=True, slots=True)
class Change:
    """A target whose figures differ, or that the file or the run alone has.

    Attributes:
        key: which.
        known: what the file says; None if it has no line of it.
        now: what the run found; None if it has no result of it.
    """

    key: TargetKey
    known: Figures | None
    now: Figures | None

    @property
    def fell(self) -> bool:
        """Whether AP or AR is lower by more than the tolerance, or is missing on one side."""
        return self.known is None or self.now is None or _is_lower(self.now, self.known)

    @property
    def rose(self) -> bool:
        """Whether AP or AR is higher by more than the tolerance, and neither fell."""
        return self.known is not None and self.now is not None and not self.fell and _is_lower(self.known, self.now)

    def __str__(self) -> str:
        """The change in a line."""
        name = f"{self.key.sequence} {self.key.target}"
        if self.known is None:
            return f"{name} has no line in the file"
        if self.now is None:
            return f"{name} has a line in the file, but no result"
        figures = (
            f"{what} {now:.{DECIMALS}f} instead of {known:.{DECIMALS}f}"
            for what, now, known in zip(("AP", "AR"), self.now, self.known, strict=True)
        )
        return f"{name} {'fell' if self.fell else 'rose'}: {', '.join(figures)}"


def read_figures(path: Path) -> dict[TargetKey, Figures]:
    """Figures of each target of a file that `write_results` wrote, in its order.

    Raises:
        EvaluationError: the file cannot be read, lacks a column, a figure is no number, or a target has two lines;
            names file, line and cure.
    """
    figures: dict[TargetKey, Figures] = {}
    for row in read_rows(path, COLUMNS):
        key = TargetKey(row.cells["sequence"].strip(), row.name())
        if key in figures:
            msg = f"another line has {key.target!r} of {key.sequence!r}, too: keep one"
            raise row.error(msg)
        figures[key] = Figures(row.number("ap"), row.number("ar"))
    return figures


def changes(
    results: Iterable[TargetResult], known: Mapping[TargetKey, Figures], sequences: Iterable[str]
) -> list[Change]:
    """What differs by more than the tolerance between a run and a file.

    Args:
        results: of the run.
        known: of the file, from `read_figures`.
        sequences: names of those that were run; lines of others do not count.
    """
    now = {TargetKey(result.sequence, result.target): Figures(result.ap, result.ar) for result in results}
    were_run = set(sequences)
    keys = dict.fromkeys([*now, *(key for key in known if key.sequence in were_run)])
    compared = (Change(key, known.get(key), now.get(key)) for key in keys)
    return [change for change in compared if change.fell or change.rose]


def _is_lower(one: Figures, other: Figures) -> bool:
    return any(round(of_other - of_one, DECIMALS) > TOLERANCE for of_one, of_other in zip(one, other, strict=True))
