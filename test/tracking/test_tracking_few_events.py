"""What has few events in a look is looked at with those of more of its motion."""

from __future__ import annotations

import numpy as np
from tracked_scenes import START_NS, events_of, frames_from, overlap, scene_of, tracked

from etd_ros.boxes import Box
from etd_ros.simulation import Waypoint
from etd_ros.tracking import ContourConfig
from etd_ros.tracking.contours import Contours
from etd_ros.tracking.look_pace import WINDOW_MAX_PX

MANY_UNTIL_S = 0.06
KEPT = 0.015


def frames_of_few_events(scene, since_s):
    """The frames of a scene of which few events are left after a time."""
    events = events_of(scene)
    left = np.random.default_rng(3).random(len(events)) < KEPT
    kept = left | ((events.t - START_NS) * 1e-9 < since_s)
    return frames_from(events, kept)


def test_a_fast_target_whose_events_become_few_is_seen_and_followed():
    scene = scene_of(Waypoint(0.0, 30.0, 90.0), Waypoint(1.0, 1230.0, 90.0), duration_s=0.15)
    found = tracked(scene, frames=frames_of_few_events(scene, MANY_UNTIL_S))
    few = [(report, truth) for time_s, report, truth in found if time_s > MANY_UNTIL_S + 0.01]
    assert few
    assert min(report.score for report, _ in few) > 0
    assert min(overlap(report, truth) for report, truth in few) > 0.7


def contours_at(speed_px_s):
    contours = Contours(Box(50, 50, 20, 20), START_NS, ContourConfig())
    contours.body.velocity = speed_px_s, 0.0
    return contours


def test_a_look_of_few_events_has_the_next_one_take_more_motion_up_to_an_end():
    contours = contours_at(1000.0)
    stamp_ns = START_NS + 2_000_000
    assert contours.look_longer(10.0, stamp_ns), "10 in 2 px"
    assert not contours.look_longer(30.0, stamp_ns + 4_000_000), "in the 6 px that it takes now there are enough"
    assert contours.look_longer(4.0, stamp_ns)
    assert not contours.look_longer(1.0, stamp_ns + round(WINDOW_MAX_PX * 1e6)), "it takes no more than that"


def test_a_look_of_many_events_changes_nothing():
    assert not contours_at(1000.0).look_longer(40.0, START_NS + 2_000_000)
