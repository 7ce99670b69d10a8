"""The first motion of a target, on simulated scenes whose truth is exact."""

import numpy as np
import pytest
from tracked_scenes import HEIGHT, WIDTH, frames_of, overlap, scene_of, tracked

from etd_ros.simulation import Path, Scene, Sprite, Waypoint


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


def test_what_makes_its_first_events_beside_its_box_is_followed_from_there():
    # It is as bright as the wall's left part, and shows only before the right one.
    size_px, start_x, speed_px_s = 24, 30, 800
    way = Waypoint(0.0, start_x, 90), Waypoint(0.2, start_x + 0.2 * speed_px_s, 90)
    disc = plain_disc(size_px, way).sprites[0]
    wall = np.full((HEIGHT, WIDTH), disc.texture.max())
    wall[:, start_x + size_px :] = 0.3
    scene = Scene(WIDTH, HEIGHT, 0.2, wall, (disc,))
    found = tracked(scene, frames=frames_of(scene))
    overlaps = [overlap(report, truth) for time_s, report, truth in found if time_s > 0.06]
    assert min(overlaps) > 0.6
    assert np.mean(overlaps) > 0.75
