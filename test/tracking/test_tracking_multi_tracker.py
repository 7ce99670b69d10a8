"""Targets on synthetic frames: squares whose outlines move."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from etd_ros.boxes import Box, BoxError, iou
from etd_ros.recovery import Found
from etd_ros.tracking import MultiTracker, TargetReport, TargetState, TrackerConfig, TrackingError
from etd_ros.tracking.target import LOOP_FRAME_NS

WIDTH, HEIGHT = 240, 180
FRAME_NS = 10_000_000
START_NS = 1_000_000_000
IMAGE = np.full((HEIGHT, WIDTH), 127, np.uint8)
EMPTY = np.zeros((HEIGHT, WIDTH, 2), np.uint8)

IDLE, TRACKING, RECOVERING, LOST = TargetState


class ListedRecovery:
    """A recovery tracker that answers from a list and notes what it was asked."""

    has_lead = False

    def __init__(self, answers=()):
        self.answers = list(answers)
        self.remembered = []
        self.searched = []

    def remember(self, image, box):
        self.remembered.append(box)

    def search(self, image, last_box):
        self.searched.append(last_box)
        return self.answers.pop(0) if self.answers else None

    def look_wider(self):
        pass

    def watch(self):
        return None


def frame_with(*boxes):
    """A frame with the outlines of boxes in both channels."""
    outlines = np.zeros((HEIGHT, WIDTH), np.uint8)
    for box in boxes:
        x, y, w, h = (int(number) for number in box)
        cv2.rectangle(outlines, (x, y), (x + w - 1, y + h - 1), 255, 1)
    return np.stack([outlines, outlines], axis=2)


def moved(box, step, speed=(2, 1)):
    return Box(box.x + step * speed[0], box.y + step * speed[1], box.w, box.h)


def stamp(step):
    return START_NS + step * FRAME_NS


def tracker_with(recovery=None, **parameters):
    factory = None if recovery is None else lambda: recovery
    return MultiTracker(WIDTH, HEIGHT, TrackerConfig(**parameters), None, factory)


A, B, C = Box(20, 20, 40, 40), Box(120, 20, 50, 30), Box(60, 100, 30, 44)


def test_a_moving_square_is_followed():
    tracker = tracker_with()
    tracker.start("a", A)
    for step in range(1, 30):
        (report,) = tracker.update(stamp(step), frame_with(moved(A, step)))
        assert report.state is TRACKING
        assert report.score > 0.7
        assert iou(np.array([report.box]), moved(A, step))[0] > 0.9


def test_many_targets_are_each_tracked_as_if_alone():
    boxes = {"a": A, "b": B, "c": C}
    frames = [frame_with(*(moved(box, step) for box in boxes.values())) for step in range(1, 15)]

    def run(names):
        tracker = tracker_with()
        for name in names:
            tracker.start(name, boxes[name])
        return [tracker.update(stamp(step), frame) for step, frame in enumerate(frames)]

    together = run(["c", "a", "b"])
    assert [report.name for report in together[0]] == ["c", "a", "b"]
    assert [tuple(reports) for reports in zip(*together, strict=True)] == [
        tuple(report for (report,) in run([name])) for name in ("c", "a", "b")
    ]


def test_a_target_without_events_does_not_disturb_the_others():
    tracker = tracker_with()
    tracker.start("gone", C)
    tracker.start("a", A)
    for step in range(1, 6):
        gone, a = tracker.update(stamp(step), frame_with(moved(A, step)))
    assert (gone, a.state) == (TargetReport("gone", LOST, None, 0.0), TRACKING)


def test_a_target_is_idle_until_the_first_frame_at_or_after_its_stamp():
    tracker = tracker_with()
    tracker.start("a", A, stamp(2))
    states = [tracker.update(stamp(step), frame_with(A))[0] for step in (0, 1, 2)]
    assert [report.state for report in states] == [IDLE, IDLE, TRACKING]
    assert [report.box is None for report in states] == [True, True, False]


def test_without_recovery_a_failure_is_final():
    tracker = tracker_with()
    tracker.start("a", A)
    assert [
        tracker.update(stamp(step), frame, IMAGE)[0].state for step, frame in enumerate((EMPTY, frame_with(A)))
    ] == [
        LOST,
        LOST,
    ]


def test_a_best_candidate_that_hardly_overlaps_is_a_failure():
    tracker = tracker_with(failure_iou=0.95)
    tracker.start("a", A)
    assert tracker.update(stamp(1), frame_with(moved(A, 3)))[0].state is LOST


def test_a_failed_target_is_found_again_under_its_name():
    recovery = ListedRecovery([None, None, Found(B, 0.8)])
    tracker = tracker_with(recovery)
    tracker.start("a", A)
    reports = [tracker.update(stamp(step), EMPTY, IMAGE)[0] for step in range(3)]
    assert [report.state for report in reports] == [RECOVERING, RECOVERING, TRACKING]
    assert reports[-1] == TargetReport("a", TRACKING, B, 0.8)
    assert recovery.searched == [A, A, A]
    assert tracker.update(stamp(3), frame_with(B), IMAGE)[0].box == B


def test_a_target_not_found_for_long_is_lost_and_searched_now_and_then():
    recovery = ListedRecovery()
    tracker = tracker_with(recovery, recovering_max_s=0.025, lost_search_interval=3)
    tracker.start("a", A)
    states, searches = [], []
    for step in range(10):
        states.append(tracker.update(stamp(step), EMPTY, IMAGE)[0].state)
        searches.append(len(recovery.searched))
    assert states == [RECOVERING] * 3 + [LOST] * 7
    assert np.diff(searches).tolist() == [1, 1, 0, 0, 1, 0, 0, 1, 0]


def test_what_may_be_a_lost_target_is_looked_at_again_on_the_next_frame():
    recovery = ListedRecovery()
    tracker = tracker_with(recovery, recovering_max_s=0.0, lost_search_interval=5)
    tracker.start("a", A)
    searches = []
    for step in range(9):
        recovery.has_lead = step == 6
        tracker.update(stamp(step), EMPTY, IMAGE)
        searches.append(len(recovery.searched))
    assert searches == [1, 1, 1, 1, 1, 2, 3, 3, 3]


def test_a_lost_target_is_found_again():
    recovery = ListedRecovery([None, Found(B, 0.6)])
    tracker = tracker_with(recovery, recovering_max_s=0.0, lost_search_interval=2)
    tracker.start("a", A)
    states = [tracker.update(stamp(step), EMPTY, IMAGE)[0].state for step in range(3)]
    assert states == [RECOVERING, LOST, TRACKING]


def test_frames_without_an_image_are_not_searched():
    recovery = ListedRecovery([Found(B, 0.8)])
    tracker = tracker_with(recovery)
    tracker.start("a", A)
    states = [tracker.update(stamp(step), EMPTY, image)[0].state for step, image in enumerate((None, None, IMAGE))]
    assert states == [RECOVERING, RECOVERING, TRACKING]
    assert recovery.remembered == []


def test_the_recovery_tracker_sees_the_start_and_every_tracked_frame():
    recovery = ListedRecovery()
    tracker = tracker_with(recovery)
    tracker.start("a", A, stamp(1))
    for step in range(10):
        tracker.update(stamp(step), frame_with(A), IMAGE)
    assert recovery.remembered == [A] * 9


def test_each_target_has_a_recovery_tracker_of_its_own():
    made = []

    def make():
        made.append(ListedRecovery())
        return made[-1]

    tracker = MultiTracker(WIDTH, HEIGHT, recovery_factory=make)
    tracker.start("a", A)
    tracker.start("b", B)
    tracker.update(stamp(1), frame_with(A, B), IMAGE)
    assert [recovery.remembered for recovery in made] == [[A], [B]]


def test_time_going_back_starts_stamped_targets_again_and_keeps_the_others():
    tracker = tracker_with()
    tracker.start("stamped", A, stamp(2))
    tracker.start("now", B)
    first = [tracker.update(stamp(step), frame_with(moved(A, step - 1), moved(B, step))) for step in range(1, 9)]
    second = [tracker.update(stamp(step), frame_with(moved(A, step - 1), moved(B, 8))) for step in range(1, 9)]
    assert second[0][0] == TargetReport("stamped", IDLE, None, 0.0)
    assert [stamped for stamped, _ in second] == [stamped for stamped, _ in first]
    assert all(iou(np.array([now.box]), moved(B, 8))[0] > 0.9 for _, now in second)


@pytest.mark.parametrize("wrong", [(0,), (0, 1), (1, 0)])
def test_a_stamped_target_goes_on_after_messages_with_a_wrong_stamp(wrong):
    tracker = tracker_with()
    tracker.start("stamped", A, stamp(2))
    for step in range(2, 9):
        tracker.update(stamp(step), frame_with(moved(A, step)))
    for step in wrong:
        assert tracker.update(stamp(step), frame_with(moved(A, 9)))[0].state is IDLE
    (report,) = tracker.update(stamp(10), frame_with(moved(A, 9)))
    assert iou(np.array([report.box]), moved(A, 9))[0] > 0.9


def test_a_target_that_was_stopped_or_put_elsewhere_meanwhile_does_not_come_back():
    tracker = tracker_with()
    tracker.start("stopped", A, stamp(2))
    tracker.start("elsewhere", A, stamp(2))
    for step in (3, 4, 0):
        tracker.update(stamp(step), frame_with(A))
    tracker.stop("stopped")
    tracker.start_again("elsewhere", C, stamp(2))
    (report,) = tracker.update(stamp(5), frame_with(C))
    assert iou(np.array([report.box]), C)[0] > 0.9


def test_a_stamped_target_goes_on_where_time_goes_back_to_after_its_start():
    tracker = tracker_with()
    tracker.start("stamped", A, stamp(1))
    for step in range(1, 9):
        tracker.update(stamp(step) + LOOP_FRAME_NS, frame_with(moved(A, step)))
    (report,) = tracker.update(stamp(2) + LOOP_FRAME_NS, frame_with(moved(A, 9)))
    assert iou(np.array([report.box]), moved(A, 9))[0] > 0.9


def test_after_time_went_back_a_recovering_target_has_the_full_time_again():
    recovery = ListedRecovery()
    tracker = tracker_with(recovery, recovering_max_s=0.025)
    tracker.start("a", A)
    states = [tracker.update(stamp(step), EMPTY, IMAGE)[0].state for step in (5, 6, 0, 1, 2, 3)]
    assert states == [RECOVERING] * 5 + [LOST]


def test_a_stopped_target_is_no_longer_reported_and_may_start_again():
    tracker = tracker_with()
    tracker.start("a", A)
    tracker.start("b", B)
    tracker.stop("a")
    assert list(tracker.targets) == ["b"]
    tracker.start("a", C)
    assert [report.name for report in tracker.update(stamp(1), frame_with(B, C))] == ["b", "a"]


def test_stopping_an_unknown_target_lists_the_known_ones():
    tracker = tracker_with()
    tracker.start("car", A)
    with pytest.raises(TrackingError, match="'cat'.*car"):
        tracker.stop("cat")


def test_a_name_is_started_once():
    tracker = tracker_with()
    tracker.start("a", A)
    with pytest.raises(TrackingError, match="already"):
        tracker.start("a", B)


@pytest.mark.parametrize("name", ["", "x" * 65, "a,b", "a\nb", "a\tb", "\x00", "a\u2028b"])
def test_names_that_would_break_a_table_are_refused(name):
    with pytest.raises(TrackingError, match="name"):
        tracker_with().start(name, A)


@pytest.mark.parametrize("name", ["a", "x" * 64, "left car", "Käfer-1"])
def test_other_names_are_taken(name):
    tracker = tracker_with()
    tracker.start(name, A)
    assert name in tracker.targets


@pytest.mark.parametrize(
    "box",
    [
        Box(0, 0, 0, 10),
        Box(500, 0, 10, 10),
        Box(float("nan"), 0, 10, 10),
        Box(9, 9, 1, 10),
        Box(-1, -1, WIDTH + 2, HEIGHT + 2),
    ],
)
def test_impossible_boxes_are_refused_and_leave_no_target(box):
    tracker = tracker_with()
    with pytest.raises(BoxError, match="'a'"):
        tracker.start("a", box)
    assert not tracker.targets


def test_a_target_starts_again_at_another_box_and_goes_on_where_that_is_refused():
    tracker = tracker_with()
    tracker.start_again("a", A)
    tracker.start_again("a", B)
    for wrong in (Box(500, 0, 10, 10), Box(0, 0, 1, 1)):
        with pytest.raises(BoxError, match="'a'"):
            tracker.start_again("a", wrong)
    (report,) = tracker.update(stamp(1), frame_with(A, B))
    assert report.state is TRACKING
    assert iou(np.array([report.box]), B)[0] > 0.9


def test_a_negative_stamp_is_refused():
    with pytest.raises(TrackingError, match="-1 ns"):
        tracker_with().start("a", A, -1)


@pytest.mark.parametrize(
    ("frame", "image", "what"),
    [
        (np.zeros((HEIGHT, WIDTH), np.uint8), None, "frame"),
        (np.zeros((WIDTH, HEIGHT, 2), np.uint8), None, "frame"),
        (EMPTY.astype(np.int16), None, "frame"),
        (EMPTY, np.zeros((10, 10), np.uint8), "image"),
        (EMPTY, IMAGE.astype(np.float32), "image"),
    ],
)
def test_pixels_of_another_form_are_refused(frame, image, what):
    with pytest.raises(TrackingError, match=what):
        tracker_with().update(stamp(0), frame, image)


def test_a_sensor_without_targets_gives_no_reports():
    assert tracker_with().update(stamp(0), EMPTY, IMAGE) == ()
