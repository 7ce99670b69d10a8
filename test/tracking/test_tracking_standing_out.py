"""What a search has found is believed only where it stands out, and at the border only if it comes in."""

import math

import pytest

from etd_ros.boxes import Box
from etd_ros.tracking import contour_search
from etd_ros.tracking.arrivals import Side
from etd_ros.tracking.body import Standing
from etd_ros.tracking.camera_slide import Slide
from etd_ros.tracking.contour_config import ContourConfig
from etd_ros.tracking.contour_search import COAST_S, LATE_TIMES, ContourSearch, _Place, _Seen, _WideLook
from etd_ros.tracking.contours import Contours
from etd_ros.tracking.expected_place import CONFIRM_NS, SEARCH_NS
from etd_ros.tracking.look import Look
from etd_ros.tracking.standing_out import share_elsewhere
from etd_ros.tracking.surface import TimeSurface
from etd_ros.tracking.usual_looks import UsualLooks

WIDTH, HEIGHT = 240, 180
FOUND = Look(20.0, 90.0, 1.0, 100.0, 1.0, (1.0, 0.0))


class Agreements:
    """Stands in for contours: they agree at certain places (x, y), by a score each, and nowhere else."""

    def __init__(self, scores):
        self._scores = scores

    def look_at(self, _surface, x, y, radius_px):
        near = [(score, place) for place, score in self._scores.items() if math.dist(place, (x, y)) <= radius_px]
        score, place = max(near, default=(0.01, (x, y)))
        return Look(*place, score, 100.0, 1.0, (1.0, 0.0))


def usual_of(score):
    usual = UsualLooks()
    usual.learn(Look(0.0, 0.0, score, 100.0, 1.0, (1.0, 0.0)))
    return usual


@pytest.mark.parametrize(
    ("elsewhere", "share"),
    [
        ({}, 0.01),
        ({(116.0, 80.0): 0.5}, 0.5),
        ({(100.0, 62.0): 0.9, (116.0, 80.0): 0.5}, 0.9),
        ({(89.0, 91.0): 1.2}, 1.2),
        ({(150.0, 80.0): 0.9}, 0.01),
    ],
    ids=["nowhere", "beside", "at several places", "better, across", "far away"],
)
def test_what_stands_out_is_told_by_the_best_place_round_it(elsewhere, share):
    contours = Agreements({(101.0, 80.0): 1.0, **elsewhere})
    found = share_elsewhere(contours, TimeSurface(WIDTH, HEIGHT), usual_of(2.0), 100.0, 80.0, math.inf)
    assert found == pytest.approx(share)


def test_places_round_it_are_sought_until_one_is_enough():
    contours = Agreements({(101.0, 80.0): 1.0, (85.0, 80.0): 0.8, (117.0, 80.0): 0.9})
    shares = [
        share_elsewhere(contours, TimeSurface(WIDTH, HEIGHT), usual_of(2.0), 100.0, 80.0, enough)
        for enough in (0.75, 0.85)
    ]
    assert shares == pytest.approx([0.8, 0.9])


def search_at_left_border(*, has_left, goes_with_all=False):
    contours = Contours(Box(0.0, 70.0, 40.0, 40.0), 0, ContourConfig())
    contours.body.velocity = -100.0, 0.0
    contours.slid_past.direction = (-1.0, 0.0) if goes_with_all else None
    before = Standing.of(contours.body)
    surface = TimeSurface(WIDTH, HEIGHT)
    left_over = Side.LEFT if has_left else None
    return ContourSearch(contours, surface, UsualLooks(), before, 100.0, 0, left_over=left_over, has_gap=False)


def seen(velocity, *, come_px=10.0):
    """Two looks at what has come inwards by so much."""
    return [_Seen(0, FOUND.x - off_px, FOUND.y, velocity, 1.0, 1.0) for off_px in (come_px, 0.0)]


@pytest.mark.parametrize(
    ("velocity", "comes_in"), [((80.0, 0.0), True), ((60.0, 60.0), True), ((5.0, 80.0), False), ((-80.0, 0.0), False)]
)
def test_what_comes_along_the_border_is_not_what_left_over_it(monkeypatch, velocity, comes_in):
    monkeypatch.setattr(contour_search, "share_elsewhere", lambda *_: 0.0)
    search = search_at_left_border(has_left=True)
    search._path = seen(velocity)
    assert search._is_it(FOUND, patience=1.0) is comes_in


