import numpy as np
import pytest
from conversion_oracles import (
    assert_same_frames,
    closed_form,
    cut,
    frames_of,
    histogram_nzge,
    make_events,
    random_events,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.conversion import (
    ConversionError,
    FixedCountConfig,
    FixedCountConverter,
    FixedWindowConfig,
    FixedWindowConverter,
    FrameEnd,
)

MS = 1_000_000
CONVERTERS = {
    "window": lambda: FixedWindowConverter(18, 13, FixedWindowConfig(window_s=0.001)),
    "count": lambda: FixedCountConverter(18, 13, FixedCountConfig(count=37, max_duration_s=0.0006)),
}


def test_windows_are_aligned_to_the_first_event_and_hold_their_end():
    t = [5, 5 + 9 * MS, 5 + 9 * MS + 1, 5 + 18 * MS, 5 + 40 * MS, 5 + 46 * MS]
    frames = frames_of(FixedWindowConverter(6, 4), [make_events(t, range(6), [0] * 6, [1] * 6, 6, 4)])
    assert [((f.start_ns - 5) / MS, (f.stamp_ns - 5) / MS, f.events, f.end) for f in frames] == [
        (0, 9, 2, FrameEnd.WINDOW),
        (9, 18, 2, FrameEnd.WINDOW),
        (36, 45, 1, FrameEnd.WINDOW),
    ]
    assert frames[0].data[0, :, 0].tolist() == [1, 255, 0, 0, 0, 0]


def test_count_frames_hold_the_count_and_end_with_their_last_event():
    events = random_events(1, 100, 18, 13, 5 * MS)
    frames = frames_of(FixedCountConverter(18, 13, FixedCountConfig(count=30)), [events])
    assert [(f.stamp_ns, f.events, f.end) for f in frames] == [
        (int(events.t[k - 1]), 30, FrameEnd.COUNT) for k in (30, 60, 90)
    ]


def test_count_frames_end_by_the_time_limit_in_quiet_scenes():
    events = make_events([0, 5 * MS, 500 * MS, 601 * MS], [0, 1, 2, 3], [0] * 4, [1] * 4, 4, 4)
    frames = frames_of(FixedCountConverter(4, 4), [events])
    assert [(f.start_ns, f.stamp_ns, f.events, f.end) for f in frames] == [
        (0, 100 * MS, 2, FrameEnd.TIME_LIMIT),
        (500 * MS, 600 * MS, 1, FrameEnd.TIME_LIMIT),
    ]


@pytest.mark.parametrize("kind", CONVERTERS)
def test_frames_hold_the_closed_form_of_their_events(kind):
    events = random_events(2, 3000, 18, 13, 20 * MS)
    frames = frames_of(CONVERTERS[kind](), [events])
    assert len(frames) > 10
    first = 0
    for frame in frames:
        content = events[first : first + frame.events]
        np.testing.assert_array_equal(frame.data, closed_form(content, frame.start_ns, frame.stamp_ns))
        assert frame.nzge == pytest.approx(histogram_nzge(frame.data), abs=1e-12)
        first += frame.events


@pytest.mark.parametrize("kind", CONVERTERS)
@given(seed=st.integers(0, 1000), cuts=st.lists(st.integers(0, 600), max_size=10))
@settings(deadline=None, max_examples=30)
def test_frames_do_not_depend_on_batches(kind, seed, cuts):
    events = random_events(seed, 600, 18, 13, 10 * MS)
    whole = frames_of(CONVERTERS[kind](), [events])
    assert whole
    assert_same_frames(frames_of(CONVERTERS[kind](), cut(events, cuts)), whole)


@pytest.mark.parametrize("kind", CONVERTERS)
def test_reset_starts_a_new_stream(kind):
    events = random_events(3, 600, 18, 13, 10 * MS)
    converter = CONVERTERS[kind]()
    fresh = frames_of(converter, [events])
    converter.reset()
    assert_same_frames(frames_of(converter, [events]), fresh)


@pytest.mark.parametrize("kind", CONVERTERS)
def test_events_of_another_sensor_are_refused(kind):
    with pytest.raises(ConversionError, match="4x4 sensor came to a 18x13"):
        CONVERTERS[kind]().convert(make_events([0], [0], [0], [1], 4, 4))
