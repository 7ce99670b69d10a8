"""The tracker: time a frame and target, beside OpenCV's CSRT on reconstructed images; many targets in real time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.benchmarking.event_path import Effort
from etd_ros.benchmarking.measure import spread_of
from etd_ros.benchmarking.report import Row
from etd_ros.benchmarking.streams import RECORDINGS, recorded
from etd_ros.boxes import Box
from etd_ros.conversion import Frame
from etd_ros.engine import FrameSource, ImageSource, Part
from etd_ros.events import Events, concatenate
from etd_ros.settings import Settings
from etd_ros.simulation import Recipe, Scene, make_scene, simulate
from etd_ros.stream import StreamBatch
from etd_ros.tracking import DEFAULT_METHOD, MultiTracker, method_named

DAVIS, HD = (240, 180), (1280, 720)
TARGET_PX = 40.0
DURATION_S = 4.0
START_S = 0.1
SCENE_SEED = 40
SPEED_PX_S = 150.0
MANY = 20
MANY_PX = 30.0
RECORDING = "slider_depth"
MS = "ms"

Milliseconds = npt.NDArray[np.float64]


def tracker(effort: Effort, data: Path | None) -> Iterator[Row]:
    """All rows, one by one as they are measured: what of a frame's time is the tracker's, without recovery.

    The target is looked at in some frames only, in most its box moves on: the mean is what it costs, the 99th
    percentile a look.

    Args:
        effort: how long to measure.
        data: folder of real recordings; None to leave them out.

    Raises:
        RecordingError: a recording is damaged.
        BenchmarkError: a recording holds no events.
    """
    scene = _scene(DAVIS, DURATION_S)
    events = concatenate(list(simulate(scene, seed=SCENE_SEED)))
    box = scene.box(scene.targets[0], 0.0)
    steps = [_steps_ms(events, [box]) for _ in range(effort.rounds)]
    peers = [_csrt_ms(events, box) for _ in range(min(effort.rounds, 2))]
    yield _row("tracker_step_mean", [np.mean(ms) for ms in steps], np.mean(peers))
    for what, percent in (("tracker_step_p50", 50), ("tracker_step_p99", 99)):
        yield _row(what, [np.percentile(ms, percent) for ms in steps], np.percentile(peers, percent))
    for sensor in (DAVIS, HD):
        yield _start(sensor, effort)
    stream = recorded(RECORDING, data, effort.events) if data is not None and RECORDING in RECORDINGS else None
    if stream is not None:
        yield from _many(stream.events, effort)


def _scene(sensor: tuple[int, int], duration_s: float) -> Scene:
    """The same scene on each sensor, with its target and speed as much larger as that is."""
    width, height = sensor
    scale = height / DAVIS[1]
    recipe = Recipe(
        ("dartboard",),
        "cloudy",
        size_px=(scale * TARGET_PX, scale * TARGET_PX),
        speed_px_s=(scale * SPEED_PX_S, scale * SPEED_PX_S),
        duration_s=duration_s,
    )
    return make_scene(recipe, width, height, np.random.default_rng(SCENE_SEED))


def _frames(events: Events) -> list[Frame]:
    source = FrameSource(method_named(DEFAULT_METHOD).conversion, events.width, events.height, Settings())
    return list(source.frames(events))


def _steps_ms(events: Events, boxes: list[Box]) -> Milliseconds:
    """Times of the frames and targets, shape (frames,)."""
    frames = _frames(events)
    targets = MultiTracker(events.width, events.height, contours=Settings().contours)
    for number, box in enumerate(boxes):
        targets.start(f"target_{number}", box)
    times = np.empty(len(frames))
    for index, frame in enumerate(frames):
        before = time.perf_counter()
        targets.update(frame.stamp_ns, frame.data)
        times[index] = time.perf_counter() - before
    return times * 1e3 / len(boxes)


def _start(sensor: tuple[int, int], effort: Effort) -> Row:
    """What a target costs in all until its start is over."""
    scene = _scene(sensor, START_S)
    events = concatenate(list(simulate(scene, seed=SCENE_SEED)))
    box = scene.box(scene.targets[0], 0.0)
    ms = [float(_steps_ms(events, [box]).sum()) for _ in range(effort.rounds)]
    value = float(np.median(ms))
    told = f"{box.w:.0f}x{box.h:.0f} px target, its first {START_S} s"
    return Row("tracker_start", f"{sensor[0]}x{sensor[1]}", value, MS, None, None, None, told, spread_of(ms))


def _csrt_ms(events: Events, box: Box) -> Milliseconds:
    """The same of OpenCV's CSRT on the images of every tenth frame."""
    images = ImageSource(events.width, events.height, Settings())
    frames = _frames(events)
    batch: StreamBatch | None = StreamBatch(events, None)
    peer: Any = cv2.TrackerCSRT_create()  # type: ignore[attr-defined]
    times = []
    for number, frame in enumerate(frames):
        image = images.take(Part(batch, frame)).image
        batch = None
        if image is None or number % 10:
            continue
        colour = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        if number == 0:
            peer.init(colour, tuple(int(value) for value in box))
            continue
        before = time.perf_counter()
        peer.update(colour)
        times.append(time.perf_counter() - before)
    return np.array(times) * 1e3


def _many(events: Events, effort: Effort) -> Iterator[Row]:
    """How many times as fast as it was recorded a recording's frames are made and 20 targets tracked on them."""
    recorded_s = float(events.t[-1] - events.t[0]) * 1e-9
    rng = np.random.default_rng(SCENE_SEED)
    corners = rng.uniform(0, [events.width - MANY_PX, events.height - MANY_PX], (MANY, 2))
    boxes = [Box(float(x), float(y), MANY_PX, MANY_PX) for x, y in corners]
    factors = []
    for _ in range(effort.rounds):
        before = time.perf_counter()
        _steps_ms(events, boxes)
        factors.append(recorded_s / (time.perf_counter() - before))
    sensor = f"{events.width}x{events.height}"
    value = float(np.median(factors))
    yield Row("tracker_20_targets", sensor, value, "x real time", None, None, None, RECORDING, spread_of(factors))


def _row(what: str, ours: list[np.floating[Any]], peer: np.floating[Any]) -> Row:
    value = float(np.median(ours))
    name, sensor = "OpenCV CSRT", f"{DAVIS[0]}x{DAVIS[1]}"
    return Row(what, sensor, value, MS, name, float(peer), float(peer) / value, "40 px target", spread_of(ours))
