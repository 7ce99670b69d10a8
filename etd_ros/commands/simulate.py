"""`simulate SCENE`: a simulated scene as a ROS 2 bag with the exact boxes of its targets."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console
from rich.progress import Progress

from etd_ros.evaluation import TimedBox, write_boxes
from etd_ros.events import Events, concatenate
from etd_ros.recordings.bag_writer import EVENT_PACKET_DEFINITION, EVENT_PACKET_TYPE, BagWriter
from etd_ros.simulation import Scene, SensorConfig, SimulationError, demo_scene, simulate
from msg_adapters import encode_event_packet

SCENES: dict[str, Callable[[int], Scene]] = {"demo": demo_scene}
TOPIC = "/event_camera/events"
FRAME_ID = "event_camera"
TRUTH_NAME = "boxes.csv"
START_NS = 1_700_000_000_000_000_000
PACKET_S = 0.01
LABEL_S = 0.01
FIRST_LABEL_S = 0.1
"""Targets start a little after the events do, as on a robot: there is something to see by then."""
NS_PER_S = 1_000_000_000


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("simulate", help="make a simulated recording with its truth", description=__doc__)
    parser.add_argument("scene", choices=sorted(SCENES), help="what to simulate")
    parser.add_argument("--output", type=Path, required=True, help="folder of the bag; boxes.csv goes beside its data")
    parser.add_argument("--seed", type=int, default=7, help="same seed, same events (default: %(default)s)")
    parser.add_argument("--force", action="store_true", help="replace the output folder")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Simulate, write the bag and the boxes.

    Raises:
        SimulationError: the output exists and is not to be replaced or cannot be written, or the seed is negative.
    """
    if options.seed < 0:
        msg = f"--seed {options.seed} is negative: give 0 or more"
        raise SimulationError(msg)
    is_simulated = all((options.output / name).is_file() for name in ("metadata.yaml", TRUTH_NAME))
    if options.output.exists() and not (options.force and is_simulated):
        msg = f"{options.output} exists: name a new folder, or replace a simulated bag with --force"
        raise SimulationError(msg)
    scene = SCENES[options.scene](options.seed)
    with _written_beside(options.output) as folder:
        _write_bag(folder, scene, options.seed)
        write_boxes(folder / TRUTH_NAME, truth(scene))
    return 0


@contextmanager
def _written_beside(output: Path) -> Iterator[Path]:
    """A folder to write that takes its place, and that of an older one, only when the block succeeds.

    Raises:
        SimulationError: the parent folder cannot be written.
    """
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
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


def _write_bag(folder: Path, scene: Scene, seed: int) -> None:
    console = Console(stderr=True)
    with (
        BagWriter(folder, {EVENT_PACKET_TYPE: EVENT_PACKET_DEFINITION}, compressed=True) as bag,
        Progress(console=console, transient=True, disable=not console.is_terminal) as progress,
    ):
        task = progress.add_task("simulating", total=scene.duration_s)
        bag.add_topic(TOPIC, EVENT_PACKET_TYPE, reliable=False)
        for seq, packet in enumerate(packets(simulate(scene, seed=seed, start_ns=START_NS))):
            end_ns = int(packet.t[-1])
            message = encode_event_packet(packet, stamp_ns=end_ns, frame_id=FRAME_ID, seq=seq)
            bag.write(TOPIC, end_ns, message)
            progress.update(task, completed=(end_ns - START_NS) / NS_PER_S)


def packets(batches: Iterator[Events]) -> Iterator[Events]:
    """The same events in packets of 10 ms, as a driver that sends a hundred messages a second."""
    steps = round(PACKET_S / SensorConfig().step_s)
    pending: list[Events] = []
    for batch in batches:
        pending.append(batch)
        if len(pending) == steps:
            yield concatenate(pending)
            pending.clear()
    if pending:
        yield concatenate(pending)


def truth(scene: Scene) -> dict[str, list[TimedBox]]:
    """Exact boxes at 100 Hz of every target of which at least half can be seen."""
    boxes: dict[str, list[TimedBox]] = {}
    for step in range(round(FIRST_LABEL_S / LABEL_S), round(scene.duration_s / LABEL_S)):
        time_s = step * LABEL_S
        for name, box in scene.boxes(time_s).items():
            boxes.setdefault(name, []).append(TimedBox(START_NS + round(time_s * NS_PER_S), box))
    return boxes
