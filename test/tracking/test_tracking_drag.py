"""Boxes of `etd-plus` neither lag behind their targets nor are drawn along by what lies behind or covers them."""

import numpy as np
import pytest
from tracked_scenes import HEIGHT, SIZE, START_NS, WIDTH, frames_of, overlap, scene_of, tracked

from etd_ros.boxes import Box
from etd_ros.simulation import Path, Scene, Sprite, Waypoint
from etd_ros.simulation.textures import checks
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState, contours, following, memories, start_up


def lag_px(scene, frames, since_s):
    """How far the box is behind its target on average, along its motion."""
    found = tracked(scene, frames=frames)
    return float(
        np.mean([truth.center[0] - report.box.center[0] for time_s, report, truth in found if time_s > since_s])
    )


def test_a_model_is_drawn_at_the_start_from_what_looks_will_see_of_the_target(monkeypatch):
    # A soft edge of much contrast makes many events in each pixel: a look has the last of them.
    ways = Waypoint(0, 50, 90), Waypoint(1, 190, 90)
    wall = np.full((HEIGHT, WIDTH), 0.5)
    soft = np.clip(0.5 + 0.45 * np.sin(np.arange(SIZE) * 0.7)[None, :] * np.ones((SIZE, 1)), 0.02, 1)
    scene = Scene(WIDTH, HEIGHT, 1.0, wall, (Sprite("thing", soft, np.ones((SIZE, SIZE)), Path(ways)),))
    frames = frames_of(scene)
    assert lag_px(scene, frames, 0.2) < 0.5
    monkeypatch.setattr(start_up, "as_looks_see", lambda events, window_s: events)
    assert lag_px(scene, frames, 0.2) > 0.7


@pytest.mark.parametrize("seed", [0, 4])
def test_what_lies_behind_a_target_does_not_draw_its_box_along(monkeypatch, seed):
    # The camera slides past a thing that is nearer than what lies behind it, as in slider_depth.
    rng = np.random.default_rng(seed)
    behind = np.clip(0.2 + 0.7 * checks(rng, HEIGHT + 20, 3 * WIDTH, cell=7), 0.05, 1)
    size = 32
    y, x = np.mgrid[0:size, 0:size] - (size - 1) / 2
    disc = (np.hypot(x, y) < size / 2).astype(float)
    surface = 0.2 + 0.6 * checks(rng, size, size, cell=8)
    thing = Sprite("thing", surface, disc, Path((Waypoint(0, 200, 90),)), nearness=1 / 0.8)
    view = Path((Waypoint(0, 0, 0), Waypoint(1.2, 0.8 * 150, 0)))
    scene = Scene(WIDTH, HEIGHT, 1.2, behind, (thing,), view=view)
    frames = frames_of(scene)

    def mean_overlap():
        return np.mean([overlap(report, truth) for _, report, truth in tracked(scene, frames=frames)])

    with_trust = mean_overlap()
    monkeypatch.setattr(memories, "OUTSIDE_FADES", (9.0, 10.0))
    assert with_trust > mean_overlap() + 0.01


def passed_by(*, speed_px_s, cover_px_s, width, at_s, duration_s):
    """The square of `scene_of`, and something checked before it, in whose middle it is at a time."""
    cover_x = 40 + speed_px_s * at_s
    ways = (Waypoint(time_s, cover_x + cover_px_s * (time_s - at_s), 90) for time_s in (0, duration_s))
    surface = checks(np.random.default_rng(0), 90, width, cell=6)
    cover = Sprite("cover", surface, np.ones((90, width)), Path(tuple(ways)), is_target=False)
    end = Waypoint(duration_s, 40 + speed_px_s * duration_s, 90)
    return scene_of(Waypoint(0, 40, 90), end, duration_s=duration_s, cover=(cover,))


@pytest.mark.parametrize(("cover_px_s", "width", "at_s"), [(35, 30, 2.3), (40, 24, 2.2)])
def test_what_slowly_covers_a_target_neither_draws_its_box_along_nor_shrinks_it(monkeypatch, cover_px_s, width, at_s):
    scene = passed_by(speed_px_s=60, cover_px_s=cover_px_s, width=width, at_s=at_s, duration_s=2.4)
    frames = frames_of(scene)

    def at_the_end():
        _, report, truth = tracked(scene, frames=frames)[-1]
        return overlap(report, truth), report.box.w / truth.w

    seen, share = at_the_end()
    assert seen > 0.75
    assert share > 0.85
    monkeypatch.setattr(following, "COVERED_AFTER_S", 99.0)
    unseen, _ = at_the_end()
    assert unseen < 0.5


def test_the_size_of_what_is_covered_is_not_fitted(monkeypatch):
    scene = scene_of(Waypoint(0, 60, 90, 1.0), Waypoint(1, 160, 90, 1.3))
    frames = frames_of(scene)

    def growth():
        return tracked(scene, frames=frames)[-1][1].box.w / SIZE

    assert growth() > 1.2
    weigh = memories.CellTrust.weigh

    def say_covered(self, *maps, sees_covers):
        weigh(self, *maps, sees_covers=sees_covers)
        self.covered = 1.0

    monkeypatch.setattr(memories.CellTrust, "weigh", say_covered)
    assert growth() == pytest.approx(1.0, rel=0.02)


def test_what_was_covered_is_looked_for_by_all_of_it(monkeypatch):
    scene = passed_by(speed_px_s=80, cover_px_s=0, width=50, at_s=1.0, duration_s=1.9)
    frames = frames_of(scene)

    def found_again():
        _, report, truth = tracked(scene, frames=frames)[-1]
        return overlap(report, truth) > 0.9

    assert found_again()
    monkeypatch.setattr(contours.Contours, "uncover", lambda self: None)
    assert not found_again()


def test_a_start_where_nothing_moves_and_no_pixel_fires_comes_to_an_end():
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig())
    box = Box(80, 60, SIZE, SIZE)
    tracker.start("thing", box, START_NS)
    dark = np.zeros((HEIGHT, WIDTH, 2), np.uint8)
    for number in range(1, 100):
        (report,) = tracker.update(START_NS + number * 10_000_000, dark)
    assert report.state is TargetState.TRACKING
    assert report.box == box
