"""The first motion of a target, on simulated scenes whose truth is exact."""

import numpy as np
import pytest
from tracked_scenes import overlap, scene_of, tracked

from etd_ros.simulation import Waypoint


@pytest.mark.parametrize("down_px", [0, 60])
@pytest.mark.parametrize("speed_px_s", [4000, 6000])
def test_what_moves_by_several_pixels_in_the_shortest_frame_is_followed_from_its_start(speed_px_s, down_px):
    flight_s = 200 / speed_px_s
    way = Waypoint(0.0, 20, 70), Waypoint(flight_s, 220, 70 + down_px)
    found = tracked(scene_of(*way, duration_s=flight_s))
    overlaps = [overlap(report, truth) for _, report, truth in found[2:]]
    assert np.mean(overlaps) > 0.9
    assert min(overlaps) > 0.75
