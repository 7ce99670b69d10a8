"""The high-pass filter against a plain per-event oracle, and its images' independence of batches."""

from __future__ import annotations

import math
import os
import warnings
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.events import Events, EventsError, concatenate
from etd_ros.parameters import ParameterError
from etd_ros.reconstruction import HighPassConfig, HighPassFilter, ReconstructionError
from etd_ros.recordings import open_recording

DATA = Path(os.environ.get("ETD_DATA", Path(__file__).parents[3] / "shared" / "data"))
WIDTH, HEIGHT = 12, 9


def random_events(
    seed: int, count: int, *, step_ns: int = 2_000_000, width: int = WIDTH, height: int = HEIGHT
) -> Events:
    rng = np.random.default_rng(seed)
    return Events(
        1_700_000_000_000_000_000 + np.cumsum(rng.integers(0, step_ns, count)),
        rng.integers(0, width, count).astype(np.uint16),
        rng.integers(0, height, count).astype(np.uint16),
        rng.integers(0, 2, count).astype(np.uint8),
        width,
        height,
    )


def oracle_images(levels_at_stamps, stamps, config: HighPassConfig) -> list[np.ndarray]:
    """What `image` promises without smoothing, with NumPy's own exponential and order statistics."""
    images = []
    bounds = None
    for levels, stamp_ns, last_ns in zip(levels_at_stamps, stamps, [None, *stamps], strict=False):
        intensity = np.exp(np.minimum(levels, 16).astype(np.float64) + math.log(1.5)) - 1
        step = max(1, math.ceil(math.sqrt(intensity.size / 65536)))
        ordered = np.sort(intensity[::step, ::step], axis=None)
        dropped = int(ordered.size * config.dropped_percent / 100)
        target = np.array([ordered[dropped], ordered[-1 - dropped]])
        target += np.array([-0.5, 0.5]) * max(0.0, config.range_min - (target[1] - target[0]))
        kept = 0.0
        if bounds is not None and config.range_time_s:
            kept = math.exp(-(stamp_ns - last_ns) * 1e-9 / config.range_time_s)
        bounds = target if bounds is None else kept * bounds + (1 - kept) * target
        grey = 255 * (intensity - bounds[0]) / (bounds[1] - bounds[0])
        images.append(np.floor(np.clip(grey, 0, 255) + 0.5).astype(int))
    return images


def oracle_levels(events: Events, stamp_ns: int, config: HighPassConfig) -> np.ndarray:
    """The definition, one event at a time with math.exp."""
    omega = 2 * math.pi * config.cutoff_hz
    levels = np.zeros((events.height, events.width))
    last = {}
    for t, x, y, p in zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist(), strict=True):
        kept = math.exp(-omega * (t - last.get((y, x), t)) * 1e-9)
        levels[y, x] = kept * levels[y, x] + (config.contrast_on if p else config.contrast_off)
        last[y, x] = t
    for (y, x), t in last.items():
        levels[y, x] *= math.exp(-omega * (stamp_ns - t) * 1e-9)
    return levels


@settings(deadline=None, max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    count=st.integers(1, 1500),
    cutoff_hz=st.sampled_from([0.0, 0.06, 3.0, 20.0, 1000.0]),
    step_ns=st.sampled_from([2, 1000, 2_000_000]),
    wait_ns=st.integers(0, 3_000_000_000),
)
def test_levels_equal_the_per_event_definition(seed, count, cutoff_hz, step_ns, wait_ns):
    config = HighPassConfig(cutoff_hz=cutoff_hz, contrast_on=0.15, contrast_off=-0.1)
    events = random_events(seed, count, step_ns=step_ns)
    stamp_ns = int(events.t[-1]) + wait_ns
    high_pass = HighPassFilter(WIDTH, HEIGHT, config)
    high_pass.integrate(events)
    # Each contribution is decayed to within a tick of 1e-5; float32 adds its rounding.
    magnitude = oracle_levels(
        Events(events.t, events.x, events.y, np.ones_like(events.p), WIDTH, HEIGHT), stamp_ns, config
    )
    error = np.abs(high_pass.levels(stamp_ns) - oracle_levels(events, stamp_ns, config))
    assert (error <= 1.1e-5 * magnitude + 1e-6).all()


@settings(deadline=None, max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    cutoff_hz=st.sampled_from([3.0, 1000.0]),
    gap_ns=st.sampled_from([10**9, 5 * 10**9, 3600 * 10**9, 10**17]),
    cuts=st.lists(st.integers(0, 300), max_size=4),
)
def test_levels_stay_as_defined_over_long_streams_and_gaps(seed, cutoff_hz, gap_ns, cuts):
    config = HighPassConfig(cutoff_hz=cutoff_hz)
    rng = np.random.default_rng(seed)
    t = 5 + np.cumsum(np.where(rng.random(300) < 0.9, rng.integers(0, 1000, 300), rng.integers(0, gap_ns, 300)))
    events = random_events(seed, 300, width=3, height=2)
    events = Events(t, events.x, events.y, events.p, 3, 2)
    high_pass = HighPassFilter(3, 2, config)
    for first, last in pairwise([0, *sorted(cuts), 300]):
        high_pass.integrate(events[first:last])
        stamp_ns = int(t[max(last, 1) - 1])
        expected = oracle_levels(events[: max(last, 1)], stamp_ns, config)
        if last:
            np.testing.assert_allclose(high_pass.levels(stamp_ns), expected, rtol=0, atol=2e-4)


