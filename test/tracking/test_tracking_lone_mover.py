"""What is fast and bounces off something is followed on, whichever way it goes then, if nothing else moves near it."""

import numpy as np
import pytest
from tracked_scenes import HEIGHT, WIDTH, overlap, pillar, tracked

from etd_ros.simulation import Path, Scene, Sprite
from etd_ros.simulation.textures import checks, smooth_noise
from etd_ros.tracking import TargetState
from etd_ros.tracking.lone_mover import LoneMover

BOUNCES_S, UNTIL_S, SIZE_PX = 0.25, 0.5, 20


def bouncing(before_px_s, after_px_s, *others):
    """A dark ball that changes its velocity (right, down) at once, in the middle of a plain wall."""
    before, after = np.array(before_px_s)[:, None], np.array(after_px_s)[:, None]

    def way(t):
        t = np.atleast_1d(np.asarray(t, float))
        x, y = (
            np.array([[140.0], [90.0]]) + np.minimum(t - BOUNCES_S, 0) * before + np.maximum(t - BOUNCES_S, 0) * after
        )
        return x, y

    from_middle = np.arange(SIZE_PX) - (SIZE_PX - 1) / 2
    disc = np.clip(SIZE_PX / 2 - np.hypot(from_middle[:, None], from_middle) + 0.5, 0, 1)
    ball = Sprite("thing", np.full(disc.shape, 0.15), disc, Path.of(way, UNTIL_S))
    wall = 0.6 + 0.02 * smooth_noise(np.random.default_rng(5), HEIGHT, WIDTH)
    return Scene(WIDTH, HEIGHT, UNTIL_S, wall, (ball, *others))


@pytest.mark.parametrize(
    ("before_px_s", "after_px_s"),
    [((400, 280), (-300, 250)), ((400, 250), (350, -250)), ((450, 0), (-400, 0))],
    ids=["off a wall", "off the floor", "straight back"],
)
def test_what_bounces_is_followed_on_at_once(before_px_s, after_px_s):
    found = tracked(bouncing(before_px_s, after_px_s))
    assert {report.state for _, report, _ in found} == {TargetState.TRACKING}
    after = [overlap(report, truth) for time_s, report, truth in found if time_s > BOUNCES_S + 0.02]
    assert min(after) > 0.6
    assert np.mean(after) > 0.8


def test_looks_alone_lose_what_bounces(monkeypatch):
    monkeypatch.setattr(LoneMover, "found", lambda *_, **__: None)
    _, report, truth = tracked(bouncing((400, 280), (-300, 250)))[-1]
    assert overlap(report, truth) < 0.1


def test_what_goes_another_way_beside_a_target_that_has_gone_behind_something_is_not_the_target():
    passing = Sprite(
        "passing",
        checks(np.random.default_rng(3), 40, 40, cell=8),
        np.ones((40, 40)),
        Path.of(lambda t: (104 + 0 * t, 300 * t - 20), UNTIL_S),
        is_target=False,
    )
    found = tracked(bouncing((400, 0), (400, 0), pillar(160), passing))
    for time_s, report, _ in found:
        if report.box is not None and time_s > 0.2:
            middle_y = report.box.y + report.box.h / 2
            assert abs(middle_y - HEIGHT / 2) < SIZE_PX
