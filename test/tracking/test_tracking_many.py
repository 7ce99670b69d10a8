"""Many targets share the time that there is for looks."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from tracked_scenes import HEIGHT, START_NS, WIDTH, frames_of, overlap, pillar, scene_of

from etd_ros.boxes import Box
from etd_ros.simulation import Waypoint
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState
from etd_ros.tracking.box_network import shipped_network
from etd_ros.tracking.contour_target import ContourTarget
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


class Rests:
    """Counts how often a target's frames change nothing, as its next look is not due."""

    def __init__(self, monkeypatch):
        self.frames = self.rested = 0
        update, look = ContourTarget.update, ContourTarget._look
        looked = []

        def counted(target, *arguments):
            looked.clear()
            report = update(target, *arguments)
            if target.name == "thing":
                self.frames += 1
                self.rested += not looked
            return report

        monkeypatch.setattr(ContourTarget, "update", counted)
        monkeypatch.setattr(ContourTarget, "_look", lambda *given: (looked.append(True), look(*given)))


@pytest.mark.parametrize(("others", "rests"), [(0, False), (19, True)])
def test_each_of_many_rests_until_its_next_look(scene, frames, monkeypatch, others, rests):
    counted = Rests(monkeypatch)
    followed(scene, frames, others, monkeypatch)
    assert (counted.rested > 0.4 * counted.frames) == rests


def test_one_of_many_that_is_lost_rests_between_searches_and_is_found(monkeypatch):
    behind = scene_of(Waypoint(0, 40, 60), Waypoint(1.0, 160, 60), duration_s=1.0, cover=(pillar(100),))
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig(refine_gain=0.0))
    tracker.start("thing", behind.box("thing", 0))
    for number in range(19):
        tracker.start(f"other_{number}", Box(10.0 * number, 140, 8, 8))
    counted, states = Rests(monkeypatch), []
    for frame in frames_of(behind):
        before = counted.rested
        report = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)[0]
        states.append((report.state, counted.rested > before))
    assert (TargetState.RECOVERING, True) in states
    assert report.state is TargetState.TRACKING
    assert overlap(report, behind.box("thing", (frame.stamp_ns - START_NS) * 1e-9)) > 0.7


def beside_many(scene, stamp_ns=0):
    """A tracker of the scene's thing beside 19 boxes with nothing in them."""
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig(refine_gain=0.0))
    tracker.start("thing", scene.box("thing", 0), stamp_ns)
    for number in range(19):
        tracker.start(f"other_{number}", Box(10.0 * number, 140, 8, 8))
    return tracker


def test_what_rests_is_wherever_its_motion_brings_it(scene, frames):
    """Its box moves on with every frame, and not only with those that are looked at."""
    tracker = beside_many(scene)
    boxes = [tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)[0].box for frame in frames]
    late = boxes[len(boxes) // 2 :]
    assert all(box != before for before, box in itertools.pairwise(late))
    assert late[-1].iou(scene.box("thing", DURATION_S)) > 0.8


def test_where_there_are_few_again_none_rests_as_the_surface_no_longer_keeps_all(scene, frames, monkeypatch):
    tracker, counted = beside_many(scene), Rests(monkeypatch)
    middle = len(frames) // 2
    for frame in frames[:middle]:
        tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
    for name in list(tracker.targets)[1:]:
        tracker.stop(name)
    # All of the next one is kept still.
    tracker.update(frames[middle].stamp_ns, frames[middle].data, start_ns=frames[middle].start_ns)
    rested = counted.rested
    for frame in frames[middle + 1 :]:
        report = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)[0]
    assert 0 < rested == counted.rested
    assert overlap(report, scene.box("thing", DURATION_S)) > 0.8


def test_nothing_rests_through_a_gap(scene, frames, monkeypatch):
    tracker, counted = beside_many(scene), Rests(monkeypatch)
    for frame in frames[: len(frames) // 2]:
        tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
    rested, end_ns = counted.rested, frame.stamp_ns
    tracker.targets["thing"]._rests_until_ns = end_ns + 100_000_000
    tracker.update(end_ns + 60_000_000, frame.data, start_ns=end_ns + 59_000_000)
    assert counted.rested == rested


@pytest.mark.parametrize("stamp_ns", [0, START_NS], ids=["goes on", "waits for its start"])
def test_what_rests_is_followed_where_the_stream_starts_again(scene, frames, monkeypatch, stamp_ns):
    tracker, counted = beside_many(scene, stamp_ns), Rests(monkeypatch)
    for frame in frames[:-1]:
        tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
    tracker.targets["thing"]._rests_until_ns = frames[-1].stamp_ns
    rested = counted.rested
    tracker.update(frames[0].stamp_ns, frames[0].data, start_ns=frames[0].start_ns)
    assert counted.rested == rested
