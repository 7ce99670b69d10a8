"""Boxes of `etd-plus` neither lag behind their targets nor are drawn along by what lies behind them."""

import numpy as np
import pytest
from tracked_scenes import HEIGHT, SIZE, START_NS, WIDTH, frames_of, overlap, tracked

from etd_ros.boxes import Box
from etd_ros.simulation import Path, Scene, Sprite, Waypoint
from etd_ros.simulation.textures import checks
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState, contours, start_up


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
    monkeypatch.setattr(start_up, "_as_looks_see", lambda events, window_s: events)
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
    monkeypatch.setattr(contours, "OUTSIDE_FADES", (9.0, 10.0))
    assert with_trust > mean_overlap() + 0.015


def test_a_start_where_nothing_moves_and_no_pixel_fires_comes_to_an_end():
    tracker = MultiTracker(WIDTH, HEIGHT, contours=ContourConfig())
    box = Box(80, 60, SIZE, SIZE)
    tracker.start("thing", box, START_NS)
    dark = np.zeros((HEIGHT, WIDTH, 2), np.uint8)
    for number in range(1, 100):
        (report,) = tracker.update(START_NS + number * 10_000_000, dark)
    assert report.state is TargetState.TRACKING
    assert report.box == box
