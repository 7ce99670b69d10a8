"""The benchmark's streams of events."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.benchmarking.streams import MESSAGE_DURATION_NS, RECORDINGS, SYNTHETIC, recorded, synthetic, texture

kinds = st.sampled_from(sorted(SYNTHETIC))


@given(
    kind=kinds,
    width=st.integers(1, 400),
    height=st.integers(1, 300),
    count=st.integers(1, 5000),
    rate=st.sampled_from([1e4, 1e6, 1e8]),
    seed=st.integers(0, 2**31),
)
@settings(deadline=None, max_examples=60)
def test_every_stream_is_events_on_its_sensor_at_its_rate(kind, width, height, count, rate, seed):
    stream = synthetic(kind, width, height, count, rate, seed)
    stream.events.check()
    assert len(stream.events) == count
    assert stream.sensor == f"{width}x{height}"
    if count > 1000:
        assert stream.rate == pytest.approx(rate, rel=0.01)


@given(kind=kinds)
@settings(deadline=None, max_examples=10)
def test_a_seed_repeats_its_stream(kind):
    first, again, other = (synthetic(kind, 64, 48, 2000, 1e6, seed).events.to_structured() for seed in (3, 3, 4))
    assert np.array_equal(first, again)
    assert kind == "flicker" or not np.array_equal(first, other)


@pytest.mark.parametrize(("kind", "share"), [("contours", 0.04), ("texture", 0.5)])
def test_a_pattern_fires_in_its_share_of_the_pixels(kind, share):
    width, height = 320, 240
    events = synthetic(kind, width, height, round(share * width * height), 1e6).events
    pixels = np.unique(events.y.astype(np.int64) * width + events.x)
    assert len(pixels) == pytest.approx(share * width * height, rel=0.15)


def test_a_texture_moves_one_pixel_in_each_of_its_steps():
    events = texture(200, 100, 2 * 20, 1e6, seed=1, share=20 / 20_000)
    step_x = (events.x[20:].astype(int) - events.x[:20] + 100) % 200 - 100
    step_y = (events.y[20:].astype(int) - events.y[:20] + 50) % 100 - 50
    assert len(set(zip(step_x.tolist(), step_y.tolist(), strict=True))) == 1
    assert 0 < np.hypot(step_x[0], step_y[0]) < 1.5


@given(rate=st.sampled_from([1e4, 1e6, 3e7]), events_max=st.sampled_from([1, 100, 100_000]))
@settings(deadline=None, max_examples=10)
def test_messages_are_short_and_together_the_stream(rate, events_max):
    stream = synthetic("uniform", 64, 48, 3000, rate)
    messages = stream.messages(events_max)
    assert all(0 < len(events) <= events_max for events in messages)
    assert all(int(events.t[-1] - events.t[0]) < MESSAGE_DURATION_NS for events in messages)
    assert np.array_equal(np.concatenate([events.t for events in messages]), stream.events.t)


@pytest.mark.parametrize("name", sorted(RECORDINGS))
def test_a_recording_is_repeated_in_time_order(name, data):
    stream = recorded(name, data, 600_000)
    assert stream is not None
    stream.events.check()
    assert len(stream.events) >= 600_000


def test_a_recording_that_is_not_there_is_left_out(tmp_path):
    assert recorded("slider_depth", tmp_path, 1000) is None
