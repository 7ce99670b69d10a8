"""From events to frames, images and filtered events."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import accumulate

from etd_ros.benchmarking import peers, subjects
from etd_ros.benchmarking.comparing import MS, rows
from etd_ros.benchmarking.references import bare_map
from etd_ros.benchmarking.report import Row
from etd_ros.benchmarking.streams import Stream
from etd_ros.conversion import AtsltdConfig, AtsltdConverter

READOUT_ROUNDS_FACTOR = 20
"""A readout is so short that it needs more rounds."""


def conversion(stream: Stream, rounds: int, *, all_peers: bool) -> Iterator[Row]:
    """ATSLTD conversion against the peers, whose frames end where ours do, and against the bare map."""
    yield from _conversion("conversion", stream, AtsltdConfig(), rounds, all_peers=all_peers)


def fine_conversion(stream: Stream, rounds: int) -> Iterator[Row]:
    """The same to fine frames, which `etd-plus` takes."""
    yield from _conversion("conversion_fine", stream, AtsltdConfig().fine(), rounds, all_peers=False)


def _conversion(what: str, stream: Stream, config: AtsltdConfig, rounds: int, *, all_peers: bool) -> Iterator[Row]:
    messages = stream.messages()
    ends = _frame_ends(stream, config)
    ours, events = subjects.conversion(messages, config), max(ends, default=0)
    # Without peers their fields are empty in one row; our own reference has a row in any case.
    for others in (peers.converters(messages, ends, all_peers=all_peers), [bare_map(messages)]):
        yield from rows(what, stream, ours, others, rounds, frames=len(ends), events=events)


def bare_maps(stream: Stream, rounds: int) -> Iterator[Row]:
    """The bare last-event map itself."""
    yield from rows("bare_map", stream, bare_map(stream.messages()), [], rounds)


def readout(stream: Stream, rounds: int) -> Iterator[Row]:
    """The end of a frame that holds as many events as the stream's first ATSLTD frame."""
    yield from _readout("readout", stream, min(_frame_ends(stream, AtsltdConfig()), default=len(stream.events)), rounds)


def full_readout(stream: Stream, rounds: int) -> Iterator[Row]:
    """The end of a frame that holds as many events as the sensor has pixels."""
    yield from _readout("readout_full", stream, stream.events.width * stream.events.height, rounds)


def _readout(what: str, stream: Stream, count: int, rounds: int) -> Iterator[Row]:
    events = stream.events[:count]
    ours, others = subjects.readout(events), peers.readouts(events)
    yield from rows(what, stream, ours, others, rounds * READOUT_ROUNDS_FACTOR, unit=MS, frames=1, events=len(events))


def high_pass(stream: Stream, rounds: int) -> Iterator[Row]:
    """High-pass reconstruction without images."""
    yield from rows("high_pass", stream, subjects.high_pass(stream.messages()), [], rounds)


def noise_filter(stream: Stream, rounds: int) -> Iterator[Row]:
    """The background-activity filter, the passing events as arrays."""
    messages = stream.messages()
    others = peers.noise_filters(messages, subjects.NOISE_WINDOW_S)
    yield from rows("noise_filter", stream, subjects.noise_filter(messages), others, rounds)


def _frame_ends(stream: Stream, config: AtsltdConfig) -> list[int]:
    """After how many events each ATSLTD frame ends."""
    converter = AtsltdConverter(stream.events.width, stream.events.height, config)
    return list(accumulate(frame.events for events in stream.messages() for frame in converter.convert(events)))
