"""`evaluate --suite` and `--random`: how well a method tracks, or with `--start` finds, simulated targets."""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from collections.abc import Mapping, Sequence

from etd_ros.evaluation import EvaluationError
from etd_ros.evaluation.known_figures import TOLERANCE, Figures, TargetKey, changes, read_figures
from etd_ros.evaluation.starting import StartResult, evaluate_starts
from etd_ros.evaluation.starting_summary import StartSummary, by_kind, summarise, write_summaries
from etd_ros.evaluation.suite import TargetResult, evaluate, write_results
from etd_ros.output_files import check_outputs
from etd_ros.settings import Settings
from etd_ros.simulation import SUITE, random_sequences, sequence_named
from etd_ros.simulation import Sequence as Simulated
from etd_ros.tracking import DEFAULT_METHOD, method_named

HEADER = (
    f"{'sequence':<16}{'targets':>8}{'AP':>7}{'AR':>7}{'min AP':>8}{'survived':>10}{'longer':>8}{'left s':>8}"
    f"{'false':>7}{'recovered':>11}{'wrong':>7}"
)
START_HEADER = (
    f"{'sequence':<30}{'targets':>8}{'0.3 s':>7}{'ever':>6}{'false/s':>9}{'parts/s':>9}{'twice':>7}"
    f"{'clicks':>8}{'answered':>10}{'IoU':>6}{'middle':>8}{'beside':>8}{'ms':>6}"
)
NO_TARGET = "no target can be seen in any of the sequences: choose other ones"
EXIT_FELL = 1


def run_simulated(options: argparse.Namespace, settings: Settings) -> int:
    """Track or start targets, print a row for each sequence and the means; write the CSV; with `--against`, say what
    differs from a CSV of before. The exit code is 1 where a figure fell.

    Raises:
        EvaluationError: a number that is out of range, figures that cannot be read, or no target in any sequence.
    """
    options.method = options.method or DEFAULT_METHOD
    method_named(options.method)
    check_outputs(options.write, inputs=(options.against,))
    sequences = _sequences(options)
    if options.start and options.against:
        msg = "--against compares what is tracked, and means nothing with --start: leave one of them out"
        raise EvaluationError(msg)
    if options.start:
        _start(sequences, settings, options)
        return 0
    known = read_figures(options.against) if options.against else None
    results = _track(sequences, settings, options)
    return 0 if known is None else _compare(sequences, results, known, options)


def _track(sequences: Sequence[Simulated], settings: Settings, options: argparse.Namespace) -> list[TargetResult]:
    results: list[TargetResult] = []
    unseen: list[str] = []
    print(HEADER)
    of_sequences = evaluate(sequences, method=options.method, settings=settings, jobs=options.jobs)
    for sequence, found in zip(sequences, of_sequences, strict=True):
        results += found
        unseen += _unseen(sequence, found)
        print(_row(sequence.name, found), flush=True)
    if not results:
        raise EvaluationError(NO_TARGET)
    print(_row("all", results))
    if unseen:
        print(f"Left out, as half of them can never be seen, or only once: {', '.join(unseen)}", file=sys.stderr)
    if options.write:
        write_results(options.write, results)
    return results


def _compare(
    sequences: Sequence[Simulated],
    results: Sequence[TargetResult],
    known: Mapping[TargetKey, Figures],
    options: argparse.Namespace,
) -> int:
    """Print a line for each target that fell or rose, then a sum; the exit code."""
    changed = changes(results, known, (sequence.name for sequence in sequences))
    for change in changed:
        print(change)
    fell = sum(change.fell for change in changed)
    if not fell:
        print(f"No target fell by more than {TOLERANCE} below {options.against}")
        return 0
    print(
        f"{fell} fell by more than {TOLERANCE} below {options.against}, or are missing on one side: if that is meant, "
        f"write the file anew, of all its sequences (--write {options.against} without --only)",
        file=sys.stderr,
    )
    return EXIT_FELL