@settings(deadline=None, max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    size=st.sampled_from([(12, 9), (1, 1), (31, 2), (400, 300)]),
    dropped_percent=st.sampled_from([0.0, 0.25, 25.0]),
    range_min=st.sampled_from([0.01, 0.6, 5.0]),
    range_time_s=st.sampled_from([0.0, 0.5]),
    contrast=st.sampled_from([0.1, 1.0]),
)
def test_images_are_those_of_the_definition_within_a_grey_level(
    seed, size, dropped_percent, range_min, range_time_s, contrast
):
    config = HighPassConfig(
        smoothing="none",
        dropped_percent=dropped_percent,
        range_min=range_min,
        range_time_s=range_time_s,
        contrast_on=contrast,
        contrast_off=-contrast,
    )
    events = random_events(seed, 3000, step_ns=10_000, width=size[0], height=size[1])
    high_pass = HighPassFilter(*size, config)
    levels, images, stamps = [], [], []
    for number in range(3):
        high_pass.integrate(events[number * 1000 : number * 1000 + 1000])
        stamps.append(int(events.t[number * 1000 + 999]))
        levels.append(high_pass.levels(stamps[-1]))
        images.append(high_pass.image(stamps[-1]).astype(int))
    # Where one pixel is brighter than all else is apart, float32 has fewer steps than there are grey levels.
    brightest = np.float32(math.exp(min(16, max(level.max() for level in levels))))
    allowed = 1 + 255 * float(np.spacing(brightest)) * 1.5 / range_min
    for image, expected in zip(images, oracle_images(levels, stamps, config), strict=True):
        assert np.abs(image - expected).max() <= allowed


def test_images_of_a_real_recording_are_those_of_the_definition_within_a_grey_level():
    config = HighPassConfig(smoothing="none")
    with open_recording(DATA / "slider_depth" / "slider_depth.bag") as recording:
        events = concatenate(list(islice(recording.events(), 5)))
    high_pass = HighPassFilter(events.width, events.height, config)
    edges = np.linspace(0, len(events), 6).astype(int)
    stamps = [int(events.t[edge - 1]) for edge in edges[1:]]
    images = []
    for (first, last), stamp_ns in zip(pairwise(edges), stamps, strict=True):
        high_pass.integrate(events[first:last])
        images.append(high_pass.image(stamp_ns))
    levels = [oracle_levels(events[:last], stamp_ns, config) for last, stamp_ns in zip(edges[1:], stamps, strict=True)]
    for image, expected in zip(images, oracle_images(levels, stamps, config), strict=True):
        assert image.std() > 10
        assert np.abs(image.astype(int) - expected).max() <= 1


@pytest.mark.parametrize("lit", [0.4, 1.0])
def test_endless_contrast_saturates_without_overflow(lit):
    x = np.arange(round(10 * lit), dtype=np.uint16)
    events = Events(np.full(len(x), 5), x, np.zeros_like(x), np.ones(len(x), np.uint8), 10, 1)
    high_pass = HighPassFilter(10, 1, HighPassConfig(cutoff_hz=0.0, contrast_on=10.0, smoothing="none"))
    for _ in range(100):
        high_pass.integrate(events)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        image = high_pass.image(5)
    assert image[0].tolist() == ([255] * 4 + [0] * 6 if lit < 1 else [image[0, 0]] * 10)


def test_events_off_the_sensor_are_left_out():
    inside = random_events(1, 50)
    outside = Events(
        np.full(3, 1_700_000_000_000_000_000),
        np.array([WIDTH, 0, 65535], np.uint16),
        np.array([0, HEIGHT, 65535], np.uint16),
        np.ones(3, np.uint8),
        WIDTH,
        HEIGHT,
    )
    with_outside, without = HighPassFilter(WIDTH, HEIGHT), HighPassFilter(WIDTH, HEIGHT)
    with_outside.integrate(outside)
    stamp_ns = int(inside.t[-1])
    for high_pass in (with_outside, without):
        high_pass.integrate(inside)
    np.testing.assert_allclose(with_outside.levels(stamp_ns), without.levels(stamp_ns), atol=1e-4)


def test_an_image_handed_out_stays_when_the_next_one_is_made():
    for smoothing in ("none", "gaussian", "bilateral"):
        high_pass = HighPassFilter(WIDTH, HEIGHT, HighPassConfig(smoothing=smoothing))
        events = random_events(7, 400)
        high_pass.integrate(events[:200])
        first = high_pass.image(int(events.t[199]))
        before = first.copy()
        high_pass.integrate(events[200:])
        high_pass.image(int(events.t[-1]))
        np.testing.assert_array_equal(first, before)


