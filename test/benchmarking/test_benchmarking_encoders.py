"""The benchmark's encoders and NumPy decoders agree with the package's decoders."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.benchmarking.decoding import recorded_wire, synthetic_wire
from etd_ros.benchmarking.event_path import ENCODINGS, RECORDED_WIRES
from etd_ros.benchmarking.references import NUMPY_DECODERS, event_bodies
from etd_ros.benchmarking.streams import SYNTHETIC, synthetic
from etd_ros.events import Events, concatenate

IN_MICROSECONDS = ("evt3", "libcaer_cmp", "libcaer")

streams = st.builds(
    synthetic,
    st.sampled_from(sorted(SYNTHETIC)),
    st.just(346),
    st.just(260),
    st.integers(1, 3000),
    st.sampled_from([1e5, 1e7, 1e8]),
    st.integers(0, 99),
)


def in_microseconds(events: Events, start_us: int) -> set[tuple[int, int, int, int]]:
    """Events that share pixel, polarity and microsecond are one bit of a mask: they count once."""
    us = events.t // 1000 - start_us
    return set(zip(us.tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist(), strict=True))


@pytest.mark.parametrize("what", ENCODINGS)
@given(stream=streams)
@settings(deadline=None, max_examples=8)
def test_what_is_encoded_is_what_is_decoded(what, stream):
    decoded = concatenate(synthetic_wire(what, stream).decoded())
    if what in IN_MICROSECONDS:
        sent, received = (in_microseconds(events, int(events.t[0]) // 1000) for events in (stream.events, decoded))
        assert sent == received
    else:
        assert np.array_equal(decoded.to_structured(), stream.events.to_structured())


@pytest.mark.parametrize("what", sorted(NUMPY_DECODERS))
@given(stream=streams)
@settings(deadline=None, max_examples=8)
def test_the_numpy_stand_ins_decode_the_same_events(what, stream):
    wire = synthetic_wire(what, stream)
    batches = wire.decoded()
    bodies = event_bodies(what, wire.messages, [len(events) for events in batches])
    for events, body in zip(batches, bodies, strict=True):
        for ours, theirs in zip((events.t, events.x, events.y, events.p), NUMPY_DECODERS[what](*body), strict=True):
            assert ours.dtype == theirs.dtype
            assert np.array_equal(ours, theirs)


def test_a_flicker_of_evt3_is_mostly_masks():
    wire = synthetic_wire("evt3", synthetic("flicker", 640, 480, 20_000, 5e7))
    assert sum(map(len, wire.messages)) < 20_000


@pytest.mark.parametrize(("what", "name"), sorted(RECORDED_WIRES.items()))
def test_recorded_messages_are_repeated_to_the_length_wanted(what, name, data):
    once, twice = (recorded_wire(what, name, data, events) for events in (1, 2_000_000))
    assert once is not None
    assert twice is not None
    assert len(twice.messages) % len(once.messages) == 0
    assert sum(map(len, replace(twice, messages=once.messages).decoded())) * len(twice.messages) >= 2_000_000 * len(
        once.messages
    )


def test_a_recording_that_is_not_there_is_left_out(tmp_path: Path):
    assert recorded_wire("evt3", "driver evt3", tmp_path, 1) is None
