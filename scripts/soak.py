"""A long stream through the event path, as fast as it goes, and the memory that it takes.

Decoding, guard, noise filter, conversion and reconstruction of one packet that is stamped anew again and again, with a
lost message now and then. Prints the resident memory after 10 s of the stream and at its end, for example with
`python scripts/soak.py --duration 600 --rate 10e6`.
"""

from __future__ import annotations

import argparse
import json
import os
import struct
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from etd_ros.engine import FrameSource, ImageSource, PerSensor
from etd_ros.events import Events
from etd_ros.settings import Settings, settings_from_mapping
from etd_ros.stream import StreamBatch, StreamGuard
from etd_ros.warm_up import warm_up
from msg_adapters import Layout, decoder_for, encode_event_packet

PACKET_NS = 10_000_000
FIRST_NS = 1_700_000_000_000_000_000
SEQ_MARK = 0x1122334455667788
MESSAGES_PER_LOSS = 997
WARM_NS = 10_000_000_000
NS_PER_S = 1_000_000_000


def main() -> int:
    """Run the stream and print what it took."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=600.0, metavar="S", help="of the stream (default: 600)")
    parser.add_argument("--rate", type=float, default=10e6, metavar="EVENTS_PER_S", help="default: 10e6")
    parser.add_argument("--size", default="240x180", metavar="WxH", help="of the sensor (default: 240x180)")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of words")
    options = parser.parse_args()
    width, height = map(int, options.size.split("x"))
    warm_up(("stream", "noise_filter", "atsltd", "reconstruction"))
    figures = soak(options.duration, options.rate, width, height)
    if options.json:
        print(json.dumps(figures))
    else:
        print(
            f"{figures['events'] / 1e6:.0f} M events, {figures['frames']} frames and {figures['restarts']} restarts in "
            f"{figures['took_s']:.0f} s: {figures['warm_mib']:.1f} MiB after {WARM_NS / NS_PER_S:.0f} s of the stream, "
            f"{figures['end_mib']:.1f} MiB at its end, {figures['peak_mib']:.1f} MiB at most"
        )
    return 0


def soak(duration_s: float, rate: float, width: int, height: int) -> dict[str, float]:
    """Work through a stream of `duration_s` seconds and `rate` events/s; memory in MiB."""
    settings = settings_from_mapping({"noise_filter.window_s": 0.01})
    frame_sources = PerSensor(lambda *size: FrameSource("atsltd", *size, settings))
    image_sources = PerSensor(lambda *size: ImageSource(*size, Settings()))
    guard = StreamGuard()
    events = frames = 0
    warm_mib = peak_mib = 0.0
    started_s = time.monotonic()
    for batch in _batches(guard, _messages(duration_s, rate, width, height)):
        events += len(batch.events)
        images = image_sources.at(batch)
        for part in frame_sources.at(batch).parts(batch):
            frames += images.take(part).image is not None
        if int(batch.events.t[-1]) - FIRST_NS <= WARM_NS:
            warm_mib = resident_mib()
        peak_mib = max(peak_mib, resident_mib())
    return {
        "events": events,
        "frames": frames,
        "restarts": guard.counters.restarts,
        "took_s": time.monotonic() - started_s,
        "warm_mib": warm_mib,
        "end_mib": resident_mib(),
        "peak_mib": peak_mib,
    }


def resident_mib() -> float:
    """Resident memory of this process (MiB)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def _batches(guard: StreamGuard, messages: Iterator[bytes]) -> Iterator[StreamBatch]:
    decoder = decoder_for("event_camera_msgs/msg/EventPacket", Layout.ROS2)
    for message in messages:
        decoded = decoder.decode(message)
        yield from guard.feed(decoded.events, decoded.seq, decoded.encoding)


def _messages(duration_s: float, rate: float, width: int, height: int) -> Iterator[bytes]:
    """EventPackets of 10 ms: specks that wander, with noise between them."""
    template = bytearray(
        encode_event_packet(
            _events(round(rate * PACKET_NS / NS_PER_S), width, height), stamp_ns=0, frame_id="", seq=SEQ_MARK
        )
    )
    # The time base follows the sequence number.
    at = template.index(struct.pack("<Q", SEQ_MARK))
    for number in range(round(duration_s * NS_PER_S / PACKET_NS)):
        if number % MESSAGES_PER_LOSS != MESSAGES_PER_LOSS - 1:
            struct.pack_into("<QQ", template, at, number, FIRST_NS + number * PACKET_NS)
            yield bytes(template)


def _events(count: int, width: int, height: int) -> Events:
    rng = np.random.default_rng(1)
    t = np.sort(rng.integers(0, PACKET_NS, count)).astype(np.int64)
    specks = rng.integers(0, (width, height), (16, 2))[rng.integers(0, 16, count)]
    places = specks + np.round(rng.normal(0, 6, (count, 2)) + 10 * t[:, None] / PACKET_NS).astype(np.int64)
    noise = rng.random(count) < 0.2
    places[noise] = rng.integers(0, (width, height), (np.count_nonzero(noise), 2))
    x, y = (places % (width, height)).T.astype(np.uint16)
    return Events(t, x, y, rng.integers(0, 2, count).astype(np.uint8), width, height)


if __name__ == "__main__":
    sys.exit(main())
