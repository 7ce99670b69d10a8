"""The demo: replay, accumulator, reconstruction and tracker as processes over DDS, watched, recorded and scored."""

from __future__ import annotations

import os
import secrets
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rich.console import Console
from rich.live import Live
from rich.table import Table

from etd_ros.errors import EtdError
from etd_ros.evaluation import Score, TracksWriter, mean_score, read_boxes, read_tracks, score
from etd_ros.nodes.interface_definitions import interface_definitions
from etd_ros.nodes.monitor import EVENTS, Monitor
from etd_ros.nodes.programs import LEAVE, handled, postponed
from etd_ros.nodes.recorded_tracks import FRAMES, recorded_tracks
from etd_ros.output_files import make_folder
from etd_ros.recordings import open_recording
from etd_ros.recordings.bag_writer import BagWriter
from etd_ros.tracking_video import tracking_video

READY_TIMEOUT_S = 60.0
IDLE_END_S = 3.0
STOP_TIMEOUT_S = 10.0
DOMAIN_ID_MAX = 100
SHARED_MEMORY_PROFILE = Path(__file__).resolve().parents[2] / "config" / "fastdds_shm.xml"
RECORDED_PACKAGES = ("event_camera_msgs", "vision_msgs")
RESULTS = ("bag", "logs", "tracks.csv", "overlay.mp4")
TERMINAL = (signal.SIGHUP, signal.SIGQUIT)
HEARD = (*LEAVE, *TERMINAL)
"""What tells the demo to leave: its nodes have sessions of their own, and hear nothing of the terminal."""
PATIENCE = {"queue_mib": 1024.0, "queue_s": 60.0}
TRACKER_PATIENCE = {**PATIENCE, "image_wait_s": 30.0}
"""Parameters of the nodes: on a busy machine boxes may be late, but the score is to show the method only."""


class DemoError(EtdError):
    """The demo cannot run here."""


