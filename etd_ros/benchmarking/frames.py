"""From events to frames, images and filtered events: conversion, bare_map, readout, high_pass, noise_filter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import accumulate

import numpy as np

from etd_ros.benchmarking import peers
from etd_ros.benchmarking.comparing import MS, rows
from etd_ros.benchmarking.measure import Subject
from etd_ros.benchmarking.references import bare_map
from etd_ros.benchmarking.report import Row
from etd_ros.benchmarking.streams import Stream
from etd_ros.conversion import (
    AtsltdConverter,
    BackgroundActivityFilter,
    FixedWindowConfig,
    FixedWindowConverter,
    Frame,
    NoiseFilterConfig,
)
from etd_ros.reconstruction import HighPassFilter

NOISE_WINDOW_S = 0.002
READOUT_ROUNDS_FACTOR = 20
"""A readout is so short that it needs more rounds."""


def conversion(stream: Stream, rounds: int, *, all_peers: bool) -> Iterator[Row]:
    """ATSLTD conversion against the bare map and the peers' frames, which end where ours do."""
    messages = stream.messages()
    converter = AtsltdConverter(stream.events.width, stream.events.height)
    frame_ends = list(accumulate(frame.events for events in messages for frame in converter.convert(events)))

    def run() -> None:
        for events in messages:
            for _ in converter.convert(events):
                pass

    ours = Subject("ATSLTD", run, len(stream.events), converter.reset)
    count, events_in = len(frame_ends), max(frame_ends, default=0)
    # Without peers their fields are empty in one row; our own reference has a row in any case.
    for others in (peers.converters(messages, frame_ends, all_peers=all_peers), [bare_map(messages)]):
        yield from rows("conversion", stream, ours, others, rounds, frames=count, events=events_in)


def bare_maps(stream: Stream, rounds: int) -> Iterator[Row]:
    """The bare last-event map itself."""
    yield from rows("bare_map", stream, bare_map(stream.messages()), [], rounds)


def readout(stream: Stream, rounds: int) -> Iterator[Row]:
    """Making one frame of the events that have come, NZGE included; as many events as one ATSLTD frame has."""
    frame = _first_frame(stream)
    count = frame.events if frame is not None else len(stream.events)
    events = stream.events[:count]
    start_ns, duration_ns = int(events.t[0]), int(events.t[-1] - events.t[0]) + 1
    converter = FixedWindowConverter(events.width, events.height, FixedWindowConfig(window_s=duration_ns * 1e-9))
    after = replace(events[:1], t=np.array([start_ns + duration_ns + 1], np.int64))

    def prepare() -> None:
        converter.reset()
        list(converter.convert(events))

    def run() -> list[Frame]:
        return list(converter.convert(after))

    ours = Subject("readout", run, prepare=prepare)
    others = peers.readouts(events)
    yield from rows("readout", stream, ours, others, rounds * READOUT_ROUNDS_FACTOR, unit=MS, frames=1, events=count)


def high_pass(stream: Stream, rounds: int) -> Iterator[Row]:
    """Integration of the events; images are not made."""
    messages = stream.messages()
    reconstruction = HighPassFilter(stream.events.width, stream.events.height)

    def run() -> None:
        for events in messages:
            reconstruction.integrate(events)

    ours = Subject("high-pass", run, len(stream.events), reconstruction.reset)
    yield from rows("high_pass", stream, ours, [], rounds)


def noise_filter(stream: Stream, rounds: int) -> Iterator[Row]:
    """The background-activity filter with a window of 2 ms, the passing events as arrays."""
    messages = stream.messages()
    config = NoiseFilterConfig(window_s=NOISE_WINDOW_S)
    background = BackgroundActivityFilter(stream.events.width, stream.events.height, config)

    def run() -> None:
        for events in messages:
            background.filter(events)

    ours = Subject("background activity", run, len(stream.events), background.reset)
    yield from rows("noise_filter", stream, ours, peers.noise_filters(messages, NOISE_WINDOW_S), rounds)


def _first_frame(stream: Stream) -> Frame | None:
    converter = AtsltdConverter(stream.events.width, stream.events.height)
    return next((frame for events in stream.messages() for frame in converter.convert(events)), None)