@pytest.mark.parametrize("come_px", [-5.0, 0.0, 2.0])
def test_what_has_hardly_come_in_since_it_was_seen_first_is_not_what_left(monkeypatch, come_px):
    monkeypatch.setattr(contour_search, "share_elsewhere", lambda *_: 0.0)
    search = search_at_left_border(has_left=True)
    search._path = seen((80.0, 0.0), come_px=come_px)
    assert not search._is_it(FOUND, patience=1.0)


@pytest.mark.parametrize(
    ("stood_still", "slides", "is_it"),
    [(True, (-1.0, 0.0), False), (True, (1.0, 0.0), True), (True, None, True), (False, (-1.0, 0.0), True)],
)
def test_what_stood_still_does_not_come_back_while_the_camera_slides_on(monkeypatch, stood_still, slides, is_it):
    monkeypatch.setattr(contour_search, "share_elsewhere", lambda *_: 0.0)
    search = search_at_left_border(has_left=True, goes_with_all=stood_still)
    search._path = seen((80.0, 0.0))
    search._surface.slide = slides and Slide(slides, 0)
    assert search._is_it(FOUND, patience=1.0) is is_it


@pytest.mark.parametrize(
    ("has_left", "share", "is_it"), [(False, 0.74, True), (False, 0.76, False), (True, 0.89, True), (True, 0.91, False)]
)
def test_it_has_to_stand_out_less_clearly_at_the_border(monkeypatch, has_left, share, is_it):
    monkeypatch.setattr(contour_search, "share_elsewhere", lambda *_: share)
    search = search_at_left_border(has_left=has_left)
    search._path = seen((80.0, 0.0))
    body = search._contours.body
    pose, velocity = body.pose, body.velocity
    assert search._is_it(FOUND, patience=1.0) is is_it
    assert (body.pose, body.velocity) == (pose, velocity)


@pytest.mark.parametrize(("patience", "is_asked_again"), [(1.0, True), (3.0, False)])
def test_one_of_many_is_compared_with_what_is_round_it_less_often(monkeypatch, patience, is_asked_again):
    monkeypatch.setattr(contour_search, "share_elsewhere", lambda *_: 0.0)
    search = search_at_left_border(has_left=False)
    search._path = seen((80.0, 0.0))
    found = []
    for stamp_ns in (0, CONFIRM_NS, 2 * CONFIRM_NS):
        search._surface.stamp_ns = stamp_ns
        found.append(search._is_it(FOUND, patience))
    assert found == [True, is_asked_again, True]


@pytest.mark.parametrize("has_left", [False, True])
def test_one_of_many_that_was_lost_long_ago_is_looked_for_less_often_unless_it_has_left(has_left):
    search = search_at_left_border(has_left=has_left)
    waits_ns = {}
    for since_s in (0.1, COAST_S + 0.1):
        search._surface.stamp_ns = round(since_s * 1e9)
        search.wait()
        for patience in (1.0, 1.5, 3.0):
            waits_ns[since_s, patience] = search.next_ns(patience) - search._surface.stamp_ns
    soon, late = ([waits_ns[since_s, patience] / SEARCH_NS for patience in (1.0, 1.5, 3.0)] for since_s in (0.1, 0.6))
    assert soon == [1.0, 1.5, 3.0]
    assert late == (soon if has_left else [1.0, 1.5**2, 3.0 * LATE_TIMES])


@pytest.mark.parametrize(
    ("has_left", "wanted"),
    [(False, contour_search.CONFIDENCE_FOUND_HERE), (True, contour_search.CONFIDENCE_FOUND)],
)
def test_at_the_border_it_has_to_be_as_sure_as_anywhere(has_left, wanted):
    search = search_at_left_border(has_left=has_left)
    search._begin(_WideLook(FOUND, _Place(20.0, 90.0, (0.0, 0.0), 0.1), is_here=True))
    assert search._wanted == wanted