class Processes:
    """Child processes with their output in log files; all are gone when the context ends.

    They leave one after another. As pip has it, Fast DDS never ends a participant that takes note, at that very moment,
    of an endpoint that goes elsewhere (https://github.com/eProsima/Fast-DDS/issues/6513).
    """

    def __init__(self, log_folder: Path) -> None:
        self._log_folder = log_folder
        self._children: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self, name: str, arguments: list[str]) -> None:
        """Start `python -m etd_ros.nodes NAME`."""
        # An interrupt before the child is noted would leave it to nobody.
        with (self._log_folder / f"{name}.log").open("wb") as log, postponed(HEARD):
            self._children[name] = subprocess.Popen(
                [sys.executable, "-m", "etd_ros.nodes", name, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                # A terminal's Ctrl-C would have all of them leave at once.
                start_new_session=True,
            )

    def running(self, name: str) -> bool:
        """Whether the child was still there when `check` last looked."""
        return self._children[name].returncode is None

    def check(self) -> None:
        """See which children are still there, and complain about one that failed.

        Raises:
            DemoError: with the end of its log.
        """
        # An interrupt within `poll` may leave it holding a lock, and `stop` would then wait for the child for ever.
        with postponed(HEARD):
            for child in self._children.values():
                child.poll()
        for name, child in self._children.items():
            if child.returncode:
                log = (self._log_folder / f"{name}.log").read_text(errors="replace").strip().splitlines()
                msg = f"the {name} process ended with exit code {child.returncode}: {log[-1] if log else 'no output'}"
                raise DemoError(msg)

    def stop(self) -> None:
        """Interrupt each child, the last one first, wait, and kill it where it does not leave in STOP_TIMEOUT_S."""
        # A second Ctrl-C must not keep the first from ending every child.
        with handled(HEARD, signal.SIG_IGN):
            for child in reversed(self._children.values()):
                if child.poll() is None:
                    child.send_signal(signal.SIGINT)
                try:
                    child.wait(STOP_TIMEOUT_S)
                except subprocess.TimeoutExpired:
                    child.kill()
                    child.wait()


def run(recording: Path, truth: Path, output: Path, rate: float) -> int:
    """Run the demo and leave tracks.csv, overlay.mp4, a bag and logs in `output`.

    Raises:
        EtdError: something is missing, or a process failed.
    """
    boxes = read_boxes(truth)
    if output.resolve() in recording.resolve().parents:
        msg = f"{output}: holds the recording {recording}, and results would replace it: choose another --output"
        raise DemoError(msg)
    with open_recording(recording):
        output = _fresh_folder(output)
    _play_and_record(recording, truth, output, rate)
    _write_results(output)
    _say_results(output, score(read_tracks(output / "tracks.csv"), boxes))
    return 0


def _play_and_record(recording: Path, truth: Path, output: Path, rate: float) -> None:
    """Run the processes from the first node's start to the last box, recording everything."""
    _use_own_domain()
    with ExitStack() as stack:
        # Both, for a shell that starts a command in the background has it ignore Ctrl-C.
        for number in LEAVE:
            signal.signal(number, _interrupt)
        for number in TERMINAL:
            # `nohup` has one of them ignored.
            if signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, _interrupt)
        recorder = stack.enter_context(BagWriter(output / "bag", interface_definitions(RECORDED_PACKAGES)))
        monitor, spin_once = stack.enter_context(_monitor(recorder))
        # Leaves before the monitor, which has nothing to take note of then.
        processes = stack.enter_context(Processes(output / "logs"))
        _start_nodes(processes, truth)
        stack.enter_context(Live(get_renderable=lambda: _table(monitor), console=Console(), refresh_per_second=4))
        _wait(processes, spin_once, lambda: _ready(monitor), "the three nodes to find each other")
        processes.start("replay", [str(recording), "--rate", str(rate), "--clock", "--wait-for", "3"])
        while processes.running("replay") or not _finished(monitor):
            spin_once()
            processes.check()


def _write_results(output: Path) -> None:
    """Tracks and video from the bag: drawing while the nodes run would take their time, and lose messages."""
    with TracksWriter(output / "tracks.csv") as tracks, tracking_video(output / "overlay.mp4") as video:
        for tracked in recorded_tracks(output / "bag"):
            tracks.write_reports(tracked.stamp_ns, tracked.reports)
            if tracked.frame is not None:
                video.add(tracked.stamp_ns, tracked.frame, tracked.reports, tracked.image)


def _start_nodes(processes: Processes, truth: Path) -> None:
    remap = ["-r", f"~/events:={EVENTS}"]
    processes.start("accumulator", ["--ros-args", *remap, *_set(PATIENCE)])
    processes.start("reconstruction", ["--ros-args", *remap, *_set(PATIENCE)])
    processes.start("tracker", ["--ros-args", *_set({"targets_file": truth.resolve(), **TRACKER_PATIENCE})])


def _set(parameters: Mapping[str, object]) -> list[str]:
    """Arguments that set a node's parameters; all follow the recording's clock."""
    assignments = [f"{name}:={value}" for name, value in {"use_sim_time": "true", **parameters}.items()]
    return [word for assignment in assignments for word in ("-p", assignment)]


def _ready(monitor: Monitor) -> bool:
    """Each link is up as seen from its publisher: frames to reconstruction, tracker and monitor, images to two."""
    return (
        monitor.figure("accumulator", "frame subscribers") == "3"
        and monitor.figure("reconstruction", "image subscribers") == "2"
        and monitor.figure("accumulator", "reading events") != ""
        and monitor.figure("tracker", "targets") not in ("", "0")
    )


def _finished(monitor: Monitor) -> bool:
    return time.monotonic() - monitor.figures.last_data_s > IDLE_END_S


