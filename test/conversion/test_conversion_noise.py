import numpy as np
import pytest
from conversion_oracles import DATA, cut, make_events, random_events, slider_depth_events
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.conversion import BackgroundActivityFilter, ConversionError, NoiseFilterConfig
from etd_ros.events import concatenate
from etd_ros.recordings import open_recording

US = 1000
SECOND = 10**9
WINDOW = NoiseFilterConfig(window_s=100e-6)


def literal_filter(events, window_ns):
    last = {}
    keep = []
    for t, x, y in zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), strict=True):
        neighbours = [(x + dx, y + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if (dx, dy) != (0, 0)]
        keep.append(any(t - last[n] <= window_ns for n in neighbours if n in last))
        last[x, y] = t
    return np.array(keep, bool)


@given(st.integers(0, 10_000), st.lists(st.integers(0, 400), max_size=8))
@settings(deadline=None, max_examples=40)
def test_filter_passes_what_a_neighbour_supports_however_the_events_are_cut(seed, cuts):
    events = random_events(seed, 400, 12, 9, 4000 * US)
    noise_filter = BackgroundActivityFilter(12, 9, WINDOW)
    passed = np.concatenate([noise_filter.filter(batch).to_structured() for batch in cut(events, cuts)])
    keep = literal_filter(events, 100 * US)
    assert keep.any()
    assert not keep.all()
    np.testing.assert_array_equal(passed, events.to_structured()[keep])


@given(
    st.integers(0, 10_000),
    st.sampled_from([0.5, 2.147483647, 2.147483648, 10.0]),
    st.sampled_from([SECOND // 10, 2 * SECOND, 2**31, 2**33, 2**54]),
    st.sampled_from([-(2**61), 0, 1_700_000_000 * SECOND]),
    st.lists(st.integers(0, 100), max_size=4),
)
@settings(deadline=None, max_examples=60)
def test_long_streams_gaps_and_windows_follow_the_same_definition(seed, window_s, step_ns, start_ns, cuts):
    rng = np.random.default_rng(seed)
    t = start_ns + np.cumsum(np.where(rng.random(100) < 0.7, rng.integers(0, 1000, 100), rng.integers(0, step_ns, 100)))
    x, y = rng.integers(0, 3, 100), rng.integers(0, 3, 100)
    events = make_events(t, x, y, np.ones(100), 3, 3)
    noise_filter = BackgroundActivityFilter(3, 3, NoiseFilterConfig(window_s=window_s))
    passed = np.concatenate([noise_filter.filter(batch).to_structured() for batch in cut(events, cuts)])
    keep = literal_filter(events, round(window_s * SECOND))
    np.testing.assert_array_equal(passed, events.to_structured()[keep])


@pytest.mark.parametrize("window_s", [1e-3, 10e-3])
@pytest.mark.parametrize("recording", ["slider_depth", "traffic"])
def test_real_recordings_pass_as_defined(recording, window_s):
    if recording == "slider_depth":
        events = slider_depth_events(3)
    else:
        with open_recording(DATA / "traffic" / "traffic.aedat4") as traffic:
            events = concatenate(list(traffic.events()))[:40_000]
    noise_filter = BackgroundActivityFilter(events.width, events.height, NoiseFilterConfig(window_s=window_s))
    keep = literal_filter(events, round(window_s * SECOND))
    assert 0.05 < keep.mean() < 0.99
    np.testing.assert_array_equal(noise_filter.filter(events).to_structured(), events.to_structured()[keep])


def test_what_was_handed_out_stays_when_further_batches_come():
    events = random_events(1, 4000, 12, 9, 4000 * US)
    noise_filter = BackgroundActivityFilter(12, 9, WINDOW)
    first = noise_filter.filter(events[:2000])
    before = first.to_structured()
    noise_filter.filter(events[2000:])
    np.testing.assert_array_equal(first.to_structured(), before)


def test_batch_after_batch_goes_into_the_same_arrays():
    events = random_events(2, 4000, 12, 9, 4000 * US)
    noise_filter = BackgroundActivityFilter(12, 9, WINDOW)
    batches = list(cut(events, range(200, 4000, 200)))
    addresses = {noise_filter.filter(batch).t.ctypes.data for batch in batches}
    assert len(batches) == 20
    assert len(addresses) <= 2


def test_window_includes_its_end_and_a_pixel_does_not_support_itself():
    events = make_events([0, 100 * US, 200 * US + 1, 200 * US + 2], [3, 4, 3, 3], [2, 2, 2, 2], [1, 0, 1, 1], 8, 8)
    assert BackgroundActivityFilter(8, 8, WINDOW).filter(events).t.tolist() == [100 * US]


def test_corners_of_the_sensor_are_neighbours_of_nothing_beyond():
    events = make_events([0, 1, 2, 3], [0, 7, 0, 7], [0, 0, 7, 7], [1] * 4, 8, 8)
    assert len(BackgroundActivityFilter(8, 8, WINDOW).filter(events)) == 0


def test_filter_without_a_window_is_off():
    events = random_events(0, 50, 8, 8, 1000)
    assert BackgroundActivityFilter(8, 8).filter(events) is events


def test_reset_forgets_the_neighbours():
    first, second = make_events([0], [3], [3], [1], 8, 8), make_events([1], [4], [3], [1], 8, 8)
    noise_filter = BackgroundActivityFilter(8, 8, WINDOW)
    noise_filter.filter(first)
    assert len(noise_filter.filter(second)) == 1
    noise_filter.reset()
    assert len(noise_filter.filter(second[:0])) == 0
    assert len(noise_filter.filter(second)) == 0


def test_events_of_another_sensor_are_refused():
    with pytest.raises(ConversionError, match="4x4 sensor came to a 8x8"):
        BackgroundActivityFilter(8, 8, WINDOW).filter(make_events([0], [0], [0], [1], 4, 4))


def test_a_stream_may_begin_with_the_earliest_time_there_is():
    first_ns = 1 - 2**62
    events = make_events([first_ns, first_ns + 2000 * US], [3, 4], [3, 3], [1, 1], 8, 8)
    whole, in_parts = (BackgroundActivityFilter(8, 8, NoiseFilterConfig(window_s=1e-3)) for _ in range(2))
    assert len(whole.filter(events)) == 0
    assert [len(in_parts.filter(part)) for part in (events[:1], events[1:])] == [0, 0]
