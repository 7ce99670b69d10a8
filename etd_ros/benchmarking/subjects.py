"""Our own side of the comparisons, through the public interfaces, a batch per message."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from etd_ros.benchmarking.measure import Subject
from etd_ros.conversion import (
    AtsltdConfig,
    AtsltdConverter,
    BackgroundActivityFilter,
    FixedWindowConfig,
    FixedWindowConverter,
    Frame,
    NoiseFilterConfig,
)
from etd_ros.events import Events
from etd_ros.reconstruction import HighPassFilter
from msg_adapters import Layout, decoder_for
from msg_adapters.codecs import Evt3Decoder

NOISE_WINDOW_S = 0.002
FRAME_NS_MIN = 1000


def conversion(messages: Sequence[Events], config: AtsltdConfig | None = None) -> Subject:
    """ATSLTD conversion to frames."""
    converter = AtsltdConverter(messages[0].width, messages[0].height, config)

    def convert(events: Events) -> None:
        for _ in converter.convert(events):
            pass

    return _each("ATSLTD", convert, messages, converter.reset)


def high_pass(messages: Sequence[Events]) -> Subject:
    """High-pass reconstruction: integration of the events, no images."""
    reconstruction = HighPassFilter(messages[0].width, messages[0].height)
    return _each("high-pass", reconstruction.integrate, messages, reconstruction.reset)


def noise_filter(messages: Sequence[Events]) -> Subject:
    """The background-activity filter with a window of 2 ms."""
    config = NoiseFilterConfig(window_s=NOISE_WINDOW_S)
    background = BackgroundActivityFilter(messages[0].width, messages[0].height, config)
    return _each("noise filter", background.filter, messages, background.reset)


def readout(events: Events) -> Subject:
    """The end of a frame that holds these events: its NZGE, its grey levels, a clean map for the next frame."""
    start_ns, last_ns = int(events.t[0]), int(events.t[-1])
    duration_ns = max(FRAME_NS_MIN, last_ns - start_ns)
    converter = FixedWindowConverter(events.width, events.height, FixedWindowConfig(window_s=duration_ns * 1e-9))
    next_event = replace(events[:1], t=np.array([start_ns + duration_ns + 1], np.int64))

    def fill() -> None:
        converter.reset()
        list(converter.convert(events))

    def finish() -> list[Frame]:
        return list(converter.convert(next_event))

    return Subject("readout", finish, prepare=fill)


def decoding(messages: Sequence[bytes], type_name: str, layout: Layout, units: int) -> Subject:
    """Decoding of messages of events, `units` in all."""
    decoder = decoder_for(type_name, layout)
    return replace(_each("decoding", decoder.decode, messages, decoder.reset), units=units)


def evt3_words(payloads: Sequence[bytes], size: tuple[int, int], units: int) -> Subject:
    """Decoding of the words of evt3 alone, message by message, `units` events in all."""
    decoder = Evt3Decoder()
    return replace(
        _each("evt3 words", lambda payload: decoder.decode(payload, *size), payloads, decoder.reset), units=units
    )


def _each(name: str, work: Callable[[Any], object], messages: Sequence[Any], reset: Callable[[], object]) -> Subject:
    def run() -> None:
        for message in messages:
            work(message)

    return Subject(name, run, sum(map(len, messages)), reset)
