"""What passes before a target, and is no target itself, draws its box along for a moment only."""

from __future__ import annotations

import numpy as np
import pytest
from tracked_scenes import HEIGHT, START_NS, WIDTH, frames_of, overlap, tracked

from etd_ros.simulation import Path, Scene, Sprite, Waypoint
from etd_ros.simulation.textures import checks, smooth_noise
from etd_ros.tracking import ContourConfig, TargetState
from etd_ros.tracking.body import Standing
from etd_ros.tracking.contours import Contours
from etd_ros.tracking.last_clear import (
    CLEAR_NS,
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
    scene = passed(50.0, 2.4, 150.0, 60, 80.0)
    frames = frames_of(scene)
    monkeypatch.setattr(LastClear, "found_elsewhere", lambda self: None)
    *_, (_, report, truth) = tracked(scene, frames=frames)
    assert overlap(report, truth) > 0.85
    monkeypatch.setattr(LastClear, "has_strayed", False)
    *_, (_, report, _) = tracked(scene, frames=frames)
    assert report.state is TargetState.LOST


class Looks:
    """What looks at a target say.

    Attributes:
        confidence: of the last one.
        seen_as_before: how surely it is seen as it looked when it was clear.
    """

    def __init__(self):
        self.confidence, self.seen_as_before = 1.0, 1.0
        self.usual = "what is usual"

    def confidence_as(self, _impression, _x, _y):
        return self.seen_as_before


@pytest.fixture
def seen():
    """Looks, and what takes one every NOTE_NS: sure ones, unless it is told otherwise."""
    looks = Looks()
    contours = contours_at_once()
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
    contours.body.velocity[:] = 100.0, 0.0
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
