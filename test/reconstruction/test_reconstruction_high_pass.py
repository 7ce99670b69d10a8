"""The high-pass filter against a plain per-event oracle, and its images' independence of batches."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.events import Events, EventsError
from etd_ros.parameters import ParameterError
from etd_ros.reconstruction import HighPassConfig, HighPassFilter, ReconstructionError

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


def test_impossible_sizes_and_parameters_are_refused():
    with pytest.raises(EventsError, match="0x9"):
        HighPassFilter(0, 9)
    with pytest.raises(ParameterError, match="cutoff_hz"):
        HighPassConfig(cutoff_hz=-1.0)
    with pytest.raises(ParameterError, match="smoothing"):
        HighPassConfig(smoothing="median")