@settings(deadline=None, max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    cuts=st.lists(st.integers(0, 600), max_size=8),
    smoothing=st.sampled_from(["none", "gaussian", "bilateral"]),
)
def test_images_do_not_depend_on_how_the_events_were_cut(seed, cuts, smoothing):
    events = random_events(seed, 600)
    stamps = [int(events.t[200]), int(events.t[450]), int(events.t[-1]) + 5]
    config = HighPassConfig(smoothing=smoothing)

    def images(edges):
        high_pass = HighPassFilter(WIDTH, HEIGHT, config)
        start_ns = int(events.t[0])
        found = []
        for stamp_ns in stamps:
            part = events.between(start_ns, stamp_ns)
            for first, last in zip([0, *edges], [*edges, len(part)], strict=True):
                high_pass.integrate(part[min(first, len(part)) : min(last, len(part))])
            found.append(high_pass.image(stamp_ns))
            start_ns = stamp_ns
        return found

    for whole, cut in zip(images([]), images(sorted(cuts)), strict=True):
        np.testing.assert_array_equal(whole, cut)


def test_a_bright_edge_is_bright_and_a_dark_one_dark():
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    p = (x < WIDTH // 2).astype(np.uint8).ravel()
    count = p.size
    events = Events(np.full(count, 10), x.ravel().astype(np.uint16), y.ravel().astype(np.uint16), p, WIDTH, HEIGHT)
    high_pass = HighPassFilter(WIDTH, HEIGHT, HighPassConfig(smoothing="none"))
    for _ in range(5):
        high_pass.integrate(events)
    image = high_pass.image(10)
    assert (image[:, : WIDTH // 2] == 255).all()
    assert (image[:, WIDTH // 2 :] == 0).all()


def test_an_empty_filter_gives_an_even_grey_image():
    image = HighPassFilter(WIDTH, HEIGHT).image(5)
    assert image.shape == (HEIGHT, WIDTH)
    assert image.dtype == np.uint8
    assert image.min() == image.max()
    assert image[0, 0] in (127, 128)


def test_what_was_seen_fades_with_the_cut_off_frequency():
    high_pass = HighPassFilter(WIDTH, HEIGHT, HighPassConfig(cutoff_hz=3.0))
    events = random_events(1, 500)
    high_pass.integrate(events)
    early = np.abs(high_pass.levels(int(events.t[-1])))
    late = np.abs(high_pass.levels(int(events.t[-1]) + 1_000_000_000))
    seen = early > 0
    np.testing.assert_allclose(late[seen] / early[seen], math.exp(-2 * math.pi * 3), rtol=1e-4)
    assert HighPassFilter(WIDTH, HEIGHT).levels(0).max() == 0


def test_the_grey_range_follows_the_scene_slowly_and_not_at_all_at_once():
    slow = HighPassFilter(WIDTH, HEIGHT, HighPassConfig(range_time_s=1.0, smoothing="none"))
    fast = HighPassFilter(WIDTH, HEIGHT, HighPassConfig(range_time_s=0.0, smoothing="none"))
    events = random_events(3, 4000, step_ns=1000)
    for high_pass in (slow, fast):
        high_pass.image(int(events.t[0]))
        high_pass.integrate(events)
    stamp_ns = int(events.t[-1])
    # The slow range still is that of the empty scene, so that more pixels are clipped.
    clipped = [np.isin(high_pass.image(stamp_ns), (0, 255)).mean() for high_pass in (slow, fast)]
    assert clipped[0] > 2 * clipped[1]


def test_a_reset_filter_is_a_new_one():
    events = random_events(4, 300)
    used, new = HighPassFilter(WIDTH, HEIGHT), HighPassFilter(WIDTH, HEIGHT)
    used.integrate(random_events(5, 300))
    used.image(int(events.t[-1]))
    used.reset()
    for high_pass in (used, new):
        high_pass.integrate(events)
    np.testing.assert_array_equal(used.image(int(events.t[-1])), new.image(int(events.t[-1])))


def test_large_sensors_take_their_grey_range_from_a_sample():
    events = random_events(6, 20_000, step_ns=100, width=1280, height=720)
    high_pass = HighPassFilter(1280, 720)
    high_pass.integrate(events)
    image = high_pass.image(int(events.t[-1]))
    assert image.shape == (720, 1280)
    assert image.std() > 1


def test_events_of_another_sensor_size_are_refused():
    with pytest.raises(ReconstructionError, match="12x8"):
        HighPassFilter(WIDTH, HEIGHT).integrate(Events.empty(12, 8))


def test_arrays_of_unlike_lengths_are_refused():
    events = Events(np.zeros(2, np.int64), *(np.zeros(n, np.uint16) for n in (2, 1)), np.ones(2, np.uint8), 12, 8)
    with pytest.raises(ReconstructionError, match="differ in length"):
        HighPassFilter(12, 8).integrate(events)


def test_impossible_sizes_and_parameters_are_refused():
    with pytest.raises(EventsError, match="0x9"):
        HighPassFilter(0, 9)
    with pytest.raises(ParameterError, match="cutoff_hz"):
        HighPassConfig(cutoff_hz=-1.0)
    with pytest.raises(ParameterError, match="smoothing"):
        HighPassConfig(smoothing="median")
