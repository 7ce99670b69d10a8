"""`evaluate --dataset`: the compared systems on labelled recordings, as in the paper's tables."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from etd_ros.datasets import LabelledSequence, find_sequences, open_dataset
from etd_ros.evaluation import EvaluationError
from etd_ros.evaluation.cell_run import PROTOCOL_NAMES, CellTask
from etd_ros.evaluation.cells import CellResult, ProtocolName
from etd_ros.evaluation.cluster import check_address
from etd_ros.evaluation.matrix import REPETITIONS, Workforce, cell_tasks, fill_store, key_of, outstanding
from etd_ros.evaluation.outputs import write_comparison
from etd_ros.evaluation.store import Store
from etd_ros.evaluation.table_formats import plain
from etd_ros.evaluation.tables import make_table
from etd_ros.output_files import check_folder, make_folder
from etd_ros.plots import check_matplotlib
from etd_ros.settings import Settings
from etd_ros.systems.registry import SYSTEMS
from etd_ros.systems.running import check_named_models

REPETITIONS_MAX = 1000
CELL_TIMEOUT_MAX_S = 1_000_000
ERRORS_SHOWN = 10
STORE_NAME = "evaluation.sqlite"


def run_datasets(options: argparse.Namespace, settings: Settings) -> int:
    """Work out the cells that the store lacks, print a table for each protocol, write what is asked for; the exit code,
    2 where no cell brought a result.

    Raises:
        EtdError: an option that is out of range, a dataset that cannot be read, an output that cannot be written.
    """
    _check(options)
    systems = list(dict.fromkeys(options.systems or SYSTEMS))
    protocols = _protocols(options.protocol)
    sequences = _sequences(options.dataset, options.only, options.box_columns)
    tasks = cell_tasks(sequences, systems, protocols, options.repetitions or REPETITIONS, settings)
    check_named_models(systems, settings)
    if options.output:
        check_matplotlib()
        make_folder(options.output)
        check_folder(options.output)
    workforce = Workforce(options.jobs, options.cell_timeout, options.scheduler)
    with Store(_store_path(options.store, options.output)) as store:
        if not (options.store or options.output):
            print(f"results are kept in {store.path}", file=sys.stderr)
        _work(store, outstanding(store, tasks, retry_errors=bool(options.retry_errors)), len(tasks), workforce)
        results = list(store.results(map(key_of, tasks)))
        for protocol in protocols:
            print(f"{protocol}\n{plain(make_table(results, protocol, systems))}")
        if options.output:
            store.export_csv(options.output / "cells.csv", map(key_of, tasks))
            write_comparison(options.output, tasks, results, protocols, systems)
    _print_errors(results)
    return 2 if all(result.error is not None for result in results) else 0


def _check(options: argparse.Namespace) -> None:
    if options.repetitions is not None and not 1 <= options.repetitions <= REPETITIONS_MAX:
        msg = f"--repetitions {options.repetitions} is out of range [1, {REPETITIONS_MAX}]"
        raise EvaluationError(msg)
    if options.cell_timeout is not None and not 0 < options.cell_timeout <= CELL_TIMEOUT_MAX_S:
        msg = f"--cell-timeout {options.cell_timeout:g} is out of range (0, {CELL_TIMEOUT_MAX_S}] s"
        raise EvaluationError(msg)
    if options.scheduler is not None:
        check_address(options.scheduler)


def _protocols(name: str | None) -> tuple[ProtocolName, ...]:
    if name == "both":
        return PROTOCOL_NAMES
    return tuple(protocol for protocol in PROTOCOL_NAMES if protocol == (name or PROTOCOL_NAMES[0]))


def _sequences(
    datasets: Sequence[tuple[str, str]], only: Sequence[str], box_columns: str | None
) -> list[LabelledSequence]:
    """The sequences of the datasets, those of these names if any are named."""
    names = {path: [sequence.name for sequence in find_sequences(Path(path))] for _, path in datasets if only}
    known = [name for of_dataset in names.values() for name in of_dataset]
    for name in only:
        if name not in known:
            msg = f"--only {name}: no dataset has this sequence: choose of {', '.join(known)}"
            raise EvaluationError(msg)
    found = []
    for name, path in datasets:
        wanted = [sequence for sequence in only if sequence in names[path]]
        if only and not wanted:
            continue
        # Where no dataset can use them, the first one says so.
        columns = box_columns if name == "eed" or all(name != "eed" for name, _ in datasets) else None
        found += open_dataset(
            name, path, box_columns=columns, only=wanted, tell=lambda line: print(line, file=sys.stderr)
        )
    twice = [key for key, count in Counter((found.dataset, found.name) for found in found).items() if count > 1]
    if twice:
        msg = f"two folders of {twice[0][0]} have a sequence {twice[0][1]}: results could not be told apart, rename one"
        raise EvaluationError(msg)
    return found


def _store_path(store: Path | None, output: Path | None) -> Path:
    return store or (output or Path()) / STORE_NAME


def _work(store: Store, missing: Sequence[CellTask], total: int, workforce: Workforce) -> None:
    done = total - len(missing)
    if done:
        print(f"{done} of {total} cells are done already", file=sys.stderr)
    try:
        with _progress(done, total) as tell:
            for result in fill_store(store, missing, workforce):
                done += 1
                tell(done, result)
    except KeyboardInterrupt:
        print(
            f"etd_ros: interrupted: {done} of {total} cells are done and kept in {store.path}, "
            "run the same command again to go on",
            file=sys.stderr,
        )
        raise


@contextmanager
def _progress(done: int, total: int) -> Iterator[Callable[[int, CellResult], None]]:
    """A progress bar where somebody watches, a line for each cell where a log does."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console, disable=not console.is_terminal) as progress:
        bar = progress.add_task("evaluating", total=total, completed=done)

        def tell(number: int, result: CellResult) -> None:
            progress.update(bar, completed=number, description=f"{result.cell.system} {result.cell.sequence}")
            if not console.is_terminal:
                print(f"{number}/{total} {_in_words(result)}", file=sys.stderr, flush=True)

        yield tell


def _in_words(result: CellResult) -> str:
    cell = result.cell
    figures = f"AP {result.ap:.3f}, AR {result.ar:.3f}" if result.error is None else result.error
    return f"{cell.dataset}/{cell.sequence}/{cell.target} {cell.system} {cell.protocol} {cell.repetition}: {figures}"


def _print_errors(results: Iterable[CellResult]) -> None:
    """Say which cells brought no result, with the same error in one line."""
    errors: dict[tuple[str, str], int] = Counter(
        (result.cell.system, result.error) for result in results if result.error is not None
    )
    for (system, error), count in list(errors.items())[:ERRORS_SHOWN]:
        print(f"{system}: no result for {count} cell{'s' if count > 1 else ''}: {error}")
    if len(errors) > ERRORS_SHOWN:
        print(f"and {len(errors) - ERRORS_SHOWN} other errors")
    if errors:
        print("these are done again with --retry-errors")
