"""A small simulated recording with video, held in memory, and its truth."""

from __future__ import annotations

from functools import cache

import numpy as np

from etd_ros.evaluation import TimedBox, TrackRow, score
from etd_ros.events import concatenate
from etd_ros.recordings.interface import RecordedImage
from etd_ros.recordings.loaded import LoadedRecording
from etd_ros.simulation import Path, Scene, Sprite, Waypoint, simulate
from etd_ros.simulation.textures import blobs, checks, smooth_noise
from etd_ros.systems.running import run_system
from etd_ros.targets import TargetStart

START_NS = 1_700_000_000_000_000_000
WIDTH, HEIGHT, DURATION_S = 120, 90, 0.5
IMAGE_S = 0.02
NAMES = ("left", "right")


@cache
def scene() -> Scene:
    """Two textured things that cross before a smooth wall."""
    rng = np.random.default_rng(3)
    wall = 0.45 + 0.15 * smooth_noise(rng, HEIGHT, WIDTH, grain=4.0)
    left = Sprite("left", blobs(rng, 28, 30), np.ones((28, 30)), Path([Waypoint(0, 30, 24), Waypoint(0.5, 55, 28)]))
    right = Sprite("right", checks(rng, 26, 30), np.ones((26, 30)), Path([Waypoint(0, 90, 66), Waypoint(0.5, 65, 64)]))
    return Scene(WIDTH, HEIGHT, DURATION_S, wall, (left, right))


@cache
def recording() -> LoadedRecording:
    """The scene's events, and its pictures at 50 Hz from 10 ms on."""
    events = concatenate(list(simulate(scene(), seed=1, start_ns=START_NS)))
    cuts = range(0, len(events), 5000)
    packets = [(events[first : first + 5000], number, "mono") for number, first in enumerate(cuts)]
    times_s = np.arange(IMAGE_S / 2, DURATION_S, IMAGE_S)
    pictures = [np.round(np.exp(scene().render(time_s)) * 255).clip(0, 255).astype(np.uint8) for time_s in times_s]
    stamps_ns = [stamp_ns(time_s) for time_s in times_s]
    images = [RecordedImage(stamp, "cam", picture) for stamp, picture in zip(stamps_ns, pictures, strict=True)]
    return LoadedRecording(packets, images)


def with_images(images: list[RecordedImage]) -> LoadedRecording:
    """The recording's events with other images."""
    return LoadedRecording([(batch.events, None, None) for batch in recording().streams()], images)


def stamp_ns(time_s: float) -> int:
    return START_NS + round(time_s * 1e9)


def start(name: str, time_s: float = 0.1) -> TargetStart:
    return TargetStart(name, scene().box(name, time_s), stamp_ns(time_s))


def tracks_of(system: str, starts: list[TargetStart], **options) -> dict[str, list[TrackRow]]:
    """What a system says of the recording's targets."""
    rows: dict[str, list[TrackRow]] = {target.name: [] for target in starts}
    for step in run_system(system, recording(), starts, **options):
        for report in step.reports:
            rows[report.name].append(TrackRow(step.stamp_ns, report.name, report.box, report.score, report.state.value))
    return rows


def mean_iou(tracks: dict[str, list[TrackRow]]) -> dict[str, float]:
    """AP of each track with the truth from 0.1 s on."""
    times_s = np.arange(0.1, DURATION_S, 0.02)
    truth = {name: [TimedBox(stamp_ns(time_s), scene().box(name, time_s)) for time_s in times_s] for name in tracks}
    return {name: found.ap for name, found in score(tracks, truth).items()}
