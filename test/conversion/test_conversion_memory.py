"""Message after message nothing is allocated but frames, and those lie in memory that is used again."""

import tracemalloc

import pytest
from conversion_oracles import random_events

from etd_ros.conversion import AtsltdConfig, AtsltdConverter, BackgroundActivityFilter, NoiseFilterConfig
from etd_ros.reconstruction import HighPassFilter

WIDTH, HEIGHT = 240, 180
EVENTS = 2000
"""In a message: a number of 8 bytes for each of them would be 16,000 bytes."""

ALLOCATED_MAX = 8000
"""Bytes; frames' objects without their arrays, views of arrays, generators."""


def converting(config):
    converter = AtsltdConverter(WIDTH, HEIGHT, config)
    return lambda events: [None for _ in converter.convert(events)]


def filtering():
    noise_filter = BackgroundActivityFilter(WIDTH, HEIGHT, NoiseFilterConfig(window_s=0.002))
    return lambda events: len(noise_filter.filter(events))


@pytest.mark.parametrize(
    "work",
    [
        converting(AtsltdConfig()),
        converting(AtsltdConfig().fine()),
        filtering(),
        HighPassFilter(WIDTH, HEIGHT).integrate,
    ],
    ids=["ATSLTD frames", "fine frames", "noise filter", "high-pass filter"],
)
def test_a_hundred_messages_allocate_nothing_for_their_events_or_frames_arrays(work):
    events = random_events(21, 120 * EVENTS, WIDTH, HEIGHT, 120 * 2_000_000)
    messages = [events[first : first + EVENTS] for first in range(0, len(events), EVENTS)]
    for message in messages[:20]:
        work(message)
    tracemalloc.start()
    try:
        work(messages[20])
        before, _ = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()
        for message in messages[21:]:
            work(message)
        after, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < ALLOCATED_MAX
    assert peak - before < ALLOCATED_MAX
