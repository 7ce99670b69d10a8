"""What turns round at once, as from a wall, is followed on."""

import pytest
from tracked_scenes import overlap, scene_of, tracked

from etd_ros.simulation import Waypoint
from etd_ros.tracking import TargetState


def there_and_back(speed_px_s):
    turns_s = 90 / speed_px_s
    ways = Waypoint(0, 60, 90), Waypoint(turns_s, 150, 90), Waypoint(2 * turns_s, 60, 90)
    return scene_of(*ways, duration_s=2 * turns_s)


@pytest.mark.parametrize("speed_px_s", [60, 300, 800])
def test_what_turns_round_at_once_is_followed_back(speed_px_s):
    _, report, truth = tracked(there_and_back(speed_px_s))[-1]
    assert report.state is TargetState.TRACKING
    assert overlap(report, truth) > 0.8
