"""Run in a fresh process: what the kernels of a node still compile or load after its warm-up.

Arguments: node (or `nothing`, for no warm-up), the folder of real recordings. Prints one kernel a line.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from dvs_msgs.msg import Event, EventArray
from event_camera_msgs.msg import EventPacket
from numba.core.dispatcher import Dispatcher
from rclpy.serialization import serialize_message

from etd_ros.boxes import Box
from etd_ros.engine import CONVERSIONS, FrameSource, make_tracker
from etd_ros.nodes.accumulator import STAGES as ACCUMULATOR
from etd_ros.nodes.event_input import EventDecoding
from etd_ros.nodes.reconstruction import STAGES as RECONSTRUCTION
from etd_ros.nodes.tracker import STAGES as TRACKER
from etd_ros.reconstruction import HighPassFilter, SynchronisedReconstruction
from etd_ros.recordings import open_recording
from etd_ros.settings import STAGES as ALL
from etd_ros.settings import Settings, settings_from_mapping
from etd_ros.stream import StreamBatch
from etd_ros.tracking import DEFAULT_METHOD, METHODS, TargetState
from etd_ros.warm_up import warm_up
from msg_adapters import ENCODINGS

NODES = {
    "accumulator": tuple(ACCUMULATOR),
    "reconstruction": tuple(RECONSTRUCTION),
    "tracker": tuple(TRACKER),
    "pipeline": tuple(ALL),
    "nothing": (),
}
TARGET_SHARE, NOISE_SHARE = 0.3, 0.05
FRAME_NS = 10_000_000
PACKET, ARRAY = "event_camera_msgs/msg/EventPacket", "dvs_msgs/msg/EventArray"


def kernels() -> set[tuple[str, str]]:
    """Every kernel of the project with every signature that is ready."""
    return {
        (f"{module.__name__}.{kernel.py_func.__name__}", str(signature))
        for module in tuple(sys.modules.values())
        if module.__name__.partition(".")[0] in ("etd_ros", "msg_adapters")
        for kernel in vars(module).values()
        if isinstance(kernel, Dispatcher)
        for signature in kernel.signatures
    }


def batches(data: Path) -> Iterator[StreamBatch]:
    """The first events of real drivers as a node gets them, and of the encodings that no recording has."""
    seen = set()
    for folder in ("evt3_640x480", "libcaer_cmp_346x260", "mono_1280x720"):
        with open_recording(data / "drivers" / folder) as recording:
            decoding = EventDecoding(PACKET, Settings(), resumes=False)
            for message, _ in zip(recording.messages(), range(40), strict=False):
                for decoded, batch in decoding.decode(message.data):
                    seen.add(decoded.encoding)
                    yield batch
    times_us = np.arange(0, 300_000, 100, dtype=np.uint32)
    places = np.random.default_rng(1).integers(0, 100, (len(times_us), 2), np.uint32)
    libcaer = np.column_stack([places[:, 0] << 17 | places[:, 1] << 2 | 2, times_us]).astype("<u4")
    for encoding, payload in (("libcaer", libcaer.tobytes()), ("trigger", bytes(16))):
        packet = EventPacket(width=128, height=128, encoding=encoding, events=payload)
        seen.add(encoding)
        yield from (
            batch for _, batch in EventDecoding(PACKET, Settings(), resumes=False).decode(serialize_message(packet))
        )
    assert seen == ENCODINGS, "every encoding is tried"
    events = [Event(x=3, y=4, polarity=True), Event(x=5, y=4)]
    for order in (events, events[::-1]):
        array = EventArray(width=128, height=128, events=order)
        yield from (
            batch for _, batch in EventDecoding(ARRAY, Settings(), resumes=False).decode(serialize_message(array))
        )


def convert(batch: StreamBatch) -> None:
    width, height = batch.events.width, batch.events.height
    for conversion in CONVERSIONS:
        for window_s in (0.0, 0.01):
            settings = settings_from_mapping({"noise_filter.window_s": window_s})
            list(FrameSource(conversion, width, height, settings).frames(batch.events))


def reconstruct(batch: StreamBatch) -> None:
    reconstruction = SynchronisedReconstruction(HighPassFilter(batch.events.width, batch.events.height))
    for stamp_ns in batch.events.t[::1000]:
        reconstruction.request(int(stamp_ns))
    reconstruction.push(batch.events)
    assert list(reconstruction.ready())


def track() -> None:
    """A target that comes, goes and comes back, on frames as the pipeline makes them, and as a tracker node gets them:
    nobody may write to those."""
    rng = np.random.default_rng(1)
    target = rng.integers(0, 255, (60, 60, 2), np.uint8) * (rng.random((60, 60, 1)) < TARGET_SHARE)
    for method, writeable in itertools.product(METHODS, (True, False)):
        tracker = make_tracker(method, 128, 128, Settings())
        tracker.start("target", Box(20, 20, 60, 60))
        states = set()
        for step in range(80):
            frame = rng.integers(0, 255, (128, 128, 2), np.uint8) * (rng.random((128, 128, 1)) < NOISE_SHARE)
            if not 30 <= step < 60:
                frame[20:80, 20 + step % 30 : 80 + step % 30] = target
            image = frame[..., 0].copy()
            frame.flags.writeable = image.flags.writeable = writeable
            states |= {report.state for report in tracker.update(step * FRAME_NS, frame, image)}
        assert {TargetState.TRACKING, TargetState.RECOVERING} <= states or method != DEFAULT_METHOD, states


def main(node: str, data: Path) -> None:
    stages = NODES[node]
    warm_up(stages)
    before = kernels()
    works_on_events = node != "tracker"
    for batch in batches(data) if works_on_events else ():
        if node in ("accumulator", "pipeline", "nothing"):
            convert(batch)
        if node in ("reconstruction", "pipeline", "nothing"):
            reconstruct(batch)
    if node in ("tracker", "pipeline", "nothing"):
        track()
    for kernel, signature in sorted(kernels() - before):
        print(kernel, signature)  # noqa: T201


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
