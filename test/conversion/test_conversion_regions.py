"""Where NZGE is measured."""

import numpy as np
import pytest
from conversion_oracles import assert_same_frames, closed_form, frames_of, make_events, random_events
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.boxes import Box
from etd_ros.conversion import AtsltdConfig, AtsltdConverter, FrameEnd, nzge
from etd_ros.conversion.cell_map import cell_rectangles, cells_in, count_in, make_cell_map

MS = 1_000_000
CONFIG = AtsltdConfig(entropy_region="targets", check_stride=10, max_duration_s=0.01)


@pytest.mark.parametrize(
    ("box", "cells"),
    [
        (Box(0, 0, 4, 4), 1),
        (Box(3.9, 0, 0.2, 1), 2),
        (Box(-3, -3, 4, 4), 1),
        (Box(-50, 10, 30, 30), 0),
        (Box(400, 50, 30, 30), 0),
        (Box(10, 300, 30, 30), 0),
        (Box(346, 0, 10, 10), 0),
        (Box(340, 256, 100, 100), 2),
        (Box(-1e9, -1e9, 2e9, 2e9), 87 * 65),
    ],
)
def test_cells_count_that_have_a_pixel_in_the_box(box, cells):
    store = make_cell_map(346, 260, 4, 256.0)
    count_in(store, cell_rectangles([box], 346, 260, 4), 4)
    assert cells_in(store).is_counted.sum() == cells


def test_no_boxes_count_nowhere_and_none_everywhere():
    store = make_cell_map(20, 12, 4, 256.0)
    count_in(store, cell_rectangles([], 20, 12, 4), 4)
    assert not cells_in(store).is_counted.any()
    count_in(store, cell_rectangles(None, 20, 12, 4), 4)
    assert cells_in(store).is_counted.all()


def masked(data, boxes, cell_size):
    """The data with all cells without a pixel in a box cleared."""
    keep = np.zeros(data.shape[:2], bool)
    rows, columns = np.indices(keep.shape)
    for box in boxes:
        keep |= (columns + 1 > box.x) & (columns < box.x + box.w) & (rows + 1 > box.y) & (rows < box.y + box.h)
    out = np.zeros_like(data)
    for top in range(0, data.shape[0], cell_size):
        for left in range(0, data.shape[1], cell_size):
            cell = np.s_[top : top + cell_size, left : left + cell_size]
            if keep[cell].any():
                out[cell] = data[cell]
    return out


boxes_on_sensor = st.builds(Box, st.floats(-5, 44), st.floats(-5, 36), st.floats(1, 30), st.floats(1, 30))


@given(st.integers(0, 1000), st.lists(boxes_on_sensor, min_size=1, max_size=3), st.sampled_from([2, 4, 5]))
@settings(deadline=None, max_examples=25)
def test_frames_in_regions_have_the_nzge_of_their_cells_and_all_their_events(seed, boxes, cell_size):
    events = random_events(seed, 3000, 45, 37, 30 * MS)
    config = AtsltdConfig(entropy_region="targets", check_stride=10, max_duration_s=0.01, cell_size=cell_size)
    frames = frames_of(AtsltdConverter(45, 37, config, regions=lambda: boxes), [events])
    assert frames
    first = 0
    for frame in frames:
        content = events[first : first + frame.events]
        np.testing.assert_array_equal(frame.data, closed_form(content, frame.start_ns, frame.stamp_ns))
        assert frame.nzge == pytest.approx(nzge(masked(frame.data, boxes, cell_size), cell_size), abs=1e-11)
        if frame.end is FrameEnd.NZGE:
            assert frame.nzge >= CONFIG.nzge_interval[0]
        first += frame.events


def test_regions_are_asked_for_before_each_frame_and_leave_nothing_behind():
    events = random_events(3, 8000, 48, 40, 40 * MS)
    boxes = [Box(0, 0, 16, 16), Box(20, 20, 16, 16)]
    asked = []

    def regions():
        asked.append(len(asked))
        return [boxes[len(asked) % 2]]

    frames = frames_of(AtsltdConverter(48, 40, CONFIG, regions=regions), [events])
    assert len(asked) == len(frames) + 1 > 4
    for number, frame in enumerate(frames, start=1):
        assert frame.nzge == pytest.approx(nzge(masked(frame.data, [boxes[number % 2]], 4)), abs=1e-12)


def test_a_list_of_boxes_that_is_changed_in_place_is_noticed():
    boxes = [Box(0, 0, 8, 8)]
    converter = AtsltdConverter(48, 40, CONFIG, regions=lambda: boxes)
    events = random_events(3, 4000, 48, 40, 40 * MS)
    list(converter.convert(events[:1]))
    converter.reset()
    boxes[0] = Box(16, 16, 16, 16)
    expected = frames_of(AtsltdConverter(48, 40, CONFIG, regions=lambda: [Box(16, 16, 16, 16)]), [events])
    assert_same_frames(frames_of(converter, [events]), expected)


def test_a_region_without_events_ends_its_frames_by_the_time_limit():
    events = random_events(3, 4000, 24, 40, 40 * MS)
    events = make_events(events.t, events.x, events.y, events.p, 48, 40)
    frames = frames_of(AtsltdConverter(48, 40, CONFIG, regions=lambda: [Box(28, 0, 20, 40)]), [events])
    assert {frame.end for frame in frames} == {FrameEnd.TIME_LIMIT}
    assert {frame.nzge for frame in frames} == {0.0}


@pytest.mark.parametrize("log_base", [1.001, 2.0, 1e6])
def test_sums_over_a_large_sensor_fit_whatever_the_base(log_base):
    width, height = 1280, 720
    y, x = np.divmod(np.arange(width * height), width)
    n = len(x) // 2
    t = np.arange(n) * 100
    events = make_events(t, x[::2], y[::2], np.ones(n, int), width, height)
    config = AtsltdConfig(log_base=log_base, nzge_interval=(1.0, 1.0), max_duration_s=0.04)
    frame = next(AtsltdConverter(width, height, config).convert(events))
    assert frame.nzge == pytest.approx(nzge(frame.data, log_base=log_base), rel=1e-9)
