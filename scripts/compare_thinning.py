"""What is left of a target when three of four milliseconds of events are left out: evenly, or in blocks.

The live scene of `benchmark`, offline: all of its events for a quarter of a second, then one message of a millisecond
in four, or 15 in 60; the latter end the stream, as a gap does. Prints the mean IoU of a target that was there before,
and of one that starts in the midst of it, from half a second after the thinning began.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np

from etd_ros.benchmarking.live_scene import LiveScene
from etd_ros.engine import FrameSource, PerSensor, make_tracker
from etd_ros.settings import Settings
from etd_ros.stream import StreamBatch, StreamGuard
from etd_ros.tracking import DEFAULT_METHOD, METHODS

SENSORS = {(640, 480): 10e6, (1280, 720): 50e6}
"""Sensor sizes (pixels) and their events a second."""
MESSAGES = 1500
THINNED_FROM, STARTS_AT, JUDGED_FROM = 250, 300, 750
"""Numbers of messages, which are also milliseconds."""
FRAME_S = 0.004
"""The shortest frames of a node that falls behind."""


def messages(scene: LiveScene, rate: float, kept: int, period: int) -> Iterator[tuple[int, StreamBatch]]:
    """Those that are not left out, and their numbers."""
    rng, guard = np.random.default_rng(1), StreamGuard()
    for number in range(MESSAGES):
        if number >= THINNED_FROM and (number - THINNED_FROM) % period >= kept:
            continue
        events = scene.events(number * 1000, 1000, round(rate / 1000), rng)
        for batch in guard.feed(events, seq=number, left_out=period - kept if kept == 1 else 0):
            yield number, batch


def mean_iou(scene: LiveScene, rate: float, kept: int, period: int, start: int) -> float:
    """Of a target that starts with a message of this number, while the rest is thinned out."""
    settings, method = Settings(), METHODS[DEFAULT_METHOD]
    sources = PerSensor(lambda width, height: FrameSource(method.conversion, width, height, settings))
    tracker = make_tracker(method.name, scene.width, scene.height, settings)
    overlaps = []
    for number, batch in messages(scene, rate, kept, period):
        source = sources.at(batch)
        source.last_at_least(FRAME_S if number >= THINNED_FROM else 0.0)
        for frame in source.frames(batch.events):
            true_box = scene.box(frame.stamp_ns / 1000)
            if number >= start and not tracker.targets:
                tracker.start("target", true_box)
            for report in tracker.update(frame.stamp_ns, frame.data):
                if number >= JUDGED_FROM:
                    overlaps.append(0.0 if report.box is None else report.box.iou(true_box))
    return float(np.mean(overlaps))


def main() -> int:
    """Print a row for each sensor and way."""
    print("| sensor | left out | target from before | target that starts then |\n|-|-|-|-|")
    for sensor, rate in SENSORS.items():
        scene = LiveScene(*sensor)
        for told, kept, period in (("evenly, 3 of 4 ms", 1, 4), ("in blocks, 45 of 60 ms", 15, 60)):
            before, then = (mean_iou(scene, rate, kept, period, start) for start in (0, STARTS_AT))
            print(f"| {sensor[0]}x{sensor[1]}, {rate / 1e6:g} Mev/s | {told} | {before:.2f} | {then:.2f} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
