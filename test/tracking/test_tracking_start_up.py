"""The first motion of a target, on simulated scenes whose truth is exact."""

import math

import numpy as np
import pytest
from tracked_scenes import HEIGHT, START_NS, WIDTH, frames_of, overlap, scene_of, tracked

from etd_ros.boxes import Box
from etd_ros.simulation import Path, Scene, Sprite, Waypoint
from etd_ros.simulation.textures import checks
from etd_ros.tracking import ContourConfig, MultiTracker
from etd_ros.tracking.camera_slide import Slide
from etd_ros.tracking.coherent_motions import CoherentMotions
from etd_ros.tracking.contours import Contours
from etd_ros.tracking.start_up import DRAWN_MIN_PX, StartUp
from etd_ros.tracking.surface import TimeSurface


def plain_disc(size_px, way):
    """A bright disc without texture on a way before a grey wall: its rim alone has events."""
    y, x = np.mgrid[:size_px, :size_px] - (size_px - 1) / 2
    disc = Sprite("thing", np.full(x.shape, 0.75), (np.hypot(x, y) < size_px / 2).astype(float), Path(way))
    return Scene(WIDTH, HEIGHT, way[-1].time_s, np.full((HEIGHT, WIDTH), 0.5), (disc,))


@pytest.mark.parametrize("down_px", [0, 60])
@pytest.mark.parametrize("speed_px_s", [4000, 6000])
def test_what_moves_by_several_pixels_in_the_shortest_frame_is_followed_from_its_start(speed_px_s, down_px):
    flight_s = 200 / speed_px_s
    way = Waypoint(0.0, 20, 70), Waypoint(flight_s, 220, 70 + down_px)
    found = tracked(scene_of(*way, duration_s=flight_s))
    overlaps = [overlap(report, truth) for _, report, truth in found[2:]]
    assert np.mean(overlaps) > 0.9
    assert min(overlaps) > 0.75


def test_what_is_small_and_has_few_events_is_followed_from_its_start_as_well():
    way = Waypoint(0.0, 20, 70), Waypoint(0.05, 220, 130)
    scene = plain_disc(16, way)
    found = tracked(scene, frames=frames_of(scene))
    overlaps = [overlap(report, truth) for _, report, truth in found[2:]]
    assert np.mean(overlaps) > 0.85


@pytest.mark.parametrize("size_px", [24, 60])
def test_what_makes_its_first_events_beside_its_box_is_followed_from_there(size_px):
    # It is as bright as the wall's left part, and shows only before the right one.
    start_x, flight_s = 6 + size_px / 2, 0.15
    way = Waypoint(0.0, start_x, 90), Waypoint(flight_s, start_x + 140, 90)
    disc = plain_disc(size_px, way).sprites[0]
    wall = np.full((HEIGHT, WIDTH), disc.texture.max())
    wall[:, round(start_x + size_px) :] = 0.3
    scene = Scene(WIDTH, HEIGHT, flight_s, wall, (disc,))
    found = tracked(scene, frames=frames_of(scene))
    overlaps = [overlap(report, truth) for time_s, report, truth in found if time_s > 0.06]
    assert min(overlaps) > 0.6
    assert np.mean(overlaps) > 0.75


@pytest.mark.parametrize("beside_px", [2, 3, 12])
@pytest.mark.parametrize("polarity", [0, 1, None])
def test_what_flickers_beside_a_box_does_not_draw_it_away(beside_px, polarity):
    box, start_ns = Box(100, 70, 20, 20), 1_000_000_000
    contours = Contours(box, start_ns, ContourConfig())
    start_up, surface = StartUp(contours), TimeSurface(WIDTH, HEIGHT)
    for number in range(1, 101):
        data = np.zeros((HEIGHT, WIDTH, 2), np.uint8)
        if number % 5 == 0:
            channel = number // 5 % 2 if polarity is None else polarity
            data[78:82, 119 + beside_px, channel] = 128
        surface.take(start_ns + number * 1_000_000, data, start_ns + (number - 1) * 1_000_000)
        if start_up.take(surface, contours.keep(surface)):
            break
    moved_px = math.dist(contours.body.pose[:2], box.center)
    assert moved_px < 4.0


def test_a_start_that_is_not_over_begins_anew_when_time_goes_back():
    way = Waypoint(0, 40, 70), Waypoint(0.5, 190, 70)
    scene = scene_of(*way, duration_s=0.5)
    frames = frames_of(scene)
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig(refine_gain=0.0))
    tracker.start("thing", scene.box("thing", 0.0), 0)
    later_ns = 100_000_000_000
    for frame in frames[:2]:
        tracker.update(frame.stamp_ns + later_ns, frame.data, start_ns=frame.start_ns + later_ns)
    for frame in frames:
        (report,) = tracker.update(frame.stamp_ns, frame.data, start_ns=frame.start_ns)
    assert overlap(report, scene.box("thing", 0.5)) > 0.8


