"""`evaluate`: systems on datasets as in the paper's tables, or a method on simulated sequences."""

from __future__ import annotations

import argparse
from pathlib import Path

from etd_ros.commands.evaluate_datasets import run_datasets
from etd_ros.commands.evaluate_simulated import run_simulated
from etd_ros.commands.track import read_settings
from etd_ros.datasets import DATASETS
from etd_ros.evaluation import EvaluationError
from etd_ros.evaluation.cell_run import PROTOCOL_NAMES
from etd_ros.evaluation.known_figures import TOLERANCE
from etd_ros.evaluation.matrix import REPETITIONS
from etd_ros.systems.registry import SYSTEMS
from etd_ros.tracking import DEFAULT_METHOD, METHODS

JOBS_MAX = 64
FOR_DATASETS = (
    "systems",
    "protocol",
    "repetitions",
    "store",
    "output",
    "scheduler",
    "cell_timeout",
    "retry_errors",
    "box_columns",
)
FOR_SIMULATED = ("start", "method", "seed", "write", "against")


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "evaluate", help="compare systems on datasets, score methods on simulated sequences", description=__doc__
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--list", action="store_true", help="print the systems, one a line")
    what.add_argument(
        "--dataset",
        nargs=2,
        action="append",
        metavar=("NAME", "PATH"),
        help=f"labelled recordings in a folder; NAME is one of {', '.join(DATASETS)}; may be given several times",
    )
    what.add_argument("--suite", action="store_true", help="the fixed suite of simulated sequences")
    what.add_argument("--random", type=int, metavar="N", help="N random simulated sequences of the same families")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="these sequences only")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes (default: %(default)s)")
    parser.add_argument(
        "--config", type=Path, metavar="PARAMETERS.yaml", help="a ROS 2 parameter file, as for the nodes"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="one parameter, e.g. tracking.failure_iou=0.4"
    )
    _add_for_datasets(parser.add_argument_group("with --dataset"))
    _add_for_simulated(parser.add_argument_group("with --suite and --random"))
    parser.set_defaults(run=run)


def _add_for_datasets(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--systems", nargs="+", metavar="NAME", help="default: all, see --list")
    group.add_argument(
        "--protocol",
        choices=[*PROTOCOL_NAMES, "both"],
        help="one-pass: causal, no re-start (default); restarts: the paper's, started again after each failure",
    )
    group.add_argument(
        "--repetitions", type=int, metavar="N", help=f"of systems with randomness (default: {REPETITIONS}, the paper's)"
    )
    group.add_argument(
        "--store",
        type=Path,
        metavar="FILE.sqlite",
        help="keep results here; what it holds is not done again (default: evaluation.sqlite in --output, or here)",
    )
    group.add_argument("--output", type=Path, metavar="FOLDER", help="write tables, plots and an HTML report here")
    group.add_argument("--scheduler", metavar="ADDRESS", help="run on the Dask cluster of this scheduler")
    group.add_argument("--cell-timeout", type=float, metavar="S", help="stop what takes longer than this (s)")
    group.add_argument("--retry-errors", action="store_true", default=None, help="do again what brought an error")
    group.add_argument("--box-columns", metavar="COLUMNS", help="of eed's boundingbox.txt, see docs/datasets.md")


def _add_for_simulated(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--start",
        action="store_true",
        default=None,
        help="score what starts by itself and at clicks instead of what is tracked",
    )
    group.add_argument("--method", help=f"one of {', '.join(METHODS)} (default: {DEFAULT_METHOD})")
    group.add_argument(
        "--seed",
        type=int,
        help="of the first random sequence (default: 0), or of all of the suite instead of their own",
    )
    group.add_argument(
        "--write", type=Path, metavar="FILE.csv", help="also write a row for each target (--start: sequence)"
    )
    group.add_argument(
        "--against",
        type=Path,
        metavar="FILE.csv",
        help=f"say whose AP or AR differs by more than {TOLERANCE} from such a file; the exit code is 1 if one fell",
    )


def run(options: argparse.Namespace) -> int:
    """Run what is asked for.

    Raises:
        EtdError: an option that is out of range or belongs to another mode, or data that cannot be read.
    """
    if options.list:
        for name, system in SYSTEMS.items():
            print(f"{name:20}{system.description}")
        return 0
    if not 1 <= options.jobs <= JOBS_MAX:
        msg = f"--jobs {options.jobs} is out of range [1, {JOBS_MAX}]"
        raise EvaluationError(msg)
    _refuse(options, FOR_SIMULATED if options.dataset else FOR_DATASETS, bool(options.dataset))
    settings = read_settings(options.config, options.set)
    if options.dataset:
        return run_datasets(options, settings)
    return run_simulated(options, settings)


def _refuse(options: argparse.Namespace, names: tuple[str, ...], is_dataset: bool) -> None:
    """Raise EvaluationError where an option of the other mode is given: it would change nothing, silently."""
    for name in names:
        if getattr(options, name) is not None:
            mode, other = ("--dataset", "--suite or --random") if is_dataset else ("--suite and --random", "--dataset")
            msg = f"--{name.replace('_', '-')} means nothing with {mode}: leave it out, or give {other}"
            raise EvaluationError(msg)
