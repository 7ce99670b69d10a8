"""`train`: the weights of the networks that ship, from simulated sequences alone: of the compact one that finds lost
targets, of the one that puts boxes right, of the small SiamFC."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as ProgressBar

from etd_ros.output_files import make_folder
from etd_ros.parameters import described
from etd_ros.recovery import RecoveryError
from etd_ros.recovery.making import missing_libraries
from etd_ros.recovery.training.config import TrainingConfig
from etd_ros.recovery.training.errors import TrainingError

DEVICES = ("cpu", "cuda")
NETWORKS = ("compact", "box", "siamfc")


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "train", help="train the networks that find lost targets and put boxes right, or SiamFC", description=__doc__
    )
    parser.add_argument(
        "--output", type=Path, required=True, help="folder of weights, checkpoint and log (compact.safetensors, ...)"
    )
    parser.add_argument(
        "--network", choices=NETWORKS, default=NETWORKS[0],
        help="compact: finds lost targets on reconstructed images; box: puts boxes of what is followed right; siamfc: "
        "follows targets on video frames "
        "(default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--cache", type=Path, required=True, help="folder of the simulated sequences; kept for later")
    start = parser.add_mutually_exclusive_group()
    start.add_argument("--weights", type=Path, help="train these further, instead of random ones")
    start.add_argument("--resume", action="store_true", help="go on from the checkpoint in the output folder")
    parser.add_argument("--device", choices=DEVICES, default="cpu", help="where to train (default: %(default)s)")
    parser.add_argument("--threads", type=int, default=1, help="of the training on a CPU (default: %(default)s)")
    parser.add_argument(
        "--processes", type=int, default=1,
        help="that simulate sequences beside the training; from 2 on as many others cut pairs for it, which a GPU "
        "waits for otherwise (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--minutes", type=float, default=math.inf, help="end after this time, should the steps take longer"
    )
    for name, default, description in described(TrainingConfig):
        option = f"--{name.replace('_', '-')}"
        parser.add_argument(
            option, type=type(default), default=default, help=f"{description.text} (default: %(default)s)"
        )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Train, or go on training.

    Raises:
        RecoveryError: torch or safetensors are missing.
        RecoveryError, TrackingError: `--weights` cannot be read.
        OutputError: a folder cannot be made.
        TrainingError: there is no such device, settings do not fit together, the output holds a training and is not to
            be resumed, files cannot be read or written, or the training fails.
        ParameterError: a setting is out of its range.
        SimulationError: scikit-image, whose photographs are used, is not installed.
    """
    if missing := missing_libraries():
        msg = f"train needs {' and '.join(missing)}: pip install {' '.join(missing)}"
        raise RecoveryError(msg)
    # torch takes seconds to import, which no other command should wait for.
    from etd_ros.recovery.training.box_lesson import BoxLesson
    from etd_ros.recovery.training.box_samples import SampleCache
    from etd_ros.recovery.training.compact_lesson import CompactLesson
    from etd_ros.recovery.training.loop import Progress, Training, prepare
    from etd_ros.recovery.training.sequences import RECONSTRUCTED, SequenceCache
    from etd_ros.recovery.training.siamfc_lesson import SiamFcLesson
    from etd_ros.recovery.training.video import VIDEO

    config = TrainingConfig(**{name: getattr(options, name) for name, _, _ in described(TrainingConfig)})
    if config.settled == 1 and options.weights is None and not options.resume:
        msg = "--settled 1 keeps the normalisations' statistics, which random weights have not: give --weights, or less"
        raise TrainingError(msg)
    prepare(options.device, options.threads, options.minutes, options.processes)
    place = {"device": options.device, "minutes": options.minutes, "processes": options.processes}
    training: Training[Any, Any]
    if options.network == "box":
        training = Training(config, SampleCache(options.cache), options.output, make_lesson=BoxLesson, **place)
    elif options.network == "siamfc":
        cache = SequenceCache(options.cache, VIDEO)
        training = Training(config, cache, options.output, make_lesson=SiamFcLesson, **place)
    else:
        cache = SequenceCache(options.cache, RECONSTRUCTED)
        training = Training(config, cache, options.output, make_lesson=CompactLesson, **place)
    if not options.resume:
        training.check_is_new()
    if options.weights is not None:
        training.start_from(options.weights)
    if options.resume:
        training.resume()
    # Not before: what is refused leaves no folders behind. Not after: other processes would tell it in a traceback.
    make_folder(options.cache)
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with ProgressBar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("simulating the first sequences", total=1.0)

        def show(progress: Progress) -> None:
            text = f"step {progress.step}, loss {progress.loss:.3f}"
            bar.update(task, description=text, completed=progress.share)
            if progress.figures is not None:
                console.print(f"{text}; validation: {progress.figures.told()}")

        training.run(show)
    return 0
