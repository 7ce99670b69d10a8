"""Figures of the starts in sequences, and the CSV file of them."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np

from etd_ros.evaluation.scoring import SUCCESS_IOU
from etd_ros.evaluation.starting import KINDS, StartResult
from etd_ros.output_files import written_beside

SOON_S = 0.3


@dataclass(frozen=True, slots=True)
class StartSummary:
    """Figures of one or several sequences; NaN where there is nothing to take a figure of.

    Attributes:
        name: of the sequence, or of what the sequences have in common.
        targets: how many can be half seen at some time.
        soon: share of them on which a target started by itself within 0.3 s of that.
        ever: share of them on which one did at any time.
        false_per_s: starts on nothing that moves, a second.
        parts_per_s: starts on parts of things that move, a second.
        twice_share: mean share of the frames on which two targets were on one thing.
        clicks: how many.
        answered: share of them that started a target within 0.4 s.
        click_iou: median IoU of the answered ones' boxes with the truth.
        click_middle: share of the clicks on a target's middle that gave a box with an IoU of at least 0.5.
        click_beside: the same of the clicks beside the middle.
        frame_ms: mean processor time of looking for targets, a frame (ms).
    """

    name: str
    targets: int
    soon: float
    ever: float
    false_per_s: float
    parts_per_s: float
    twice_share: float
    clicks: int
    answered: float
    click_iou: float
    click_middle: float
    click_beside: float
    frame_ms: float


COLUMNS = tuple(field.name for field in fields(StartSummary))


def summarise(name: str, results: Sequence[StartResult]) -> StartSummary:
    """The figures of at least one sequence."""
    delays_s = [delay for result in results for delay in result.delays_s]
    clicks = [click for result in results for click in result.clicks]
    ious = [click.iou for click in clicks if click.iou is not None]
    successes = [(click.is_middle, click.iou is not None and click.iou >= SUCCESS_IOU) for click in clicks]
    duration_s = sum(result.duration_s for result in results)
    return StartSummary(
        name=name,
        targets=len(delays_s),
        soon=_share(delay is not None and delay <= SOON_S for delay in delays_s),
        ever=_share(delay is not None for delay in delays_s),
        false_per_s=sum(result.false_starts for result in results) / duration_s,
        parts_per_s=sum(result.parts for result in results) / duration_s,
        twice_share=float(np.mean([result.twice_share for result in results])),
        clicks=len(clicks),
        answered=len(ious) / len(clicks) if clicks else math.nan,
        click_iou=float(np.median(ious)) if ious else math.nan,
        click_middle=_share(is_hit for is_middle, is_hit in successes if is_middle),
        click_beside=_share(is_hit for is_middle, is_hit in successes if not is_middle),
        frame_ms=float(np.mean([result.frame_ms for result in results])),
    )


def by_kind(results: Sequence[StartResult]) -> list[StartSummary]:
    """The figures of each of KINDS that occurs, and of all of at least one sequence."""
    of_kinds = [(kind, [result for result in results if result.kind == kind]) for kind in KINDS]
    return [*(summarise(kind, those) for kind, those in of_kinds if those), summarise("all", results)]


def write_summaries(path: Path, summaries: Iterable[StartSummary]) -> None:
    """Write a CSV, a row for each summary, numbers with 3 decimals, empty cells where there is no figure.

    Raises:
        OutputError: the file cannot be written.
    """
    with written_beside(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for summary in summaries:
            writer.writerow(map(_cell, astuple(summary)))


def _cell(value: str | float) -> str | float:
    if not isinstance(value, float):
        return value
    return "" if math.isnan(value) else f"{value:.3f}"


def _share(values: Iterable[bool]) -> float:
    counted = list(values)
    return sum(counted) / len(counted) if counted else math.nan
