"""The event path: which streams each of its parts is measured on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from etd_ros.benchmarking import frames
from etd_ros.benchmarking.decoding import decoding, recorded_wire, synthetic_wire
from etd_ros.benchmarking.report import Row
from etd_ros.benchmarking.streams import RECORDINGS, Stream, recorded, synthetic

MEV = 1_000_000
DAVIS, HD = (240, 180), (1280, 720)
RATES = ((DAVIS, 10 * MEV), (HD, 50 * MEV))
OTHER_RATES = ((DAVIS, MEV // 10), (DAVIS, 1 * MEV), (HD, 100 * MEV))
"""Events per second of the synthetic streams, by sensor size (pixels)."""

SPARSE_RATES = ((DAVIS, MEV // 100),)
"""The same where a message holds so few events that conversion is all calls."""

KINDS = ("contours", "texture", "uniform", "noisy contours")
ALL_PEERS_ON = ("contours", "slider_depth")
"""Kinds of streams on which every peer of the conversion is measured; on the others those that are to be beaten."""

FRAME_PARTS: dict[Callable[[Stream, int], Iterator[Row]], tuple[str, ...]] = {
    frames.bare_maps: KINDS,
    frames.readout: ("contours", "texture", "uniform"),
    frames.full_readout: ("flicker",),
    frames.high_pass: ("contours", "texture", "uniform"),
    frames.noise_filter: ("contours", "noisy contours", "uniform"),
}
"""Kinds of streams that each part beside the conversion is measured on."""

ENCODINGS = ("evt3", "libcaer_cmp", "libcaer", "mono", "event_array_ros2", "event_array_ros1")
WIRE_KINDS = ("contours", "flicker")
RECORDED_WIRES = {"evt3": "driver evt3", "libcaer_cmp": "driver libcaer_cmp", "event_array_ros1": "slider_depth"}


@dataclass(frozen=True)
class Effort:
    """How long to measure.

    Attributes:
        events: events in a stream of 240x180 pixels, or of a recording.
        events_hd: events in a stream of 1280x720 pixels.
        rounds: pairs of runs per figure.
    """

    events: int
    events_hd: int
    rounds: int


FULL = Effort(2_000_000, 4_000_000, 7)
QUICK = Effort(50_000, 100_000, 1)


def event_path(effort: Effort, data: Path | None) -> Iterator[Row]:
    """All rows, one by one as they are measured.

    Args:
        effort: how long to measure.
        data: folder of real recordings; None to leave them out.

    Raises:
        RecordingError: a recording is damaged.
        BenchmarkError: a recording holds no events.
    """
    recordings = list(_recordings(effort, data)) if data is not None else []
    for stream in chain(_streams(effort, KINDS), recordings):
        yield from frames.conversion(stream, effort.rounds, all_peers=stream.kind in ALL_PEERS_ON)
    for stream in _streams(effort, ("contours",), SPARSE_RATES + OTHER_RATES):
        yield from frames.conversion(stream, effort.rounds, all_peers=False)
    for stream in recordings:
        yield from frames.fine_conversion(stream, effort.rounds)
    for part, kinds in FRAME_PARTS.items():
        for stream in _streams(effort, kinds):
            yield from part(stream, effort.rounds)
    for what in ENCODINGS:
        others = _streams(effort, ("contours",), OTHER_RATES) if what == "evt3" else ()
        for stream in chain(_streams(effort, WIRE_KINDS), others):
            yield from decoding(synthetic_wire(what, stream), effort.rounds)
        if data is not None and what in RECORDED_WIRES:
            wire = recorded_wire(what, RECORDED_WIRES[what], data, effort.events)
            yield from decoding(wire, effort.rounds) if wire is not None else ()


def _streams(
    effort: Effort, kinds: Sequence[str], rates: Sequence[tuple[tuple[int, int], int]] = RATES
) -> Iterator[Stream]:
    for (width, height), rate in rates:
        count = effort.events_hd if (width, height) == HD else effort.events
        for kind in kinds:
            yield synthetic(kind, width, height, count, rate)


def _recordings(effort: Effort, data: Path) -> Iterator[Stream]:
    for name in RECORDINGS:
        stream = recorded(name, data, effort.events)
        if stream is not None:
            yield stream
