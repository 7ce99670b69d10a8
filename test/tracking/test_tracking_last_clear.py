"""What passes before a target, and is no target itself, draws its box along for a moment only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tracked_scenes import HEIGHT, START_NS, WIDTH, frames_of, overlap, tracked

from etd_ros.simulation import Path, Scene, Sprite, Waypoint
from etd_ros.simulation.textures import checks, smooth_noise
from etd_ros.tracking import ContourConfig, TargetState, last_clear
from etd_ros.tracking.body import Standing
from etd_ros.tracking.camera_slide import CameraSlide
from etd_ros.tracking.contours import Contours
from etd_ros.tracking.last_clear import (
    CLEAR_NS,
    NEAR_SIZES,
    NOTE_NS,
    SEEN_MIN,
    SETTLED_NS,
    STRAYED_MAX,
    STRAYED_TIMES,
    LastClear,
)

SIZE_PX = 34
PASSING = {
    "larger, the other way": (60.0, 1.2, -80.0, 60, 90.0),
    "as large, the other way": (60.0, 1.2, -80.0, 34, 90.0),
    "a little lower": (60.0, 1.4, -60.0, 50, 100.0),
    "it overtakes": (50.0, 1.4, 150.0, 60, 80.0),
}
"""The target's speed (pixels/s) and how long the scene lasts (s); speed, size and row (pixels) of what passes."""


def passed(speed_px_s, duration_s, passing_px_s, size_px, row):
    """A checked square that something else passes in the middle of the time, before a smooth wall."""
    rng = np.random.default_rng(0)
    wall = 0.5 + 0.05 * smooth_noise(rng, HEIGHT, WIDTH)
    ways = (("thing", SIZE_PX, speed_px_s, 90.0), ("passing", size_px, passing_px_s, row))
    sprites = []
    for name, size, speed, down in ways:
        reach = speed * duration_s / 2
        path = Path((Waypoint(0, WIDTH / 2 - reach, down), Waypoint(duration_s, WIDTH / 2 + reach, down)))
        surface = checks(rng, size, size, cell=8 if size == SIZE_PX else 10)
        sprites.append(Sprite(name, surface, np.ones(surface.shape), path, is_target=name == "thing"))
    return Scene(WIDTH, HEIGHT, duration_s, wall, tuple(sprites))


@pytest.mark.parametrize("way", PASSING.values(), ids=PASSING)
def test_what_something_passes_is_followed_on_its_own_way_again(monkeypatch, way):
    scene = passed(*way)
    frames = frames_of(scene)
    _, report, truth = tracked(scene, frames=frames)[-1]
    assert overlap(report, truth) > 0.85
    monkeypatch.setattr(LastClear, "has_strayed", False)
    _, report, truth = tracked(scene, frames=frames)[-1]
    assert overlap(report, truth) < 0.1


def test_what_leaves_with_something_else_is_looked_for_where_it_was_clear(monkeypatch):
    # Several, as a rounding may decide over one.
    ways = [
        (55.0, 150.0, 60, 80.0),
        *((50.0, *way) for way in [(150.0, 70, 80.0), (160.0, 60, 80.0), (180.0, 60, 80.0)]),
    ]
    scenes = [passed(speed_px_s, 2.4, *way) for speed_px_s, *way in ways]
    monkeypatch.setattr(LastClear, "found_elsewhere", lambda *_: None)
    ends = [tracked(scene)[-1] for scene in scenes]
    assert sum(overlap(report, truth) > 0.85 for _, report, truth in ends) >= 3
    monkeypatch.setattr(LastClear, "has_strayed", False)
    states = [tracked(scene)[-1][1].state for scene in scenes]
    assert states.count(TargetState.LOST) >= 3


STOPPED_S, PASSED_S, STANDS_S = 1.0, 1.4, 2.4
"""When the thing has come to a halt, when something else is over it, and until when both are watched."""


