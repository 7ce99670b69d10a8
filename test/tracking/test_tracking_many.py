"""Many targets share the time that there is for looks."""

from __future__ import annotations

import numpy as np
import pytest
from tracked_scenes import HEIGHT, START_NS, WIDTH, frames_of, scene_of

from etd_ros.boxes import Box
from etd_ros.simulation import Waypoint
from etd_ros.tracking import ContourConfig, MultiTracker
from etd_ros.tracking.box_network import shipped_network
from etd_ros.tracking.contours import Contours
from etd_ros.tracking.turns import FEW

DURATION_S = 0.8


@pytest.fixture(scope="module")
def scene():
    return scene_of(Waypoint(0, 40, 60), Waypoint(DURATION_S, 120, 90), duration_s=DURATION_S)


@pytest.fixture(scope="module")
def frames(scene):
    return list(frames_of(scene))


def followed(scene, frames, others, monkeypatch):
    """The thing's overlaps, frame by frame, beside so many boxes with nothing in them; how many looks at it there were,
    and how often the box network was asked about it."""
    looks, asked = [], []
    look = Contours.look

    def counted(contours, *arguments, **named):
        looks.append(contours.body.size_px)
        return look(contours, *arguments, **named)

    def corrector(view):
        asked.append(view.target)
        return shipped_network().misfit_of(view)

    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig(), corrector=corrector)
    box = scene.box("thing", 0)
    tracker.start("thing", box)
    for number in range(others):
        tracker.start(f"other_{number}", Box(10.0 * number, 140, 8, 8))
    overlaps = []
    with monkeypatch.context() as patched:
        patched.setattr(Contours, "look", counted)
        for frame in frames:
            report = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)[0]
            overlaps.append(report.box.iou(scene.box("thing", (frame.stamp_ns - START_NS) * 1e-9)))
    return overlaps, looks.count((box.w, box.h)), asked.count("thing")


def test_few_targets_are_looked_at_as_often_as_one(scene, frames, monkeypatch):
    alone, few = (followed(scene, frames, others, monkeypatch) for others in (0, FEW - 1))
    assert alone == few


def test_each_of_many_is_looked_at_less_often_and_followed_as_well(scene, frames, monkeypatch):
    (alone, looks, asked), (beside_many, fewer_looks, less_asked) = (
        followed(scene, frames, others, monkeypatch) for others in (0, 19)
    )
    assert fewer_looks < 0.6 * looks
    assert 0 < less_asked < 0.7 * asked
    assert np.mean(beside_many) > np.mean(alone) - 0.02
