"""Clear frames and the interval that they give."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from etd_ros.conversion import PAPER_INTERVAL, ConversionError, FixedCountConfig, FixedCountConverter, nzge
from etd_ros.conversion.calibration import (
    CalibrationConfig,
    Sample,
    calibrate,
    clarity,
    clear_frames,
    clearest_frame,
    frame_data,
)
from etd_ros.events import Events, concatenate
from etd_ros.recordings import open_recording
from etd_ros.simulation import TEXTURES, Path, Scene, SensorConfig, Sprite, Waypoint, simulate
from etd_ros.stream import Restart, StreamBatch

WIDTH, HEIGHT = 120, 90
TRAVEL_PX = 24
FIRST_PX = 6


@st.composite
def small_events(draw: st.DrawFn) -> Events:
    count = draw(st.integers(1, 40))
    gaps_ns = draw(st.lists(st.sampled_from([0, 0, 1, 7, 1000]), min_size=count, max_size=count))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    x, y = (rng.integers(0, size, count, np.uint16) for size in (6, 5))
    t = 10**18 + np.cumsum(gaps_ns, dtype=np.int64)
    return Events(t, x, y, rng.integers(0, 2, count, np.uint8), 6, 5)


def moving_texture(speed_px_s: float, texture: str = "checks", seed: int = 3) -> Events:
    """A texture that fills the sensor and moves by TRAVEL_PX."""
    surface = TEXTURES[texture](np.random.default_rng(seed), HEIGHT + 2 * TRAVEL_PX, WIDTH + 2 * TRAVEL_PX)
    duration_s = TRAVEL_PX / speed_px_s
    half_x, half_y = TRAVEL_PX * 0.4, TRAVEL_PX * 0.3
    path = Path(
        [
            Waypoint(0, WIDTH / 2 - half_x, HEIGHT / 2 - half_y),
            Waypoint(duration_s, WIDTH / 2 + half_x, HEIGHT / 2 + half_y),
        ]
    )
    sprite = Sprite("wall", surface, np.ones_like(surface), path)
    scene = Scene(WIDTH, HEIGHT, duration_s, np.full((HEIGHT, WIDTH), 0.5), (sprite,))
    config = SensorConfig(step_s=0.25 / speed_px_s, noise_rate_hz=500.0, refractory_s=0.02 / speed_px_s)
    return concatenate(list(simulate(scene, seed=seed, config=config)))


def noise(count: int = 60_000, duration_ns: int = 10**9) -> Events:
    rng = np.random.default_rng(5)
    t = np.sort(rng.integers(0, duration_ns, count))
    x, y = (rng.integers(0, size, count, np.uint16) for size in (WIDTH, HEIGHT))
    return Events(t, x, y, rng.integers(0, 2, count, np.uint8), WIDTH, HEIGHT)


def cut(events: Events, sizes: Iterator[int]) -> Iterator[StreamBatch]:
    start = 0
    while start < len(events):
        stop = start + next(sizes)
        yield StreamBatch(events[start:stop], None)
        start = stop


def batches_of(events: Events, size: int) -> Iterator[StreamBatch]:
    return cut(events, itertools.repeat(size))


def spans_ns(samples: list[Sample]) -> list[tuple[int, int]]:
    return [(int(sample.events.t[0]), int(sample.events.t[sample.count - 1])) for sample in samples]


@given(small_events())
@settings(deadline=None, max_examples=60)
def test_a_frame_of_events_is_the_frame_of_the_converters(events):
    (frame,) = FixedCountConverter(6, 5, FixedCountConfig(count=len(events))).convert(events)
    np.testing.assert_array_equal(frame_data(events), frame.data)


@given(small_events(), st.integers(1, 5000))
@settings(deadline=None, max_examples=30)
def test_grey_levels_count_from_the_start_of_the_frame(events, before_ns):
    start_ns = int(events.t[0]) - before_ns
    duration_ns = int(events.t[-1]) - start_ns
    expected = np.zeros((5, 6, 2), np.uint8)
    for t, x, y, p in zip(events.t.tolist(), events.x, events.y, events.p, strict=True):
        expected[y, x, 1 - int(p)] = max(1, int(np.floor(255 * (t - start_ns) / duration_ns + 0.5)))
    np.testing.assert_array_equal(frame_data(events, start_ns), expected)


def plain_connectedness(data: np.ndarray) -> float:
    height, width, _ = data.shape
    pixels = connected = 0
    for y, x, channel in zip(*np.nonzero(data), strict=True):
        around = data[max(0, y - 1) : min(height, y + 2), max(0, x - 1) : min(width, x + 2), channel]
        pixels += 1
        connected += np.count_nonzero(around) - 1 >= 2
    expected = stats.binom.sf(1, 8, pixels / data.size)
    return max(0.0, (connected / pixels - expected) / (1 - expected))


@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.7))
@settings(deadline=None, max_examples=40)
def test_connectedness_is_the_share_of_pixels_with_two_neighbours_above_chance(seed, density):
    rng = np.random.default_rng(seed)
    data = np.where(rng.random((9, 12, 2)) < density, rng.integers(1, 256, (9, 12, 2)), 0).astype(np.uint8)
    data[4, 4, 0] = 9
    assert clarity(data).connectedness == pytest.approx(plain_connectedness(data), abs=1e-12)


def test_sharpness_is_gradient_energy_over_energy():
    data = np.zeros((9, 9, 2), np.uint8)
    data[4, 4, 1] = 200
    # A lone pixel is seen by eight Sobel windows with the weights 1, 2, 1 in either direction.
    assert clarity(data).sharpness == pytest.approx(2 * (4 * 1 + 2 * 4))


def test_contours_are_connected_and_scattered_pixels_are_not():
    line, scattered = np.zeros((60, 80, 2), np.uint8), np.zeros((60, 80, 2), np.uint8)
    line[10:50, 40, 0] = 255
    scattered[np.random.default_rng(1).random((60, 80, 2)) < 0.1] = 255
    assert clarity(line).connectedness > 0.9
    assert clarity(scattered).connectedness < 0.1


def test_a_smeared_contour_is_less_clear_than_a_thin_one():
    thin, smeared = np.zeros((60, 80, 2), np.uint8), np.zeros((60, 80, 2), np.uint8)
    thin[5:55, 40:42, 0] = (200, 255)
    smeared[5:55, 30:42, 0] = np.linspace(20, 255, 12)
    assert clarity(thin).value > 1.5 * clarity(smeared).value


def test_an_empty_frame_has_no_clarity():
    assert clarity(np.zeros((20, 20, 2), np.uint8)).value == 0


def displacement_px(speed_px_s: float, texture: str) -> float:
    events = moving_texture(speed_px_s, texture)
    first = int(np.searchsorted(events.t, FIRST_PX / speed_px_s * 1e9))
    sample = clearest_frame(events[first:], CalibrationConfig())
    assert sample is not None
    return sample.duration_s * speed_px_s


@pytest.mark.parametrize("texture", ["checks", "smooth_noise", "stripes"])
def test_contours_have_moved_equally_far_at_every_speed(texture):
    slow, middle, fast = (displacement_px(speed, texture) for speed in (50, 200, 1000))
    assert 0.5 < middle < 6
    assert slow == pytest.approx(middle, rel=0.3)
    assert fast == pytest.approx(middle, rel=0.3)


def test_a_sample_is_clearer_than_the_frames_of_half_and_twice_its_events():
    sample = clearest_frame(moving_texture(200)[5000:], CalibrationConfig())
    chosen, shorter, longer = (clarity(sample.frame_data(scale)).value for scale in (1, 0.5, 2))
    assert sample.clarity == clarity(sample.frame_data())
    assert chosen > shorter
    assert chosen > longer
    assert sample.nzge == nzge(sample.frame_data())


def test_noise_shows_no_contours():
    assert clearest_frame(noise(), CalibrationConfig()) is None
    assert list(clear_frames(batches_of(noise(), 999), 5000, CalibrationConfig())) == []


def test_events_that_end_before_the_contours_are_complete_give_no_sample():
    events = moving_texture(200)[5000:]
    sample = clearest_frame(events, CalibrationConfig())
    assert clearest_frame(events[: sample.count * 3 // 4], CalibrationConfig()) is None


def test_events_at_one_time_are_no_frame():
    events = moving_texture(200)
    still = Events(np.zeros_like(events.t), events.x, events.y, events.p, WIDTH, HEIGHT)
    assert clearest_frame(still, CalibrationConfig()) is None


def test_samples_do_not_depend_on_batches():
    events = moving_texture(200)
    rng = np.random.default_rng(0)
    by_one_cut = list(clear_frames(batches_of(events, 1000), 2500, CalibrationConfig()))
    sizes = iter(lambda: int(rng.integers(1, 9000)), None)
    by_another = list(clear_frames(cut(events, sizes), 2500, CalibrationConfig()))
    assert len(by_one_cut) > 3
    assert spans_ns(by_one_cut) == spans_ns(by_another)


def test_samples_share_no_events():
    spans = spans_ns(list(clear_frames(batches_of(moving_texture(200), 1000), 1, CalibrationConfig())))
    assert len(spans) > 3
    assert all(end <= start for (_, end), (start, _) in itertools.pairwise(spans))


def test_samples_lie_as_far_apart_as_asked():
    events = moving_texture(200)
    spans = spans_ns(list(clear_frames(batches_of(events, 1000), 20_000, CalibrationConfig())))
    firsts = np.searchsorted(events.t, [start for start, _ in spans])
    assert len(spans) > 1
    assert (np.diff(firsts) >= 20_000 - 100).all()


def test_no_sample_goes_beyond_the_end_of_a_stream():
    events = moving_texture(200)
    middle = len(events) // 2
    again = Events(events.t - 10**9, events.x, events.y, events.p, WIDTH, HEIGHT)
    streams = [StreamBatch(events[:middle], None), StreamBatch(again, Restart.TIME_STEP_BACK)]
    spans = spans_ns(list(clear_frames(streams, 1, CalibrationConfig())))
    first = [span for span in spans if span[0] >= 0]
    assert 0 < len(first) < len(spans)
    assert all(end < int(events.t[middle]) for _, end in first)
    assert spans[len(first) :] == spans_ns(list(clear_frames(batches_of(again, 1000), 1, CalibrationConfig())))


def test_no_frame_has_more_events_than_the_sensor_has_pixels():
    config = CalibrationConfig(connectedness_min=0.0, decline=0.0)
    samples = list(clear_frames(batches_of(moving_texture(200), 1000), 5000, config))
    assert samples
    assert all(len(sample.events) <= WIDTH * HEIGHT for sample in samples)


def test_the_interval_is_students():
    values = np.random.default_rng(2).normal(0.09, 0.02, 40)
    calibration = calibrate(values, 0.05)
    assert calibration.interval == pytest.approx(stats.t.interval(0.95, 39, values.mean(), stats.sem(values)))
    assert (calibration.mean, calibration.std) == pytest.approx((values.mean(), values.std(ddof=1)))


def test_nine_frames_are_too_few():
    with pytest.raises(ConversionError, match=r"9 frames .* too few, 10 are needed"):
        calibrate(np.full(9, 0.09))


def test_instants_need_a_distance():
    with pytest.raises(ConversionError, match="0 events apart"):
        list(clear_frames([], 0, CalibrationConfig()))


def test_cells_are_checked_before_the_work():
    with pytest.raises(ConversionError, match="cell size 1"):
        list(clear_frames([], 1, CalibrationConfig(), cell_size=1))


def test_a_real_recording_of_the_papers_camera_confirms_the_papers_interval(data):
    with open_recording(data / "slider_depth" / "slider_depth.bag") as recording:
        samples = list(clear_frames(recording.streams(), 10_000, CalibrationConfig()))
    calibration = calibrate(np.array([sample.nzge for sample in samples]))
    alpha, beta = PAPER_INTERVAL
    assert len(samples) > 90
    assert alpha < calibration.mean < beta
    assert calibration.interval[1] - calibration.interval[0] < beta - alpha