def stood(*, brakes, goes_on=False):
    """A checked square that comes to a halt, brakes before it does or stops at once, and is passed; perhaps it goes on
    the way it came."""
    rng = np.random.default_rng(0)
    wall = 0.5 + 0.05 * smooth_noise(rng, HEIGHT, WIDTH)
    halted_x = WIDTH / 2
    slow = (Waypoint(0.8, halted_x - 6, 90), Waypoint(0.9, halted_x - 1, 90)) if brakes else ()
    further = (Waypoint(STANDS_S, halted_x, 90), Waypoint(STANDS_S + 0.6, halted_x + 30, 90)) if goes_on else ()
    path = Path((Waypoint(0, halted_x - 60, 90), *slow, Waypoint(STOPPED_S, halted_x, 90), *further))
    duration_s = STANDS_S + 0.6 * goes_on
    far_px = 300 * (PASSED_S - 0.9)
    passing = Path(
        (Waypoint(0.9, halted_x - far_px, 98), Waypoint(duration_s, halted_x + 300 * (duration_s - PASSED_S), 98))
    )
    ways = (("thing", SIZE_PX, path, 8), ("passing", SIZE_PX + 4, passing, 10))
    sprites = []
    for name, size, way, cell in ways:
        surface = checks(rng, size, size, cell=cell)
        sprites.append(Sprite(name, surface, np.ones(surface.shape), way, is_target=name == "thing"))
    return Scene(WIDTH, HEIGHT, duration_s, wall, tuple(sprites))


@pytest.mark.parametrize("brakes", [True, False], ids=["it brakes", "it stops at once"])
def test_what_stands_is_there_still_when_something_has_passed_before_it(brakes):
    *_, (_, report, truth) = tracked(stood(brakes=brakes))
    assert report.state is TargetState.TRACKING
    assert overlap(report, truth) > 0.85


def test_what_brakes_and_stands_would_be_lost_to_what_passes_if_nobody_knew_that_it_stood(monkeypatch):
    monkeypatch.setattr(LastClear, "stand", lambda self: None)
    # What passes goes the way that the thing came: both are taken for what a camera slides past, which helps as well.
    monkeypatch.setattr(CameraSlide, "slide", None)
    *_, (_, report, truth) = tracked(stood(brakes=True))
    assert overlap(report, truth) < 0.5


@pytest.mark.parametrize("brakes", [True, False], ids=["it brakes", "it stops at once"])
def test_what_was_passed_while_it_stood_is_followed_when_it_goes_on(brakes):
    *_, (_, report, truth) = tracked(stood(brakes=brakes, goes_on=True))
    assert overlap(report, truth) > 0.85


class Looks:
    """What looks at a target say.

    Attributes:
        confidence: of the last one.
        seen_as_before: how surely it is seen as it looked when it was clear.
    """

    def __init__(self, body):
        self.body = body
        self.confidence, self.seen_as_before = 1.0, 1.0
        self.usual = "what is usual"

    def confidence_as(self, _impression, _x, _y):
        return self.seen_as_before


@pytest.fixture
def seen():
    """Looks, and what takes one every NOTE_NS: sure ones, unless it is told otherwise."""
    contours = contours_at_once()
    looks = Looks(contours.body)
    clear = LastClear(contours, None, looks)
    stamps = iter(range(START_NS, START_NS + 100 * SETTLED_NS, NOTE_NS))

    def take(times=1, *, is_sure=True):
        for _ in range(times):
            contours.body.stamp_ns = next(stamps)
            clear.take(contours.body.stamp_ns, is_sure=is_sure)

    return looks, clear, take


def contours_at_once():
    """Contours of a target that moves to the right, all of which is known."""
    scene = passed(*PASSING["it overtakes"])
    contours = Contours(scene.box("thing", 0.0), START_NS, ContourConfig())
    contours.body.velocity = 100.0, 0.0
    contours.known_as = lambda _impression: 1.0
    return contours


def test_a_target_is_clear_while_no_look_doubts_it(seen):
    _, clear, take = seen
    take(3)
    standing = clear.sighting.standing
    assert isinstance(standing, Standing)
    take()
    assert clear.sighting.standing.stamp_ns == standing.stamp_ns + NOTE_NS
    take(is_sure=False)
    assert clear.sighting.standing.stamp_ns == standing.stamp_ns + NOTE_NS
    assert not clear.has_strayed


def test_what_looks_otherwise_after_doubts_has_strayed(seen):
    looks, clear, take = seen
    take()
    take(is_sure=False)
    looks.seen_as_before = STRAYED_MAX - 0.01
    take(STRAYED_TIMES - 1)
    assert not clear.has_strayed
    take()
    assert clear.has_strayed
    looks.seen_as_before = STRAYED_MAX
    take()
    assert not clear.has_strayed


@pytest.mark.parametrize(("down_px_s", "has_strayed"), [(0.0, False), (900.0, True)], ids=["on", "otherwise"])
def test_what_is_fast_and_flies_on_has_not_strayed_though_it_looks_otherwise(seen, down_px_s, has_strayed):
    looks, clear, take = seen
    looks.body.velocity = 2000.0, 0.0
    take()
    take(is_sure=False)
    looks.seen_as_before = 0.0
    looks.body.velocity = 2000.0, down_px_s
    take(STRAYED_TIMES)
    assert clear.has_strayed == has_strayed


