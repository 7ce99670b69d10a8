"""`simulate NAME`: a simulated sequence as a ROS 2 bag with the exact boxes of its targets."""

from __future__ import annotations

import argparse
import csv
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console
from rich.progress import Progress

from etd_ros.evaluation import TimedBox, write_boxes
from etd_ros.events import Events, concatenate
from etd_ros.output_files import make_folder
from etd_ros.recordings.bag_writer import EVENT_PACKET_DEFINITION, EVENT_PACKET_TYPE, BagWriter
from etd_ros.simulation import (
    SUITE,
    Scene,
    SensorConfig,
    Sequence,
    SimulationError,
    absent_times,
    demo_scene,
    random_seed_of,
    random_sequences,
    simulate,
    true_boxes,
)
from msg_adapters import encode_event_packet

SCENES: dict[str, Callable[[int], Scene]] = {"demo": demo_scene}
SCENE_SEED = 7
WHOLE_SUITE = "suite"
RANDOM = "random-SEED"
TOPIC = "/event_camera/events"
FRAME_ID = "event_camera"
TRUTH_NAME = "boxes.csv"
ABSENT_NAME = "absent.csv"
ABSENT_COLUMNS = ("target", "start_ns", "end_ns", "reason")
START_NS = 1_700_000_000_000_000_000
PACKET_NS = 10_000_000
LABEL_S = 0.01
FIRST_LABEL_S = 0.1
"""Targets start a little after the events do, as on a robot: there is something to see by then."""
NS_PER_S = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Job:
    """What is simulated: a scene, the seed of its events, and what sees it."""

    scene: Scene
    seed: int
    sensor: SensorConfig


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("simulate", help="make a simulated recording with its truth", description=__doc__)
    names = parser.add_mutually_exclusive_group(required=True)
    names.add_argument(
        "scene",
        nargs="?",
        type=_scene_name,
        metavar="NAME",
        help=f"what to simulate (see --list); {WHOLE_SUITE}: all sequences of the suite, a folder each; {RANDOM}, as "
        "in random-7: what `evaluate --random 1 --seed 7` shows",
    )
    names.add_argument("--list", action="store_true", help="print the names with what they test")
    parser.add_argument("--output", type=Path, help="folder of the bag; boxes.csv and absent.csv go beside its data")
    parser.add_argument(
        "--seed", type=int, help=f"same seed, same events (default: a sequence's own; {SCENE_SEED} for demo)"
    )
    parser.add_argument("--force", action="store_true", help="replace the output folder")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Simulate, write the bag, the boxes and the absences; or list what there is.

    Raises:
        SimulationError: no output is named, it exists and is not to be replaced or cannot be written, the seed is
            negative, or the whole suite or a random sequence is asked for with a seed.
        OutputError: the folder that the output lies in cannot be made.
    """
    if options.list:
        for name, description in _descriptions():
            print(f"{name:14}  {description}")
        return 0
    _check(options)
    if options.scene != WHOLE_SUITE:
        _simulate(options.scene, options.seed, options.output, force=options.force)
        return 0
    for name in SUITE:
        _check_output(options.output / name, force=options.force)
    for name in SUITE:
        _simulate(name, None, options.output / name, force=options.force)
    return 0


def _descriptions() -> Iterator[tuple[str, str]]:
    yield "demo", "two things on circles, and one that passes behind a pillar (240x180, 5 s)"
    for sequence in SUITE.values():
        size = f"{sequence.width}x{sequence.height}, {sequence.recipe.duration_s:g} s"
        yield sequence.name, f"{sequence.description} ({size})"
    yield RANDOM, "a random sequence of the same families, as `evaluate --random` shows it (240x180 or 346x260, 1.5 s)"


def _scene_name(text: str) -> str:
    if text in (*SCENES, *SUITE, WHOLE_SUITE) or random_seed_of(text) is not None:
        return text
    msg = f"no sequence {text!r}: choose one of {', '.join(map(repr, (*SCENES, *SUITE, WHOLE_SUITE, RANDOM)))}"
    raise argparse.ArgumentTypeError(msg)


def _check(options: argparse.Namespace) -> None:
    if options.output is None:
        msg = f"no --output for {options.scene}: name the folder to write"
        raise SimulationError(msg)
    if options.seed is not None and options.seed < 0:
        msg = f"--seed {options.seed} is negative: give 0 or more"
        raise SimulationError(msg)
    if options.seed is not None and options.scene == WHOLE_SUITE:
        msg = f"--seed {options.seed} with the whole suite, whose seeds are fixed: leave it out, or name a sequence"
        raise SimulationError(msg)
    if options.seed is not None and random_seed_of(options.scene) is not None:
        msg = f"--seed {options.seed} with {options.scene}, whose name holds its seed: leave it out"
        raise SimulationError(msg)


def _check_output(output: Path, *, force: bool) -> None:
    is_simulated = all((output / name).is_file() for name in ("metadata.yaml", TRUTH_NAME))
    if output.exists() and not (force and is_simulated):
        msg = f"{output} exists: name a new folder, or replace a simulated bag with --force"
        raise SimulationError(msg)


def _simulate(name: str, seed: int | None, output: Path, *, force: bool) -> None:
    _check_output(output, force=force)
    job = _job(name, seed)
    with _written_beside(output) as folder:
        _write_bag(folder, job, name)
        write_boxes(folder / TRUTH_NAME, truth(job.scene))
        _write_absences(folder / ABSENT_NAME, job.scene)


def _job(name: str, seed: int | None) -> Job:
    if name in SCENES:
        seed = SCENE_SEED if seed is None else seed
        return Job(SCENES[name](seed), seed, SensorConfig())
    sequence = _sequence(name, seed)
    return Job(sequence.scene(), sequence.seed, sequence.recipe.sensor)


def _sequence(name: str, seed: int | None) -> Sequence:
    random_seed = random_seed_of(name)
    if random_seed is not None:
        return random_sequences([random_seed])[0]
    return SUITE[name] if seed is None else SUITE[name].with_seed(seed)


@contextmanager
def _written_beside(output: Path) -> Iterator[Path]:
    """A folder to write that takes its place, and that of an older one, only when the block succeeds.

    Raises:
        OutputError: the parent folder cannot be made.
        SimulationError: it cannot be written.
    """
    make_folder(output.parent, output)
    try:
        # The files of a bag are named after its folder, so it gets its own name in a temporary place from the start.
        with TemporaryDirectory(prefix=f".{output.name}.", dir=output.parent) as place:
            folder = Path(place) / output.name
            yield folder
            if output.exists():
                shutil.rmtree(output)
            folder.rename(output)
    except OSError as err:
        msg = f"{output}: cannot be written ({err.strerror or err}): name a new folder in one you may write"
        raise SimulationError(msg) from err


def _write_bag(folder: Path, job: Job, name: str) -> None:
    console = Console(stderr=True)
    with (
        BagWriter(folder, {EVENT_PACKET_TYPE: EVENT_PACKET_DEFINITION}, compressed=True) as bag,
        Progress(console=console, transient=True, disable=not console.is_terminal) as progress,
    ):
        task = progress.add_task(f"simulating {name}", total=job.scene.duration_s)
        bag.add_topic(TOPIC, EVENT_PACKET_TYPE, reliable=False)
        batches = simulate(job.scene, seed=job.seed, start_ns=START_NS, config=job.sensor)
        for seq, packet in enumerate(packets(batches)):
            end_ns = int(packet.t[-1])
            message = encode_event_packet(packet, stamp_ns=end_ns, frame_id=FRAME_ID, seq=seq)
            bag.write(TOPIC, end_ns, message)
            progress.update(task, completed=(end_ns - START_NS) / NS_PER_S)


def packets(batches: Iterable[Events]) -> Iterator[Events]:
    """The same events in packets of 10 ms of the clock, as a driver that sends a hundred messages a second."""
    pending: list[Events] = []
    for batch in batches:
        rest = batch
        while len(rest):
            if pending and int(pending[0].t[0]) // PACKET_NS != int(rest.t[0]) // PACKET_NS:
                yield concatenate(pending)
                pending.clear()
            packet_end_ns = (int(rest.t[0]) // PACKET_NS + 1) * PACKET_NS
            part = rest.between(int(rest.t[0]), packet_end_ns)
            pending.append(part)
            rest = rest[len(part) :]
    if pending:
        yield concatenate(pending)


def truth(scene: Scene) -> dict[str, list[TimedBox]]:
    """Exact boxes at 100 Hz of every target of which at least half can be seen."""
    steps = range(round(FIRST_LABEL_S / LABEL_S), round(scene.duration_s / LABEL_S))
    times_s = [step * LABEL_S for step in steps]
    return {
        name: [TimedBox(START_NS + round(time_s * NS_PER_S), box) for time_s, box in rows]
        for name in scene.targets
        if (rows := list(true_boxes(scene, name, times_s)))
    }


def _write_absences(path: Path, scene: Scene) -> None:
    """When targets are occluded (less than a quarter can be seen) or have left (nothing is on the sensor)."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(ABSENT_COLUMNS)
        for name in scene.targets:
            for absence in absent_times(scene, name):
                start_ns, end_ns = (START_NS + round(time_s * NS_PER_S) for time_s in (absence.start_s, absence.end_s))
                writer.writerow((name, start_ns, end_ns, absence.reason.value))
