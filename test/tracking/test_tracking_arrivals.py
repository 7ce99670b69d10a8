"""What comes in over the border that a lost target left over is seen, wherever along it that is."""

from __future__ import annotations

import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.evaluation.suite import evaluate_sequence
from etd_ros.recovery import RecoveryConfig
from etd_ros.settings import Settings
from etd_ros.simulation import sequence_named
from etd_ros.tracking import arrivals
from etd_ros.tracking.arrivals import Arrivals, Side, side_of
from etd_ros.tracking.body import Body, Standing
from etd_ros.tracking.contour_config import ContourConfig
from etd_ros.tracking.surface import TimeSurface

WIDTH, HEIGHT = 240, 180
FRAME_NS = 15_000_000
SPEED_PX_S = 200.0
CONTOURS_ALONE = Settings(
    contours=ContourConfig(refine_gain=0.0), recovery=RecoveryConfig(network_agreeing=100, watch_score_min=1.0)
)
"""A network would make up for what the contours do not find."""


def frame_of(*spots: tuple[int, int]) -> np.ndarray:
    """A frame with 6 x 6 events round each spot, as far as that is on the sensor."""
    levels = np.zeros((HEIGHT, WIDTH, 2), np.uint8)
    for x, y in spots:
        levels[max(0, y - 3) : y + 3, max(0, x - 3) : x + 3, 0] = 200
    return levels


class Watched:
    """A border, watched for a target of 20 x 20 px that left at the middle of a side."""

    def __init__(self, side: Side = Side.RIGHT, at: tuple[int, int] = (WIDTH - 1, HEIGHT // 2)) -> None:
        self.surface = TimeSurface(WIDTH, HEIGHT)
        self.surface.take(FRAME_NS, frame_of())
        body = Body(Box(at[0] - 10, at[1] - 10, 20, 20), FRAME_NS)
        self.arrivals = Arrivals(self.surface, side, body, Standing.of(body), SPEED_PX_S)

    def see(self, *spots: tuple[int, int], frames: int = 1):
        for _ in range(frames):
            self.surface.take(self.surface.stamp_ns + FRAME_NS, frame_of(*spots))
            self.arrivals.keep()
            found = self.arrivals.newest()
        return found


@pytest.mark.parametrize(
    ("side", "left_at", "comes_at", "place", "inwards"),
    [
        (Side.LEFT, (0, 90), (3, 30), (0, 30), (SPEED_PX_S, 0)),
        (Side.RIGHT, (WIDTH - 1, 90), (WIDTH - 3, 150), (WIDTH - 1, 150), (-SPEED_PX_S, 0)),
        (Side.TOP, (120, 0), (60, 3), (60, 0), (0, SPEED_PX_S)),
        (Side.BOTTOM, (120, HEIGHT - 1), (180, HEIGHT - 3), (180, HEIGHT - 1), (0, -SPEED_PX_S)),
    ],
)
def test_new_events_along_the_border_are_an_arrival_that_moves_inwards(side, left_at, comes_at, place, inwards):
    watched = Watched(side, left_at)
    assert watched.see(frames=20) is None
    found = watched.see(comes_at)
    assert (found.x, found.y) == pytest.approx(place, abs=12)
    assert found.velocity == inwards


def test_events_away_from_the_border_are_none():
    watched = Watched()
    watched.see(frames=20)
    assert watched.see((100, 90)) is None


def test_what_is_always_there_is_no_arrival_and_what_comes_in_beside_it_is():
    watched = Watched()
    always = (WIDTH - 5, 40)
    assert watched.see(always, frames=60) is None
    found = watched.see(always, (WIDTH - 3, 130))
    assert found.y == pytest.approx(130, abs=12)


def test_the_place_with_the_most_new_events_counts():
    watched = Watched()
    watched.see(frames=20)
    assert watched.see((WIDTH - 3, 40), (WIDTH - 3, 136), (WIDTH - 8, 140)).y == pytest.approx(138, abs=12)


def test_new_events_all_along_the_border_are_no_arrival():
    watched = Watched()
    watched.see(frames=20)
    assert watched.see(*((WIDTH - 3, y) for y in range(10, HEIGHT, 20))) is None


def test_it_comes_no_farther_along_the_border_than_it_may_have_moved():
    far = WIDTH - 3, HEIGHT // 2 + 70
    soon, late = Watched(), Watched()
    soon.see()
    assert soon.see(far) is None
    late.see(frames=30)
    assert late.see(far).y == pytest.approx(far[1], abs=12)


@pytest.mark.parametrize(
    ("box", "side"),
    [
        (Box(-20, 60, 30, 30), Side.LEFT),
        (Box(225, 60, 30, 30), Side.RIGHT),
        (Box(100, -5, 30, 30), Side.TOP),
        (Box(100, 170, 30, 30), Side.BOTTOM),
        (Box(225, -5, 30, 30), Side.RIGHT),
        (Box(5, 60, 30, 30), Side.LEFT),
    ],
)
def test_the_border_is_the_one_that_a_box_reaches_over_farthest(box, side):
    assert side_of(box, WIDTH, HEIGHT) is side


@pytest.mark.parametrize("seed", [6, 9])
def test_what_comes_back_elsewhere_along_the_border_is_found(monkeypatch, seed):
    scene = sequence_named("return").with_seed(seed)
    (found,) = evaluate_sequence(scene, settings=CONTOURS_ALONE)
    assert found.ar > 0.95
    monkeypatch.setattr(arrivals, "TIMES_USUAL", 1e9)
    (without,) = evaluate_sequence(scene, settings=CONTOURS_ALONE)
    assert without.ar < 0.75
