"""Measures every system on labelled recordings: the figures of docs/systems.md.

usage: python docs/systems_measures.py RECORDING BOXES.csv [RECORDING BOXES.csv ...]
"""

import sys
import time
from pathlib import Path

import cv2

from etd_ros.evaluation import TrackRow, read_boxes, score
from etd_ros.evaluation.truth import TimedBox
from etd_ros.recordings import open_recording
from etd_ros.recordings.loaded import LoadedRecording
from etd_ros.systems.event_clusters import EventClusterTracker
from etd_ros.systems.registry import SYSTEMS
from etd_ros.systems.running import run_system
from etd_ros.targets import TargetStart
from etd_ros.tracking import TargetState


def measure(system: str, recording: LoadedRecording, name: str, labels: list[TimedBox]) -> tuple[float, float, float]:
    """AP, AR, and processor time of a step since the target's start (ms), of one target alone."""
    rows: list[TrackRow] = []
    steps = 0
    begin = time.process_time()
    for step in run_system(system, recording, [TargetStart(name, labels[0].box, labels[0].stamp_ns)]):
        report = step.reports[0]
        rows.append(TrackRow(step.stamp_ns, name, report.box, report.score, report.state.value))
        steps += report.state is not TargetState.IDLE
    taken_s = time.process_time() - begin
    found = score({name: rows}, {name: labels})[name]
    return found.ap, found.ar, 1e3 * taken_s / steps


def e_ms_rate(recording: LoadedRecording, label: TimedBox) -> float:
    """Events that the E-MS tracker takes in a second of processor time, in millions."""
    tracker = EventClusterTracker()
    tracker.start(label.stamp_ns, label.box)
    batches = [batch.events for batch in recording.streams()]
    begin = time.process_time()
    for events in batches:
        list(tracker.update(events))
    return recording.events / (time.process_time() - begin) / 1e6


def main() -> None:
    """A row for each system, and the speed of E-MS on each recording."""
    cv2.setNumThreads(1)
    targets = []
    for path, boxes in zip(sys.argv[1::2], sys.argv[2::2], strict=True):
        with open_recording(path) as opened:
            loaded = LoadedRecording.load(opened)
        targets += [(loaded, name, labels) for name, labels in read_boxes(Path(boxes)).items()]
    sys.stdout.write(f"| system | {' | '.join(name for _, name, _ in targets)} | mean | ms |\n")
    for system in SYSTEMS:
        measure(system, *targets[-1])  # compiles and loads
        found = [measure(system, *target) for target in targets]
        cells = [f"{ap:.2f}/{ar:.2f}" for ap, ar, _ in found]
        ap, ar, ms = (sum(values) / len(values) for values in zip(*found, strict=True))
        sys.stdout.write(f"| `{system}` | {' | '.join(cells)} | {ap:.3f}/{ar:.3f} | {ms:.1f} |\n")
        sys.stdout.flush()
    for recording, label in {
        id(recording): (recording, labels[0]) for recording, _, labels in reversed(targets)
    }.values():
        size = f"{recording.width}x{recording.height}"
        sys.stdout.write(f"E-MS at {size}: {e_ms_rate(recording, label):.2f} Mev/s\n")


if __name__ == "__main__":
    main()
