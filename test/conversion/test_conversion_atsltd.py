import dataclasses
import math

import numpy as np
import pytest
from conversion_oracles import (
    assert_same_frames,
    closed_form,
    cut,
    first_check_that_reaches,
    frames_of,
    histogram_nzge,
    levels_of,
    literal_atsltd,
    make_events,
    random_events,
    slider_depth_events,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.conversion import AtsltdConfig, AtsltdConverter, BackgroundActivityFilter, ConversionError, FrameEnd, nzge
from etd_ros.conversion.accumulator import FrameAccumulator
from etd_ros.conversion.atsltd import NZGE_MIN
from etd_ros.conversion.cell_map import BLOCK_EVENTS
from etd_ros.events import Events, concatenate
from etd_ros.parameters import ParameterError

MS = 1_000_000


def summary(frames):
    return [(f.start_ns, f.stamp_ns, f.events, f.end.value) for f in frames]


def frame_at_end(events, cell_size=4):
    """The frame of all events, from the first one's time to the last one's."""
    accumulator = FrameAccumulator(events.width, events.height, cell_size)
    accumulator.accept(events)
    accumulator.add(events, 0, len(events), int(events.t[-1]))
    return accumulator.finish(int(events.t[-1]), FrameEnd.NZGE)


def recursion(events, *, rounding):
    """The paper's equation 2, literally, with times relative to the frame's start."""
    data = np.zeros((events.height, events.width, 2))
    t = (events.t - events.t[0]).astype(float)
    for k in range(len(events)):
        if t[k] > 0:
            data *= t[k - 1] / t[k]
        if rounding:
            data = np.round(data)
        data[events.y[k], events.x[k], 1 - events.p[k]] = 255
    return data


def test_frame_holds_the_closed_form_with_on_events_in_channel_0():
    events = random_events(1, 3000, 30, 22, 5 * MS)
    frame = frame_at_end(events)
    np.testing.assert_array_equal(frame.data, closed_form(events, frame.start_ns, frame.stamp_ns))
    assert frame.data.max() == 255


@given(st.integers(0, 2**32), st.integers(2, 60), st.integers(1, 2000))
@settings(deadline=None, max_examples=30)
def test_recursion_without_rounding_in_between_equals_the_closed_form(seed, n, duration_ns):
    events = random_events(seed, n, 6, 5, duration_ns)
    if events.t[0] == events.t[-1]:
        events.t[-1] += 1
    data = frame_at_end(events).data.astype(float)
    literal = recursion(events, rounding=False)
    held = data > 0
    # At the very start the recursion gives 0 where a frame says 1: "an event".
    np.testing.assert_allclose(data[held], np.maximum(literal[held], 1), atol=0.5 + 1e-6)
    assert not literal[~held].any()


@pytest.mark.parametrize(("n", "drift_min", "drift_max"), [(60, 1, 40), (4000, 100, 200)])
def test_recursion_that_rounds_at_every_event_freezes_and_drifts_with_the_number_of_events(n, drift_min, drift_max):
    events = random_events(2, n, 40, 30, 20 * MS)
    drift = np.abs(recursion(events, rounding=True) - frame_at_end(events).data)
    assert drift_min < drift.max() < drift_max


def test_events_at_the_start_do_not_vanish():
    frame = frame_at_end(make_events([5, 5, 1005], [0, 1, 2], [0, 0, 0], [1, 0, 1], 4, 4))
    assert frame.data[0].tolist() == [[1, 0], [0, 1], [255, 0], [0, 0]]


def test_all_events_of_a_frame_without_duration_are_255():
    assert set(np.unique(frame_at_end(random_events(3, 50, 8, 8, 1)).data)) == {0, 255}


@given(
    seed=st.integers(0, 1000),
    moments=st.integers(1, 6),
    cell_size=st.sampled_from([2, 3, 4, 5, 8]),
    polarities=st.sampled_from([(0,), (1,), (0, 1)]),
)
@settings(deadline=None, max_examples=60)
def test_a_full_frame_of_few_moments_has_the_nzge_of_its_levels(seed, moments, cell_size, polarities):
    rng = np.random.default_rng(seed)
    width, height = 18, 13
    pixels = np.tile(np.arange(width * height), (moments, 1))
    y, x = np.divmod(rng.permuted(pixels, axis=1).ravel(), width)
    # All pixels fire at each moment, in patches of equal times; some fire alone.
    patch = (x // 4 + y // 4) % 2
    t = np.repeat(np.arange(moments), width * height) * MS + patch * int(rng.integers(0, MS))
    t = np.where(rng.random(len(t)) < rng.uniform(0, 0.3), rng.integers(0, moments * MS, len(t)), t)
    order = np.argsort(t, kind="stable")
    p = rng.choice(polarities, len(t))
    events = make_events(t[order], x[order], y[order], p[order], width, height)
    frame = frame_at_end(events, cell_size)
    np.testing.assert_array_equal(frame.data, closed_form(events, frame.start_ns, frame.stamp_ns))
    assert frame.nzge == pytest.approx(histogram_nzge(frame.data, cell_size), abs=1e-12)


@pytest.mark.parametrize(("width", "height"), [(32, 24), (33, 25), (30, 23), (1, 1), (3, 2)])
def test_frames_follow_the_definition_event_by_event_on_any_sensor_size(width, height):
    events = random_events(4, 4000, width, height, 40 * MS)
    config = AtsltdConfig(check_stride=20, max_duration_s=0.004)
    frames = frames_of(AtsltdConverter(width, height, config), [events])
    assert summary(frames) == literal_atsltd(events, alpha=0.0832, max_duration_ns=4 * MS, stride=20)
    first = 0
    for frame in frames:
        assert frame.nzge == pytest.approx(histogram_nzge(frame.data), abs=1e-12)
        content = events[first : first + frame.events]
        np.testing.assert_array_equal(frame.data, closed_form(content, frame.start_ns, frame.stamp_ns))
        first += frame.events


@pytest.mark.parametrize("cell_size", [2, 3, 5, 8, 13, 16])
def test_cells_of_any_size_give_the_frames_and_nzge_of_the_definition(cell_size):
    events = random_events(8, 6000, 45, 37, 20 * MS)
    frames = frames_of(AtsltdConverter(45, 37, AtsltdConfig(cell_size=cell_size, check_stride=10)), [events])
    assert len(frames) > 2
    first = 0
    for frame in frames:
        content = events[first : first + frame.events]
        np.testing.assert_array_equal(frame.data, closed_form(content, frame.start_ns, frame.stamp_ns))
        assert frame.nzge == pytest.approx(histogram_nzge(frame.data, cell_size), abs=1e-12)
        assert frame.nzge == pytest.approx(nzge(frame.data, cell_size), abs=1e-12)
        assert frame.nzge >= 0.0832
        first += frame.events
        before = events[first - frame.events : first - 40]
        if len(before):
            assert histogram_nzge(closed_form(before, frame.start_ns, int(before.t[-1])), cell_size) < 0.0832


def test_cells_full_of_one_level_do_not_count():
    y, x = np.divmod(np.arange(16), 4)
    for polarities in ([1], [0], [0, 1]):
        t = [0] * 16 * len(polarities) + [1000]
        events = make_events(
            t,
            [*np.tile(x, len(polarities)), 6],
            [*np.tile(y, len(polarities)), 6],
            [*np.repeat(polarities, 16), 1],
            8,
            8,
        )
        frame = frame_at_end(events)
        assert frame.nzge == pytest.approx(histogram_nzge(frame.data), abs=1e-12)
        assert frame.nzge == pytest.approx(nzge(frame.data), abs=1e-12)


def with_flash(events, lit, seed=0):
    """Events after all pixels of `lit` have had one at the same time."""
    y, x = np.nonzero(lit)
    n = len(x)
    first_ns = int(events.t[0]) - 1000
    return make_events(
        np.concatenate([np.full(n, first_ns), events.t]),
        np.concatenate([x, events.x]),
        np.concatenate([y, events.y]),
        np.concatenate([np.ones(n, int), events.p]),
        events.width,
        events.height,
    )


def lit_part(kind, width, height):
    lit = np.zeros((height, width), bool)
    if kind == "panel":
        lit[: height // 6] = True
    elif kind == "stripes":
        lit[:, ::32] = lit[:, 1::32] = lit[:, 2::32] = lit[:, 3::32] = True
    elif kind == "one cell":
        lit[:4, :4] = True
    return lit


@pytest.mark.parametrize("kind", ["nothing", "panel", "stripes", "one cell"])
@pytest.mark.parametrize("alpha", [0.02, 0.0832, 0.2, 0.26, 0.35])
def test_frames_end_within_an_eighth_of_their_events_of_the_definition_whatever_flashes(kind, alpha):
    events = with_flash(random_events(11, 60_000, 160, 96, 20 * MS), lit_part(kind, 160, 96))
    config = AtsltdConfig(nzge_interval=(alpha, 1.0), max_duration_s=1.0)
    plain = first_check_that_reaches(events, alpha=alpha, stride=50)
    frame = next(AtsltdConverter(160, 96, config).convert(events), None)
    if plain is None:
        assert frame is None
    else:
        assert plain <= frame.events <= plain * 9 / 8 + 2 * 50


@pytest.mark.parametrize("kind", ["nothing", "panel", "stripes"])
def test_so_do_frames_after_others_that_lost_less_or_more(kind):
    quiet = random_events(12, 60_000, 160, 96, 20 * MS)
    flashing = with_flash(random_events(13, 60_000, 160, 96, 20 * MS), lit_part(kind, 160, 96))
    flashing.t[:] += quiet.t[-1] - flashing.t[0] + 1000
    events = concatenate([quiet, flashing])
    first = 0
    frames = list(AtsltdConverter(160, 96, AtsltdConfig(max_duration_s=1.0)).convert(events))
    assert len(frames) >= 8
    for frame in frames:
        content = events[first : first + frame.events]
        first += frame.events
        checks = range(50, frame.events + 1, 50)
        plain = next(n for n in checks if nzge(levels_of(content[:n], frame.start_ns)) >= 0.0832)
        assert frame.events <= plain * 9 / 8 + 2 * 50


def test_after_a_reset_nothing_is_expected_of_a_frame():
    plain = random_events(12, 60_000, 160, 96, 20 * MS)
    # Of few levels, so that all frames lose much, and as much as each other.
    coarse = dataclasses.replace(plain, t=plain.t // 100_000 * 100_000)
    converter = AtsltdConverter(160, 96)
    assert len(frames_of(converter, [coarse])) >= 3
    converter.reset()
    assert_same_frames(frames_of(converter, [plain]), frames_of(AtsltdConverter(160, 96), [plain]))


def test_exact_halves_are_rounded_up():
    frame = frame_at_end(make_events([0, 1001, 2002], [0, 1, 2], [0, 0, 0], [1, 1, 1], 4, 4))
    assert frame.data[0, :3, 0].tolist() == [1, 128, 255]


def test_frames_of_slider_depth_follow_the_definition():
    events = slider_depth_events(3)[:16_000]
    frames = frames_of(AtsltdConverter(240, 180), [events])
    assert len(frames) >= 2
    assert summary(frames) == literal_atsltd(events, alpha=0.0832, max_duration_ns=100 * MS, stride=50)
    for frame in frames:
        assert 0.0832 <= frame.nzge <= 0.0927
        assert frame.nzge == pytest.approx(histogram_nzge(frame.data), abs=1e-12)


def test_frames_of_slider_depth_do_not_end_later_than_two_strides_after_reaching_alpha():
    events = slider_depth_events(1)
    frame = next(AtsltdConverter(240, 180).convert(events))
    for stop in range(frame.events - 500, frame.events - 99, 50):
        content = events[:stop]
        assert histogram_nzge(closed_form(content, frame.start_ns, int(content.t[-1]))) < 0.0832


def test_bursts_of_equal_stamps_make_few_levels_and_still_follow_the_definition():
    events = random_events(5, 5000, 32, 24, 40 * MS)
    events.t[:] = events.t // (2 * MS) * (2 * MS)
    frames = frames_of(AtsltdConverter(32, 24, AtsltdConfig(check_stride=5)), [events])
    assert summary(frames) == literal_atsltd(events, alpha=0.0832, max_duration_ns=100 * MS, stride=5)
    assert all(frame.stamp_ns > frame.start_ns for frame in frames)


@given(st.integers(0, 1000), st.lists(st.integers(0, 1500), max_size=12))
@settings(deadline=None, max_examples=40)
def test_frames_do_not_depend_on_batches(seed, cuts):
    events = random_events(seed, 1500, 18, 13, 30 * MS)
    config = AtsltdConfig(check_stride=7, max_duration_s=0.003)
    whole = frames_of(AtsltdConverter(18, 13, config), [events])
    assert whole
    assert_same_frames(frames_of(AtsltdConverter(18, 13, config), cut(events, cuts)), whole)


@given(st.integers(0, 1000), st.lists(st.integers(0, 1500), max_size=12), st.integers(1, 3000))
@settings(deadline=None, max_examples=40)
def test_no_frame_ends_by_nzge_before_its_shortest_duration_however_events_are_cut(seed, cuts, shortest_us):
    events = random_events(seed, 1500, 18, 13, 30 * MS)
    config = AtsltdConfig(check_stride=7, min_duration_s=shortest_us * 1e-6, max_duration_s=0.004)
    whole = frames_of(AtsltdConverter(18, 13, config), [events])
    assert whole
    assert all(f.stamp_ns - f.start_ns >= 1000 * shortest_us for f in whole if f.end is FrameEnd.NZGE)
    assert_same_frames(frames_of(AtsltdConverter(18, 13, config), cut(events, cuts)), whole)


def test_a_frame_that_has_its_nzge_ends_with_the_first_stride_after_its_shortest_duration():
    events = random_events(3, 3000, 18, 13, 30 * MS)
    first = frames_of(AtsltdConverter(18, 13, AtsltdConfig(check_stride=7, min_duration_s=0.002)), [events])[0]
    earliest = int(np.searchsorted(events.t, events.t[0] + 2 * MS))
    assert first.end is FrameEnd.NZGE
    assert earliest < first.events <= earliest + 7
    np.testing.assert_array_equal(first.data, closed_form(events[: first.events], first.start_ns, first.stamp_ns))


def test_frames_can_be_made_longer_from_the_next_one_on_and_are_as_configured_again():
    events = random_events(4, 3000, 18, 13, 30 * MS)
    config = AtsltdConfig(check_stride=7, min_duration_s=0.001)
    converter = AtsltdConverter(18, 13, config)
    converter.last_at_least(0.005)
    assert all(frame.stamp_ns - frame.start_ns >= 5 * MS for frame in frames_of(converter, [events]))
    converter.reset()
    converter.last_at_least(0.0)
    assert_same_frames(frames_of(converter, [events]), frames_of(AtsltdConverter(18, 13, config), [events]))


def test_frames_can_be_made_shorter_from_the_next_one_on_and_are_as_configured_again():
    events = random_events(4, 3000, 18, 13, 30 * MS)
    config = AtsltdConfig(check_stride=7, min_duration_s=0.003)
    converter = AtsltdConverter(18, 13, config)
    converter.last_at_most(0.001)
    short = frames_of(converter, [events])
    assert {(frame.stamp_ns - frame.start_ns, frame.end) for frame in short} == {(MS, FrameEnd.TIME_LIMIT)}
    for frame in short:
        first, last = np.searchsorted(events.t, [frame.start_ns, frame.stamp_ns])
        np.testing.assert_array_equal(frame.data, closed_form(events[first:last], frame.start_ns, frame.stamp_ns))
    converter.reset()
    converter.last_at_most(math.inf)
    assert_same_frames(frames_of(converter, [events]), frames_of(AtsltdConverter(18, 13, config), [events]))


@pytest.mark.parametrize("order", ["last_at_least first", "last_at_most first"])
def test_frames_that_are_to_last_longer_do_so_although_they_were_to_be_shorter(order):
    events = random_events(4, 3000, 18, 13, 30 * MS)
    converter, expected = (AtsltdConverter(18, 13, AtsltdConfig(check_stride=7)) for _ in range(2))
    limits = [lambda: converter.last_at_least(0.004), lambda: converter.last_at_most(0.001)]
    for limit in limits if order == "last_at_least first" else limits[::-1]:
        limit()
    expected.last_at_least(0.004)
    expected.last_at_most(0.004)
    assert_same_frames(frames_of(converter, [events]), frames_of(expected, [events]))


@pytest.mark.parametrize("limit", ["last_at_least", "last_at_most"])
def test_the_frame_under_way_ends_as_it_was_to_when_it_began(limit):
    t_ms = [0.0, 0.2, 1.0, 2.0, 3.0, 3.1, 3.2, 4.5, 4.6]
    events = make_events([round(ms * MS) for ms in t_ms], [0, 1, 2, 3, 0, 1, 2, 3, 0], [0] * 9, [1] * 9, 4, 4)
    converter = AtsltdConverter(4, 4, AtsltdConfig(max_duration_s=0.01))
    converter.last_at_most(0.0005)
    converter.last_at_least(0.004)
    assert not frames_of(converter, [events[:5]])
    if limit == "last_at_least":
        converter.last_at_least(0.0)
    else:
        converter.last_at_least(0.0005)
        converter.last_at_most(0.0002)
    first, second = summary(frames_of(converter, [events[5:]]))
    assert first == (0, 4 * MS, 7, "time_limit")
    assert second[1] - second[0] == 0.5 * MS


def test_no_limit_of_a_frame_is_longer_than_configured():
    events = make_events([0, 10 * MS, 25 * MS], [0, 1, 2], [0] * 3, [1] * 3, 4, 4)
    converter = AtsltdConverter(4, 4, AtsltdConfig(max_duration_s=0.01))
    converter.last_at_most(0.5)
    assert summary(frames_of(converter, [events])) == [(0, 10 * MS, 2, "time_limit")]


def test_time_limit_ends_a_frame_without_the_event_that_comes_after_it():
    events = make_events([0, 10 * MS, 10 * MS + 1, 15 * MS, 25 * MS], [0, 1, 2, 3, 0], [0] * 5, [1] * 5, 4, 4)
    frames = frames_of(AtsltdConverter(4, 4, AtsltdConfig(max_duration_s=0.01)), [events])
    assert summary(frames) == [(0, 10 * MS, 2, "time_limit"), (10 * MS, 20 * MS, 2, "time_limit")]
    assert frames[0].data[0, 1, 0] == 255
    assert frames[0].data[0, 2, 0] == 0
    assert frames[0].nzge == pytest.approx(histogram_nzge(frames[0].data))


@pytest.mark.parametrize("number", [30, 3000])
def test_frames_that_their_time_ends_hold_the_closed_form_be_they_full_or_not(number):
    events = random_events(11, number, 8, 8, 30 * MS)
    config = AtsltdConfig(nzge_interval=(0.9, 1.0), max_duration_s=0.01)
    frames = frames_of(AtsltdConverter(8, 8, config), [events])
    assert [frame.end for frame in frames] == [FrameEnd.TIME_LIMIT] * 2
    first = 0
    for frame in frames:
        held = events[first : first + frame.events]
        np.testing.assert_array_equal(frame.data, closed_form(held, frame.start_ns, frame.stamp_ns))
        assert frame.nzge == pytest.approx(histogram_nzge(frame.data))
        first += frame.events


def test_quiet_gap_makes_no_empty_frames_and_the_next_starts_at_its_event():
    events = make_events([0, 1000 * MS, 1005 * MS, 1011 * MS], [0, 1, 2, 3], [0] * 4, [0] * 4, 4, 4)
    frames = frames_of(AtsltdConverter(4, 4, AtsltdConfig(max_duration_s=0.01)), [events])
    assert summary(frames) == [(0, 10 * MS, 1, "time_limit"), (1000 * MS, 1010 * MS, 2, "time_limit")]


def test_reset_starts_a_new_stream_even_back_in_time():
    events = random_events(6, 2000, 16, 16, 10 * MS)
    converter = AtsltdConverter(16, 16)
    fresh = frames_of(converter, [events])
    converter.reset()
    assert_same_frames(frames_of(converter, [events]), fresh)


def test_events_need_not_lie_one_after_the_other():
    events = random_events(8, 4000, 20, 20, 10 * MS)[::2]
    copied = Events(*(array.copy() for array in (events.t, events.x, events.y, events.p)), 20, 20)
    frames = frames_of(AtsltdConverter(20, 20), [copied])
    assert len(frames) > 1
    assert_same_frames(frames_of(AtsltdConverter(20, 20), [events]), frames)


def unlike_decoders(array, kind):
    if kind == "bytes before":
        return np.frombuffer(b"-" + array.tobytes(), np.uint8)[1:].view(array.dtype)
    return array.view({"u": f"i{array.itemsize}"}.get(array.dtype.kind, array.dtype))


@pytest.mark.parametrize("kind", ["bytes before", "signed"])
def test_arrays_need_not_be_as_decoders_make_them(kind):
    events = random_events(9, 4000, 20, 20, 10 * MS)
    frames = frames_of(AtsltdConverter(20, 20), [events[:1900], events[1900:]])
    assert len(frames) > 1
    other = Events(*(unlike_decoders(array, kind) for array in (events.t, events.x, events.y, events.p)), 20, 20)
    assert_same_frames(frames_of(AtsltdConverter(20, 20), [other[:1900], events[1900:]]), frames)


def test_overshoots_are_counted():
    converter = AtsltdConverter(16, 16, AtsltdConfig(nzge_interval=(0.05, 0.0501), check_stride=100))
    frames = frames_of(converter, [random_events(7, 2000, 16, 16, 10 * MS)])
    assert converter.overshoots == sum(frame.nzge > 0.0501 for frame in frames) > 0


@pytest.mark.parametrize(
    ("events", "message"),
    [
        (make_events([0], [0], [0], [1], 9, 8), "9x8 sensor came to a 8x8"),
        (make_events([0], [8], [0], [1], 8, 8), r"\(8, 0\)"),
        (make_events([0], [0], [8], [1], 8, 8), r"\(0, 8\)"),
        (make_events([0], [0], [0], [2], 8, 8), "polarity of 2"),
        (make_events([5, 4], [0, 0], [0, 0], [1, 1], 8, 8), "goes back"),
        (make_events([-(2**63), 2**63 - 1], [0, 0], [0, 0], [1, 1], 8, 8), "impossible"),
    ],
)
def test_events_that_do_not_fit_are_refused_before_anything_is_done(events, message):
    with pytest.raises(ConversionError, match=message):
        AtsltdConverter(8, 8).convert(events)


@pytest.mark.parametrize(
    ("name", "array", "message"),
    [
        ("x", np.array([0, -1], np.int16), "events.x is int16"),
        ("x", np.array([0, 2**32]), "events.x is int64"),
        ("x", np.zeros(1, np.uint16), r"events.x is uint16 \(1,\)"),
        ("y", np.zeros(3, np.uint16), r"events.y is uint16 \(3,\)"),
        ("p", np.zeros(1, np.uint8), r"events.p is uint8 \(1,\)"),
        ("t", np.zeros(1, np.int64), r"events.x is uint16 \(2,\), not uint16 \(1,\)"),
        ("t", np.array([0.0, np.nan]), "events.t is float64"),
        ("t", np.array([0, 1], np.uint64), "events.t is uint64"),
        ("t", np.array([0, 1], np.int32), "events.t is int32"),
    ],
)
def test_arrays_that_are_not_those_of_events_are_refused_before_a_kernel_writes_where_they_point(name, array, message):
    events = dataclasses.replace(make_events([0, 1], [0, 0], [0, 0], [1, 1], 8, 8), **{name: array})
    with pytest.raises(ConversionError, match=message):
        AtsltdConverter(8, 8).convert(events)
    with pytest.raises(ConversionError, match=message):
        BackgroundActivityFilter(8, 8).filter(events)


UNFIT = [
    ("x", 20, r"\(20, \d+\) .* 20x20 sensor"),
    ("y", 65535, r"\(\d+, 65535\) .* 20x20 sensor"),
    ("p", 2, "polarity of 2"),
    ("t", 0, "goes back 1 times in a batch"),
    ("t", 2**62, "goes back 1 times in a batch|impossible"),
]
"""An event's field, what does not fit there, and what is said of it."""


@pytest.mark.parametrize("place", [BLOCK_EVENTS - 1, BLOCK_EVENTS, 3001, 3999])
@pytest.mark.parametrize(("name", "value", "message"), UNFIT)
def test_an_event_that_does_not_fit_is_refused_wherever_it_is_and_what_comes_before_its_block_is_not(
    place, name, value, message
):
    events = random_events(12, 4000, 20, 20, 10 * MS)
    expected = frames_of(AtsltdConverter(20, 20), [events])
    getattr(events, name)[place] = value
    converter, frames = AtsltdConverter(20, 20), []
    with pytest.raises(ConversionError, match=message):
        frames.extend(converter.convert(events))
    added = sum(frame.events for frame in frames) + converter._accumulator.events
    assert place - BLOCK_EVENTS < added <= place
    assert_same_frames(frames, expected[: len(frames)])


@pytest.mark.parametrize("name", ["t", "x", "y", "p"])
def test_a_converter_that_has_refused_events_converts_the_next_stream_as_a_new_one(name):
    events = random_events(13, 4000, 20, 20, 10 * MS)
    expected = frames_of(AtsltdConverter(20, 20), [events])
    unfit = dataclasses.replace(events, **{name: getattr(events, name).copy()})
    getattr(unfit, name)[2500] = 99
    converter = AtsltdConverter(20, 20)
    with pytest.raises(ConversionError):
        list(converter.convert(unfit))
    converter.reset()
    assert_same_frames(frames_of(converter, [events]), expected)


@pytest.mark.parametrize("place", [BLOCK_EVENTS - 1, 700])
def test_what_a_converter_has_added_of_a_batch_that_it_refuses_belongs_to_the_stream(place):
    events = random_events(14, 1000, 20, 20, MS)
    unfit = dataclasses.replace(events, x=events.x.copy())
    unfit.x[place] = 20
    converter = AtsltdConverter(20, 20, AtsltdConfig(nzge_interval=(0.9, 0.9)))
    with pytest.raises(ConversionError):
        list(converter.convert(unfit))
    later = dataclasses.replace(events, t=events.t + 50 * MS)
    long_after = make_events([later.t[0] + 101 * MS], [0], [0], [1], 20, 20)
    (frame,) = frames_of(converter, [later, long_after])
    added = place // BLOCK_EVENTS * BLOCK_EVENTS
    assert frame.start_ns == (events.t[0] if added else later.t[0])
    assert frame.events == added + len(later)


def test_an_iterator_that_a_later_batch_has_overtaken_does_no_harm():
    events = random_events(15, 4000, 20, 20, 10 * MS)
    expected = frames_of(AtsltdConverter(20, 20), [events])
    converter = AtsltdConverter(20, 20)
    overtaken = converter.convert(events)
    next(overtaken)
    list(converter.convert(dataclasses.replace(events[:7], t=events.t[:7] + 20 * MS)))
    list(overtaken)
    converter.reset()
    assert_same_frames(frames_of(converter, [events]), expected)


def test_a_late_batch_that_does_not_fit_does_not_end_the_frame():
    converter = AtsltdConverter(8, 8)
    list(converter.convert(make_events([100], [0], [0], [1], 8, 8)))
    with pytest.raises(ConversionError, match=r"\(8, 0\)"):
        converter.convert(make_events([10**9], [8], [0], [1], 8, 8))
    assert converter._accumulator.events == 1


def test_batch_that_goes_back_in_time_is_refused():
    converter = AtsltdConverter(8, 8)
    list(converter.convert(make_events([100], [0], [0], [1], 8, 8)))
    with pytest.raises(ConversionError, match="from 100 to 99 ns"):
        converter.convert(make_events([99], [0], [0], [1], 8, 8))


def test_empty_interval_is_refused():
    with pytest.raises(ParameterError, match="alpha <= beta"):
        AtsltdConfig(nzge_interval=(0.1, 0.09))


def test_default_interval_is_the_papers():
    assert AtsltdConfig().nzge_interval == (0.0832, 0.0927)


def test_fine_frames_of_the_lowest_interval_have_one_as_well():
    lowest = AtsltdConfig(nzge_interval=(NZGE_MIN, 2 * NZGE_MIN))
    assert lowest.fine().nzge_interval == (NZGE_MIN, NZGE_MIN)