def _unseen(sequence: Simulated, results: Sequence[TargetResult]) -> list[str]:
    """Which targets of a sequence have no results, with the sequence's name."""
    if len(results) == sequence.recipe.targets:
        return []
    found = {result.target for result in results}
    return [f"{name} of {sequence.name}" for name in sequence.scene().targets if name not in found]


def _start(sequences: Sequence[Simulated], settings: Settings, options: argparse.Namespace) -> None:
    results: list[StartResult] = []
    print(START_HEADER)
    for result in evaluate_starts(sequences, method=options.method, settings=settings, jobs=options.jobs):
        results.append(result)
        print(_start_row(summarise(result.sequence, [result])), flush=True)
    if not any(result.delays_s for result in results):
        raise EvaluationError(NO_TARGET)
    for summary in by_kind(results):
        print(_start_row(summary))
    if options.write:
        write_summaries(options.write, (summarise(result.sequence, [result]) for result in results))


def _sequences(options: argparse.Namespace) -> list[Simulated]:
    seed = options.seed
    if seed is not None and seed < 0:
        msg = f"--seed {seed} is below 0: give a seed of 0 or more"
        raise EvaluationError(msg)
    if options.suite:
        sequences = [sequence_named(name) for name in options.only] or list(SUITE.values())
        return sequences if seed is None else [sequence.with_seed(seed) for sequence in sequences]
    if options.only:
        msg = f"--only {' '.join(options.only)} names sequences of the suite or of datasets: give --suite or --dataset"
        raise EvaluationError(msg)
    if options.random < 1:
        msg = f"--random {options.random}: give at least 1 sequence"
        raise EvaluationError(msg)
    first = seed or 0
    return random_sequences(range(first, first + options.random))


def _row(name: str, results: Sequence[TargetResult]) -> str:
    """Means over targets of AP, AR and false boxes, the worst AP and delay, and sums; dashes where there is none."""
    if not results:
        return f"{name:<16}{0:>8}{'-':>7}{'-':>7}{'-':>8}{'-':>10}{'-':>8}{'-':>8}{'-':>7}{'-':>11}{'-':>7}"
    total = {
        field.name: [getattr(result, field.name) for result in results] for field in dataclasses.fields(TargetResult)
    }
    columns = "occlusions", "survived", "longer", "longer_survived", "left", "recoveries", "wrong_recoveries"
    sums = {column: sum(total[column]) for column in columns}
    survived = f"{sums['survived']}/{sums['occlusions']}" if sums["occlusions"] else "-"
    longer = f"{sums['longer_survived']}/{sums['longer']}" if sums["longer"] else "-"
    left_s = f"{max(total['left_s']):.2f}" if sums["left"] else "-"
    left = [result.false_share for result in results if result.left]
    false_share = f"{sum(left) / len(left):.2f}" if left else "-"
    ap, ar = (sum(total[column]) / len(results) for column in ("ap", "ar"))
    return (
        f"{name:<16}{len(results):>8}{ap:>7.3f}{ar:>7.3f}{min(total['ap']):>8.3f}{survived:>10}{longer:>8}{left_s:>8}"
        f"{false_share:>7}{sums['recoveries']:>11}{sums['wrong_recoveries']:>7}"
    )


def _start_row(summary: StartSummary) -> str:
    def figure(value: float, width: int) -> str:
        return f"{'-' if math.isnan(value) else f'{value:.2f}':>{width}}"

    return (
        f"{summary.name:<30}{summary.targets:>8}{figure(summary.soon, 7)}{figure(summary.ever, 6)}"
        f"{figure(summary.false_per_s, 9)}{figure(summary.parts_per_s, 9)}{figure(summary.twice_share, 7)}"
        f"{summary.clicks:>8}{figure(summary.answered, 10)}{figure(summary.click_iou, 6)}"
        f"{figure(summary.click_middle, 8)}{figure(summary.click_beside, 8)}{figure(summary.frame_ms, 6)}"
    )
