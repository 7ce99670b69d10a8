"""Targets that started by themselves on parts of one object go on with all of it, and those on two objects do not."""

from __future__ import annotations

import pytest

from etd_ros.boxes import Box
from etd_ros.tracking.auto_candidates import Candidate
from etd_ros.tracking.clusters import Sighting
from etd_ros.tracking.own_targets import OwnTarget, OwnTargets
from etd_ros.tracking.parts import Whole, wholes
from etd_ros.tracking.target import TargetReport, TargetState

LOOK_NS = 30_000_000
CAR = Box(0, 20, 60, 30)
WHEEL, OTHER_WHEEL = Box(5, 40, 12, 10), Box(43, 40, 12, 10)


def moved(box: Box, x: float) -> Box:
    return Box(box.x + x, box.y, box.w, box.h)


class Street:
    """What is seen and what is followed, look by look, both at 100 pixels/s unless it is said otherwise."""

    def __init__(self, seen: Box | None) -> None:
        self.look = 0
        self.seen = seen
        self._own = OwnTargets()
        self._candidate: Candidate | None = None

    def next(self, *, others=(), speeds=(100, 100), **boxes: Box) -> list[Whole]:
        """The wholes of the next look, at which the targets of these names have moved on from these first boxes."""
        self.look += 1
        stamp_ns, time_s = self.look * LOOK_NS, self.look * LOOK_NS * 1e-9
        reports = [
            TargetReport(name, TargetState.TRACKING, moved(box, speed * time_s), 1.0)
            for (name, box), speed in zip(boxes.items(), speeds, strict=False)
        ]
        own = self._own.take(stamp_ns, reports)
        if self.seen is None:
            return wholes([], own, others)
        sighting = Sighting(moved(self.seen, 100 * time_s), (100.0, 0.0), 1.0)
        if self._candidate is None:
            self._candidate = Candidate(sighting, stamp_ns, stamp_ns, sighting.box.center)
        else:
            self._candidate.see(sighting, stamp_ns)
        return wholes([self._candidate], own, others)

    def until_found(self, looks: int = 60, **what) -> list[Whole]:
        """The wholes of the first of so many looks that finds any."""
        return next((found for _ in range(looks) if (found := self.next(**what))), [])


def test_a_car_whose_wheel_was_started_first_gets_the_target_when_it_was_seen_in_four_looks():
    street = Street(CAR)
    [whole] = street.until_found(auto_1=WHEEL)
    assert street.look == 4
    assert whole.names == ["auto_1"]
    assert whole.box.iou(moved(CAR, 100 * 4 * LOOK_NS * 1e-9)) == pytest.approx(1)


def test_a_car_with_two_targets_on_it_keeps_the_older_one():
    [whole] = Street(CAR).until_found(auto_1=OTHER_WHEEL, auto_2=WHEEL)
    assert whole.names == ["auto_1", "auto_2"]


def test_a_target_on_nearly_all_of_it_stays_as_it_is():
    assert not Street(CAR).until_found(auto_1=Box(5, 22, 50, 27))


def test_what_is_seen_larger_now_and_then_is_no_whole():
    street = Street(CAR)
    outside = Box(70, 40, 12, 10)
    for look in range(30):
        assert not street.next(auto_1=WHEEL if look % 4 else outside)


def test_two_that_pass_one_another_stay_two_though_they_are_seen_as_one():
    assert not Street(CAR).until_found(15, auto_1=WHEEL, auto_2=OTHER_WHEEL, speeds=(100, 30))


def test_two_that_came_from_afar_stay_two_though_they_move_as_one_now():
    street, meets_s = Street(None), 5 * LOOK_NS * 1e-9
    for _ in range(5):
        street.next(auto_1=WHEEL, auto_2=moved(OTHER_WHEEL, 300 * meets_s), speeds=(100, -200))
    street.seen = CAR
    assert not street.until_found(30, auto_1=WHEEL, auto_2=OTHER_WHEEL)


def test_what_was_followed_for_long_by_itself_is_no_part():
    street = Street(None)
    for _ in range(60):
        street.next(auto_1=WHEEL)
    street.seen = CAR
    assert not street.until_found(auto_1=WHEEL)


def test_a_target_that_somebody_started_in_it_keeps_it_from_being_a_whole():
    street = Street(CAR)
    for look in range(1, 20):
        mine = moved(OTHER_WHEEL, 100 * look * LOOK_NS * 1e-9)
        assert not street.next(auto_1=WHEEL, others=[mine])


def test_what_goes_on_from_another_box_has_no_way_behind_it():
    targets = OwnTargets()
    report = TargetReport("auto_1", TargetState.TRACKING, WHEEL, 1.0)
    targets.take(1, [report])
    targets.begin_again("auto_1")
    [target] = targets.take(500_000_001, [report])
    assert target.way == {500_000_001: WHEEL.center}
    assert target.velocity == (0, 0)
    assert target.age_s == 0.5


def test_velocities_are_those_of_the_last_tenth_of_a_second():
    way = {look * 50_000_000: (float(max(0, look - 8) * 5), 0.0) for look in range(11)}
    assert OwnTarget("auto_1", WHEEL, 0.5, way).velocity == pytest.approx((100, 0))