def _wait(
    processes: Processes,
    spin_once: Callable[[], None],
    condition: Callable[[], bool],
    what: str,
) -> None:
    deadline_s = time.monotonic() + READY_TIMEOUT_S
    while not condition():
        if time.monotonic() > deadline_s:
            msg = f"waited {READY_TIMEOUT_S:.0f} s in vain for {what}: see the logs in the output folder"
            raise DemoError(msg)
        spin_once()
        processes.check()


@contextmanager
def _monitor(recorder: BagWriter) -> Iterator[tuple[Monitor, Callable[[], None]]]:
    """The node that listens to all others, and what gives it a turn.

    Within rclpy an interrupt may be swallowed, or leave it holding what it can never let go, so it is told of none.
    """

    def spin_once() -> None:
        with postponed(HEARD):
            executor.spin_once(timeout_sec=0.1)

    stack = ExitStack()
    try:
        with postponed(HEARD):
            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
            stack.callback(rclpy.try_shutdown)
            monitor = Monitor(recorder)
            stack.callback(monitor.destroy_node)
            executor = SingleThreadedExecutor()
            stack.callback(executor.shutdown)
            executor.add_node(monitor)
        yield monitor, spin_once
    finally:
        with handled(HEARD, signal.SIG_IGN):
            stack.close()


def _use_own_domain() -> None:
    """Keep the demo's traffic on this machine and apart from other ROS processes."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ.pop("ROS_DISCOVERY_SERVER", None)
    os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(SHARED_MEMORY_PROFILE))
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + secrets.randbelow(DOMAIN_ID_MAX)))


def _interrupt(_signal: int, _frame: object) -> None:
    raise KeyboardInterrupt


def _fresh_folder(output: Path) -> Path:
    """The output folder with nothing of an earlier demo in it.

    Raises:
        OutputError: it cannot be made.
        DemoError: it cannot be written, or holds what no demo has made.
    """
    make_folder(output)
    try:
        strangers = sorted(item.name for item in output.iterdir() if item.name not in RESULTS)
        if strangers:
            msg = f"{output}: holds {strangers[0]}, which no demo has made: choose another --output"
            raise DemoError(msg)
        for folder in ("bag", "logs"):
            shutil.rmtree(output / folder, ignore_errors=True)
        for file in ("tracks.csv", "overlay.mp4"):
            (output / file).unlink(missing_ok=True)
        (output / "logs").mkdir()
    except OSError as err:
        msg = f"{output}: cannot be written ({err.strerror}): choose another --output"
        raise DemoError(msg) from err
    return output


def _table(monitor: Monitor) -> Table:
    figures = monitor.figures
    table = Table(title="etd_ros demo", title_justify="left")
    for column in ("what", "value"):
        table.add_column(column)
    table.add_row("events", f"{monitor.figure('accumulator', 'events') or 0}")
    table.add_row("events/s", f"{figures.rates.get('events', 0):,.0f}")
    table.add_row("frames", f"{figures.messages[FRAMES]}")
    table.add_row("frames/s", f"{figures.rates.get(FRAMES, 0):.0f}")
    for name, state in sorted(figures.states.items()):
        style = {"tracking": "green", "recovering": "yellow", "lost": "red"}.get(state, "")
        table.add_row(f"target {name}", f"[{style}]{state}[/{style}]" if style else state)
    return table


def _say_results(output: Path, scores: dict[str, Score]) -> None:
    table = Table(title="against the truth", title_justify="left")
    for column in ("target", "AP", "AR", "labels"):
        table.add_column(column)
    for name, value in {**scores, "mean": mean_score(scores)}.items():
        table.add_row(name, f"{value.ap:.3f}", f"{value.ar:.3f}", str(value.n))
    console = Console()
    console.print()
    console.print(table)
    for name, what in (("tracks.csv", "boxes"), ("overlay.mp4", "video"), ("bag", "everything published, mcap")):
        console.print(f"{output / name}  ({what})")