@pytest.mark.parametrize(("strays", "is_taken"), [(0.9, False), (1.1, True)])
def test_a_start_is_not_corrected_by_less_than_its_velocity_strays(monkeypatch, strays, is_taken):
    corrected = []

    def told_apart(_motions, _events, time_s, velocity):
        corrected.append(np.array([velocity[0], velocity[1] + strays * DRAWN_MIN_PX / time_s]))
        return corrected[-1]

    monkeypatch.setattr(CoherentMotions, "told_apart", told_apart)
    scene = scene_of(Waypoint(0, 40, 70), Waypoint(0.5, 140, 70), duration_s=0.5)
    contours = Contours(scene.box("thing", 0.0), START_NS, ContourConfig())
    start, surface = StartUp(contours), TimeSurface(WIDTH, HEIGHT)
    for frame in frames_of(scene):
        surface.take(frame.stamp_ns, frame.data, frame.start_ns)
        if start.take(surface, contours.keep(surface)):
            break
    (told,) = corrected
    assert np.array_equal(contours.body.velocity, told) == is_taken


VELOCITY = 120.0, 0.0
BESIDE = Box(150, 82, 36, 36)
"""It reaches over the right third of the thing that `started_beside` starts."""


def started_beside(velocity_px_s, *, counts_all=None, monkeypatch=None):
    """The start of a checked square beside another target that has a box and moves so; nothing is in that box if it
    stands."""
    if counts_all is not None:
        monkeypatch.setattr(StartUp, "_others_go_along", lambda *_: counts_all)
    way = Waypoint(0, 140, 100), Waypoint(0.3, 140 + 0.3 * VELOCITY[0], 100)
    scene = scene_of(*way, duration_s=0.3)
    right, down = velocity_px_s
    if any(velocity_px_s):
        (x, y), picture = BESIDE.center, checks(np.random.default_rng(1), 36, 36, cell=6)
        other = Path([Waypoint(0, x, y), Waypoint(0.3, x + 0.3 * right, y + 0.3 * down)])
        scene = Scene(
            WIDTH, HEIGHT, 0.3, scene.background, (*scene.sprites, Sprite("other", picture, picture > 0, other))
        )
    contours = Contours(scene.box("thing", 0.0), START_NS, ContourConfig())
    start, surface = StartUp(contours), TimeSurface(WIDTH, HEIGHT)
    for frame in frames_of(scene):
        surface.take(frame.stamp_ns, frame.data, frame.start_ns)
        time_s = (frame.stamp_ns - START_NS) * 1e-9
        box = Box(BESIDE.x + right * time_s, BESIDE.y + down * time_s, BESIDE.w, BESIDE.h)
        contours.own.others.note(np.array([[*box, right, down]]), 0.7, frame.stamp_ns)
        if start.take(surface, contours.keep(surface)):
            break
    return start, math.dist(contours.body.velocity, VELOCITY)


def test_the_events_of_a_target_in_a_box_round_nothing_count_for_its_start():
    start, off_px_s = started_beside((0.0, 0.0))
    assert start._read is start._every
    assert len(start._own.collected.events) < 0.9 * len(start._every.collected.events)
    assert off_px_s < 15.0


@pytest.mark.parametrize("velocity_px_s", [(-100.0, -100.0), (-200.0, 0.0)])
def test_the_events_of_another_target_that_moves_otherwise_do_not_count_for_a_start(monkeypatch, velocity_px_s):
    start, off_px_s = started_beside(velocity_px_s)
    assert start._read is start._own
    _, if_all_counted_px_s = started_beside(velocity_px_s, counts_all=True, monkeypatch=monkeypatch)
    assert off_px_s < 0.3 * if_all_counted_px_s


def test_a_start_that_no_other_box_reaches_into_has_one_reading():
    contours = Contours(Box(100, 70, 20, 20), 0, ContourConfig())
    start = StartUp(contours)
    start._collect(np.ones((30, 4), np.float32), 0.01, 10_000_000)
    assert start._every is start._own is start._read


def started_in_slide(direction):
    """The start of a checked square that moves along a row, before a camera that slides in a direction."""
    scene = scene_of(Waypoint(0, 40, 70), Waypoint(0.3, 76, 70), duration_s=0.3)
    contours = Contours(scene.box("thing", 0.0), START_NS, ContourConfig())
    start, surface = StartUp(contours), TimeSurface(WIDTH, HEIGHT)
    surface.slide = Slide(direction, START_NS) if direction is not None else None
    for frame in frames_of(scene):
        surface.take(frame.stamp_ns, frame.data, frame.start_ns)
        if start.take(surface, contours.keep(surface)):
            break
    return contours


@pytest.mark.parametrize("off_deg", [0.3, -0.3])
def test_what_goes_the_way_of_all_before_a_sliding_camera_is_held_to_it_from_its_start(off_deg):
    off_rad = math.radians(off_deg)
    direction = math.cos(off_rad), math.sin(off_rad)
    contours = started_in_slide(direction)
    assert contours.slid_past.direction == direction
    right, down = contours.body.velocity
    assert math.atan2(down, right) == pytest.approx(off_rad)


@pytest.mark.parametrize("off_deg", [30, -30, 180])
def test_what_goes_otherwise_before_a_sliding_camera_starts_as_it_goes(off_deg):
    off_rad = math.radians(off_deg)
    contours = started_in_slide((math.cos(off_rad), math.sin(off_rad)))
    assert contours.slid_past.direction is None
    assert contours.body.velocity == pytest.approx(started_in_slide(None).body.velocity, abs=5.0)