def test_what_looks_as_before_is_clear_again_soon(seen):
    looks, clear, take = seen
    take()
    stamp_ns = clear.sighting.standing.stamp_ns
    take(is_sure=False)
    looks.seen_as_before = SEEN_MIN + 0.01
    take(CLEAR_NS // NOTE_NS)
    assert clear.sighting.standing.stamp_ns == stamp_ns
    take()
    assert clear.sighting.standing.stamp_ns > stamp_ns


def test_what_looks_otherwise_for_long_is_the_target(seen):
    looks, clear, take = seen
    take()
    stamp_ns = clear.sighting.standing.stamp_ns
    take(is_sure=False)
    looks.seen_as_before = 0.0
    take(SETTLED_NS // NOTE_NS)
    assert clear.has_strayed
    assert clear.sighting.standing.stamp_ns == stamp_ns
    take()
    assert not clear.has_strayed
    assert clear.sighting.standing.stamp_ns > stamp_ns


def test_a_sure_look_that_is_not_one_of_the_surest_notes_nothing(seen):
    looks, clear, take = seen
    looks.confidence = 0.8
    take(5)
    assert clear.sighting is None


def test_what_is_doubted_is_looked_for_elsewhere_only_once_it_has_strayed(seen):
    _, clear, take = seen
    take()
    take(is_sure=False)
    assert clear.found_elsewhere() is None


def moved(standing, right_px):
    x, y, scale, angle_rad = standing.pose
    return replace(standing, pose=(x + right_px, y, scale, angle_rad))


def standing(clear, take):
    """What has come to a halt where it was clear."""
    take()
    clear.stand()
    assert clear.stood is not None


@pytest.mark.parametrize(("alone", "stands"), [(True, False), (False, True)], ids=["it sets off", "something passes"])
def test_what_moves_where_a_target_stood_is_the_target_if_it_began_to_there(seen, monkeypatch, alone, stands):
    _, clear, take = seen
    standing(clear, take)
    monkeypatch.setattr(last_clear, "stands_alone", lambda *_: alone)
    take(is_sure=False)
    assert (clear.stood is not None) is stands


def test_what_moves_elsewhere_than_where_a_target_stood_has_not_set_off_from_there(seen, monkeypatch):
    _, clear, take = seen
    standing(clear, take)
    monkeypatch.setattr(last_clear, "stands_alone", lambda *_: True)
    clear.stood = moved(clear.stood, NEAR_SIZES * SIZE_PX)
    take(is_sure=False)
    assert clear.stood is not None


def test_what_halts_far_from_where_it_was_clear_is_not_said_to_stand(seen):
    _, clear, take = seen
    take()
    clear.sighting = replace(clear.sighting, standing=moved(clear.sighting.standing, NEAR_SIZES * SIZE_PX))
    clear.stand()
    assert clear.stood is None


def test_what_is_found_while_a_target_stands_has_to_look_as_it_did(seen):
    looks, clear, take = seen
    standing(clear, take)
    looks.seen_as_before = SEEN_MIN
    assert not clear.believe(0.0, 0.0)
    looks.seen_as_before = SEEN_MIN + 0.01
    assert clear.believe(0.0, 0.0)
    looks.seen_as_before = 0.0
    assert not clear.believe(0.0, 0.0)
    clear.forget_where_it_stood()
    assert clear.believe(0.0, 0.0)


@pytest.mark.parametrize(("speed_px_s", "moved_on"), [(100.0, True), (0.0, False)])
def test_what_vanished_on_its_way_may_be_found_where_that_brings_it(seen, speed_px_s, moved_on):
    looks, clear, take = seen
    standing(clear, take)
    looks.seen_as_before = 0.0
    clear.stood = replace(clear.stood, velocity=(speed_px_s, 0.0))
    assert clear.believe(0.0, 0.0, is_expected=True) is moved_on
    assert (clear.stood is None) is moved_on


def test_what_is_clear_again_does_not_stand_where_it_stood(seen, monkeypatch):
    _, clear, take = seen
    standing(clear, take)
    monkeypatch.setattr(last_clear, "stands_alone", lambda *_: False)
    take(is_sure=False)
    take(CLEAR_NS // NOTE_NS + 1)
    assert clear.stood is None
