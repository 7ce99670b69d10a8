"""`info RECORDING`: what a recording holds."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress

from etd_ros.commands.recording_options import add_recording_options
from etd_ros.recordings import Recording, open_recording
from msg_adapters import EventMessage

NS_PER_S = 1_000_000_000
UINT64_MASK = (1 << 64) - 1


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("info", help="what a recording holds", description=__doc__)
    add_recording_options(parser)
    parser.add_argument("--checksums", action="store_true", help="also sums of times, coordinates and On events")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of lines")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Read the recording through and print what it holds.

    Raises:
        RecordingError: the recording cannot be read to its end.
    """
    with open_recording(options.recording, topic=options.topic, size=options.size) as recording:
        summary = summarise(recording)
        report = _report(recording, summary, checksums=options.checksums)
    sys.stdout.write(json.dumps(report, indent=2) + "\n" if options.json else _lines(report))
    return 0


@dataclass(slots=True)
class Summary:
    """Sums over a recording's event messages, their times as the messages say.

    `sum_t_ns_mod_2_64` is the sum of the times (ns) modulo 2^64, as the publishers of the reference data compute it.
    """

    encoding: str = ""
    messages: int = 0
    events: int = 0
    sum_t_ns_mod_2_64: int = 0
    sum_x: int = 0
    sum_y: int = 0
    on_events: int = 0
    skipped_words: int = 0
    off_sensor: int = 0
    first_ns: int | None = None
    last_ns: int = 0

    @property
    def duration_s(self) -> float:
        """Time from the first to the last event (s); 0 where time went back."""
        return max(0, self.last_ns - self.first_ns) / NS_PER_S if self.first_ns is not None else 0.0

    def add(self, packet: EventMessage) -> None:
        """Count a message and its events."""
        events = packet.events
        self.encoding = self.encoding or packet.encoding
        self.messages += 1
        self.events += len(events)
        self.skipped_words += packet.skipped_words
        self.off_sensor += packet.off_sensor
        if not len(events):
            return
        self.first_ns = int(events.t[0]) if self.first_ns is None else self.first_ns
        self.last_ns = int(events.t[-1])
        self.sum_t_ns_mod_2_64 = (self.sum_t_ns_mod_2_64 + int(events.t.view(np.uint64).sum())) & UINT64_MASK
        self.sum_x += int(events.x.sum(dtype=np.uint64))
        self.sum_y += int(events.y.sum(dtype=np.uint64))
        self.on_events += int(np.count_nonzero(events.p))


def summarise(recording: Recording) -> Summary:
    """The sums of a whole recording, with a progress line on standard error.

    Raises:
        RecordingError: the recording cannot be read to its end.
    """
    summary = Summary()
    count = next((topic.count for topic in recording.topics if topic.name == recording.topic), None)
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        for packet in progress.track(recording.packets(), total=count, description=f"reading {recording.path.name}"):
            summary.add(packet)
    return summary


def _report(recording: Recording, summary: Summary, *, checksums: bool) -> dict[str, Any]:
    duration_s = summary.duration_s
    report: dict[str, Any] = {
        "recording": str(recording.path),
        "kind": recording.kind,
        "topics": [asdict(topic) for topic in recording.topics],
        "topic": recording.topic,
        "encoding": summary.encoding,
        "width": recording.width,
        "height": recording.height,
        "duration_s": duration_s,
        "messages": summary.messages,
        "events": summary.events,
        "rate_events_per_s": summary.events / duration_s if duration_s else None,
        "skipped_words": summary.skipped_words,
        "off_sensor": summary.off_sensor,
    }
    if checksums:
        report |= {name: getattr(summary, name) for name in ("sum_t_ns_mod_2_64", "sum_x", "sum_y", "on_events")}
    return report


def _lines(report: dict[str, Any]) -> str:
    rate = report["rate_events_per_s"]
    rows = {
        "recording": f"{report['recording']} ({report['kind']})",
        "sensor": f"{report['width']}x{report['height']}",
        "duration": f"{report['duration_s']:.6f} s",
        "rate": f"{rate:.0f} events/s" if rate else "unknown",
    }
    told = {"recording", "kind", "topics", "width", "height", "duration_s", "rate_events_per_s"}
    rows |= {name: str(value) for name, value in report.items() if name not in told and value != ""}
    lines = [f"{name + ':':<19}{value}" for name, value in rows.items()]
    for topic in report["topics"]:
        count = "" if topic["count"] is None else f", {topic['count']} messages"
        lines.append(f"{'holds:':<19}{topic['name']} ({topic['type_name']}{count})")
    return "\n".join(lines) + "\n"
