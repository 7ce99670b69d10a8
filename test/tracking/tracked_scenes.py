"""Simulated scenes for the tests of `etd-plus`, and what it makes of them."""

from __future__ import annotations

import numpy as np

from etd_ros.boxes import iou
from etd_ros.engine import FrameSource
from etd_ros.events import Events, concatenate
from etd_ros.settings import Settings
from etd_ros.simulation import Path, Scene, Sprite, Waypoint, simulate
from etd_ros.simulation.sensor import SensorConfig
from etd_ros.simulation.textures import checks, smooth_noise
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState

START_NS = 1_000_000_000
WIDTH, HEIGHT = 240, 180
SIZE = 36


def scene_of(*waypoints, duration_s=1.0, cover=()):
    """A checked square on a way before a smooth wall; covers pass in front of it."""
    rng = np.random.default_rng(5)
    wall = 0.5 + 0.05 * smooth_noise(rng, HEIGHT, WIDTH)
    thing = Sprite("thing", checks(rng, SIZE, SIZE, cell=9), np.ones((SIZE, SIZE)), Path(waypoints))
    return Scene(WIDTH, HEIGHT, duration_s, wall, (thing, *cover))


def pillar(x):
    """What the square passes behind: 60 px wide, from top to bottom."""
    return Sprite(
        "pillar", np.full((HEIGHT, 60), 0.5), np.ones((HEIGHT, 60)), Path([Waypoint(0, x, HEIGHT / 2)]), is_target=False
    )


def events_of(scene, *, noise_rate_hz=1000.0):
    return concatenate(
        list(simulate(scene, seed=1, start_ns=START_NS, config=SensorConfig(noise_rate_hz=noise_rate_hz)))
    )


def frames_of(scene, *, noise_rate_hz=1000.0):
    return frames_from(events_of(scene, noise_rate_hz=noise_rate_hz))


def frames_from(events, kept=slice(None)):
    """The frames of events, or of those of them that are kept."""
    rest = Events(events.t[kept], events.x[kept], events.y[kept], events.p[kept], WIDTH, HEIGHT)
    return list(FrameSource("atsltd_fine", WIDTH, HEIGHT, Settings()).frames(rest))


def frames_without_it(scene, since_s, until_s=np.inf):
    """The frames of a scene whose target has no events for a time; what the background has it has."""
    events = events_of(scene, noise_rate_hz=20_000.0)
    kept = np.ones(len(events), bool)
    for k, (t, x, y) in enumerate(zip((events.t - START_NS) * 1e-9, events.x, events.y, strict=True)):
        if since_s <= t < until_s:
            left, top, w, h = scene.box("thing", t).scaled(1.4)
            kept[k] = not (left <= x < left + w and top <= y < top + h)
    return frames_from(events, kept)


def tracked(scene, box=None, *, start_s=0.0, config=None, unseen_s=(0.0, 0.0), frames=None, class_id=""):
    """(seconds, report, truth) of each frame from the start on; those that start in a span of time are missing. By
    contours alone, unless a configuration says otherwise: no network makes up for what they would do."""
    tracker = MultiTracker(WIDTH, HEIGHT, contours=config or ContourConfig(refine_gain=0.0))
    tracker.start("thing", box or scene.box("thing", start_s), START_NS + round(start_s * 1e9), class_id)
    found = []
    for frame in frames or frames_of(scene):
        if unseen_s[0] <= (frame.start_ns - START_NS) * 1e-9 < unseen_s[1]:
            continue
        (report,) = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
        time_s = (frame.stamp_ns - START_NS) * 1e-9
        if report.state is not TargetState.IDLE:
            found.append((time_s, report, scene.box("thing", time_s)))
    return found


def all_at_the_end(scene, frames):
    """The overlap of each target at the end of the frames, by name, by contours alone."""
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig(refine_gain=0.0))
    for name in scene.targets:
        tracker.start(name, scene.box(name, 0.0), START_NS)
    for frame in frames:
        reports = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
    time_s = (frames[-1].stamp_ns - START_NS) * 1e-9
    return {report.name: overlap(report, scene.box(report.name, time_s)) for report in reports}


class ForgetfulRecovery:
    """The part of a recovery tracker that tests of what it sees do not ask about: nothing is remembered."""

    has_lead = False

    def watch(self):
        return None

    def remember(self, image, box):
        pass

    def forget_lately(self):
        pass

    def look_wider(self):
        pass


def overlap(report, truth):
    return 0.0 if report.box is None else float(iou(np.array([report.box]), truth)[0])
