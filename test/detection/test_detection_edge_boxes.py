"""EdgeBoxes proposals near a last box."""

from __future__ import annotations

import resource
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.boxes import Box, iou
from etd_ros.detection import DetectionError, EdgeBoxes, EdgeBoxesConfig, admissibility
from etd_ros.detection.edge_boxes import refit
from etd_ros.parameters import ParameterError

LAMBDA = 0.7


def contour_frame(box, *, thickness=1, value=255, width=240, height=180):
    """A frame with the outline of a box, split between the channels."""
    frame = np.zeros((height, width, 2), np.uint8)
    x, y, w, h = (int(number) for number in box)
    outline = np.zeros((height, width), np.uint8)
    cv2.rectangle(outline, (x, y), (x + w - 1, y + h - 1), value, thickness)
    frame[: y + h // 2, :, 0] = outline[: y + h // 2]
    frame[y + h // 2 :, :, 1] = outline[y + h // 2 :]
    return frame


def cluttered_frame(seed, width=240, height=180):
    """A frame with many outlines and noise."""
    random = np.random.default_rng(seed)
    frame = np.zeros((height, width, 2), np.uint8)
    for _ in range(60):
        x, y = (int(random.integers(0, side)) for side in (width, height))
        w, h = (int(side) for side in random.integers(8, 60, 2))
        channel = np.zeros((height, width), np.uint8)
        cv2.rectangle(channel, (x, y), (x + w, y + h), int(random.integers(40, 256)), int(random.integers(1, 4)))
        frame[..., int(random.integers(2))] |= channel
    noise = random.random(frame.shape) < 0.005
    frame[noise] = 200
    return frame


def corners(box):
    """Left, top, right, bottom."""
    x, y, w, h = box
    return np.array([x, y, x + w, y + h])


def best(proposals):
    return proposals.boxes[np.argmax(proposals.scores)]


@pytest.mark.parametrize("box", [Box(80, 60, 40, 40), Box(30, 20, 60, 30), Box(150, 90, 24, 50), Box(0, 0, 40, 40)])
@pytest.mark.parametrize("thickness", [1, 2])
def test_a_contour_is_found_within_2_pixels(box, thickness):
    last = Box(box.x + 3, box.y - 2, box.w, box.h)
    found = EdgeBoxes().propose(contour_frame(box, thickness=thickness), last, admissibility_min=LAMBDA)
    assert np.abs(corners(best(found)) - corners(box)).max() <= 2


@pytest.mark.parametrize("value", [255, 60, 12, 1])
def test_a_faint_contour_is_found_as_well(value):
    box = Box(80, 60, 40, 40)
    found = EdgeBoxes().propose(contour_frame(box, value=value), box)
    assert iou(best(found)[None], box)[0] > 0.85


def test_refitted_boxes_are_tighter_than_raw_ones():
    box = Box(80, 60, 40, 40)
    frame = contour_frame(box)
    raw, fitted = (
        best(EdgeBoxes(EdgeBoxesConfig(refit_boxes=refit_boxes)).propose(frame, box)) for refit_boxes in (False, True)
    )
    assert fitted.tolist() == list(box)
    assert iou(raw[None], box)[0] < 1


def test_an_empty_frame_has_no_proposals():
    found = EdgeBoxes().propose(np.zeros((180, 240, 2), np.uint8), Box(10, 10, 40, 40))
    assert len(found) == 0
    assert found.boxes.shape == (0, 4)


def test_events_outside_the_search_region_bring_no_proposals():
    frame = contour_frame(Box(150, 100, 40, 40))
    assert len(EdgeBoxes().propose(frame, Box(10, 10, 40, 40))) == 0


@pytest.mark.parametrize(
    "last", [Box(-500, 0, 40, 40), Box(239.9, 20, 0.1, 40), Box(-1e300, -1e300, 2e300, 2e300), Box(1, 1, 1e-6, 1e-6)]
)
def test_regions_of_absurd_place_or_size_are_survived(last):
    found = EdgeBoxes().propose(cluttered_frame(0), last, admissibility_min=LAMBDA)
    assert len(found) == 0


def test_a_target_larger_than_the_sensor_is_searched_on_the_whole_sensor():
    found = EdgeBoxes().propose(cluttered_frame(1), Box(-30, -20, 300, 220))
    assert len(found) > 0
    assert found.boxes[:, 2].max() <= 240 + 6


def test_a_large_region_is_searched_at_half_size():
    box = Box(60, 40, 300, 260)
    frame = contour_frame(box, thickness=2, width=640, height=480)
    found = EdgeBoxes(EdgeBoxesConfig(max_region_side=250)).propose(frame, box, admissibility_min=LAMBDA)
    assert np.abs(best(found) - box).max() <= 4


@settings(deadline=None, max_examples=60)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(2, 60),
    st.integers(2, 60),
    st.floats(0, 1),
    st.builds(Box, st.floats(-40, 60), st.floats(-40, 60), st.floats(0.5, 90), st.floats(0.5, 90)),
    st.booleans(),
)
def test_any_frame_gives_boxes_with_an_area_and_falling_scores(seed, width, height, density, last, fit):
    random = np.random.default_rng(seed)
    frame = random.integers(0, 256, (height, width, 2)).astype(np.uint8)
    frame[random.random((height, width)) > density] = 0
    config = EdgeBoxesConfig(refit_boxes=fit, min_box_area=25.0)
    found = EdgeBoxes(config).propose(frame, last)
    assert np.isfinite(found.boxes).all()
    assert (found.boxes[:, 2:] > 0).all()
    assert (np.diff(found.scores) <= 0).all()
    assert len(found) <= config.max_boxes


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("last", [Box(100, 70, 40, 40), Box(60, 40, 77, 77), Box(90, 60, 50, 25)])
def test_leaving_out_small_windows_does_not_change_what_passes(seed, last):
    frame = cluttered_frame(seed)
    everything = EdgeBoxes(EdgeBoxesConfig(max_boxes=10_000)).propose(frame, last)
    restricted = EdgeBoxes().propose(frame, last, admissibility_min=LAMBDA)
    passing = [boxes[admissibility(boxes, last) > LAMBDA] for boxes in (everything.boxes, restricted.boxes)]
    assert len(restricted) < len(everything)
    np.testing.assert_array_equal(*passing)


def test_the_same_frame_gives_the_same_proposals():
    frame, last = cluttered_frame(3), Box(90, 60, 60, 60)
    detector = EdgeBoxes()
    first = detector.propose(frame, last)
    detector.propose(cluttered_frame(4), last)
    again = detector.propose(frame, last)
    np.testing.assert_array_equal(first.boxes, again.boxes)
    np.testing.assert_array_equal(first.scores, again.scores)


def test_memory_does_not_grow_with_the_number_of_calls():
    detector, frame, last = EdgeBoxes(), cluttered_frame(5), Box(90, 60, 24, 24)

    def resident_kib():
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * resource.getpagesize() // 1024

    def call(times):
        for _ in range(times):
            detector.propose(frame, last, admissibility_min=LAMBDA)
        return resident_kib()

    settled = call(200)
    assert call(1500) - settled < 1500  # a reused cv2 object leaks 3 KiB and more a call


def test_the_frame_is_left_as_it_was():
    frame = cluttered_frame(6)
    before = frame.copy()
    EdgeBoxes().propose(frame, Box(90, 60, 60, 60))
    np.testing.assert_array_equal(frame, before)


@pytest.mark.parametrize(
    "frame", [np.zeros((10, 10), np.uint8), np.zeros((10, 10, 3), np.uint8), np.zeros((10, 10, 2), np.float32)]
)
def test_frames_of_another_form_are_refused(frame):
    with pytest.raises(DetectionError, match="uint8"):
        EdgeBoxes().propose(frame, Box(1, 1, 4, 4))


def test_an_opencv_without_contrib_is_named(monkeypatch):
    monkeypatch.delattr(cv2, "ximgproc")
    with pytest.raises(DetectionError, match="opencv-contrib-python"):
        EdgeBoxes()


def test_a_search_region_smaller_than_the_target_is_refused():
    with pytest.raises(ParameterError, match="search_scale"):
        EdgeBoxesConfig(search_scale=0.5)


@settings(deadline=None, max_examples=60)
@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.tuples(*[st.integers(-30, 30)] * 2, *[st.integers(1, 40)] * 2), min_size=1, max_size=4),
)
def test_refit_gives_the_bounding_box_of_the_events_inside(seed, boxes):
    random = np.random.default_rng(seed)
    events = (random.random((20, 25)) < 0.02).astype(np.uint8)
    for box, fitted in zip(boxes, refit(np.array(boxes, np.int64), events), strict=True):
        x, y, w, h = box
        rows, columns = np.nonzero(events)
        inside = (columns >= x) & (columns < x + w) & (rows >= y) & (rows < y + h)
        if not inside.any():
            assert tuple(fitted) == box
            continue
        rows, columns = rows[inside], columns[inside]
        assert tuple(fitted) == (columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1)
