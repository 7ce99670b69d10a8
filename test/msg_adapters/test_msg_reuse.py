"""Decoders use their arrays again: nothing is allocated message after message, and nothing that is kept changes."""

import tracemalloc

import numpy as np
import pytest
from msg_oracles import (
    event_array,
    evt3_payload,
    libcaer_cmp_payload,
    libcaer_payload,
    mono_payload,
    packet,
    rows_of,
    words,
)
from numba.core.dispatcher import Dispatcher

import msg_adapters.event_array
from msg_adapters import Layout, decoder_for
from msg_adapters.codecs import evt3, libcaer, libcaer_cmp, mono
from msg_adapters.codecs import words as codec_words

PACKET_TYPE = "event_camera_msgs/msg/EventPacket"
ARRAY_TYPE = "dvs_msgs/msg/EventArray"
KERNEL_MODULES = (evt3, libcaer, libcaer_cmp, mono, codec_words, msg_adapters.event_array)
COLUMN_BYTES_MIN = 10_000
"""The smallest column of the events below is that of the polarities, a byte each."""


def some_events(seed, count=COLUMN_BYTES_MIN):
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, 30_000, count)) * 1000
    x, y, p = rng.integers(0, 640, count), rng.integers(0, 480, count), rng.integers(0, 2, count)
    return list(zip(t.tolist(), x.tolist(), y.tolist(), p.tolist(), strict=True))


def packets(encode, encoding):
    return lambda events: (PACKET_TYPE, Layout.ROS2, packet(encode(events), encoding=encoding))


def arrays(layout):
    return lambda events: (ARRAY_TYPE, layout, event_array(events, layout=layout, width=640, height=480))


EVERY_ENCODING = pytest.mark.parametrize(
    "message_of",
    [
        packets(lambda events: mono_payload(events, 0), "mono"),
        packets(lambda events: libcaer_payload(events, 0), "libcaer"),
        packets(lambda events: libcaer_cmp_payload(events, 0, as_masks=False), "libcaer_cmp"),
        packets(lambda events: libcaer_cmp_payload(events, 0, as_masks=True), "libcaer_cmp"),
        packets(lambda events: evt3_payload(events, 0), "evt3"),
        packets(lambda events: evt3_payload(events, 12), "evt3"),
        arrays(Layout.ROS1),
        arrays(Layout.ROS2),
    ],
    ids=["mono", "libcaer", "libcaer_cmp", "libcaer_cmp masks", "evt3", "evt3 masks", "array ROS 1", "array ROS 2"],
)


def address_of(array):
    """Without `ctypes`, whose objects stay until garbage is collected."""
    return array.__array_interface__["data"][0]


@EVERY_ENCODING
def test_a_thousand_messages_allocate_no_columns(message_of):
    type_name, layout, message = message_of(some_events(1))
    decoder = decoder_for(type_name, layout)
    place = address_of(decoder.decode(message).events.t)
    tracemalloc.start()
    before = tracemalloc.take_snapshot()
    places = {address_of(decoder.decode(message).events.t) for _ in range(1000)}
    growth = [entry.size_diff for entry in tracemalloc.take_snapshot().compare_to(before, "lineno")]
    decoder.decode(message)
    tracemalloc.reset_peak()
    held, _ = tracemalloc.get_traced_memory()
    decoder.decode(message)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert places == {place}
    assert max(growth) < COLUMN_BYTES_MIN
    assert peak - held < COLUMN_BYTES_MIN, "a column was allocated"


@EVERY_ENCODING
def test_events_that_are_kept_are_never_overwritten(message_of):
    expected, kept, decoder = [], [], None
    for seed in range(6):
        events = some_events(seed, count=300)
        type_name, layout, message = message_of(events)
        decoder = decoder or decoder_for(type_name, layout)
        expected.append(events)
        kept.append(decoder.decode(message).events)
        decoder.decode(message)
    assert [rows_of(events) for events in kept] == expected


@EVERY_ENCODING
def test_a_column_that_is_kept_alone_is_never_overwritten(message_of):
    type_name, layout, message = message_of(some_events(1, 500))
    decoder = decoder_for(type_name, layout)
    rows = decoder.decode(message).events.y[5:10]
    before = rows.copy()
    decoder.decode(message_of(some_events(2, 500))[2])
    assert (rows == before).all()


def test_a_long_message_after_a_dense_one_takes_no_memory_for_events_it_does_not_have():
    rows_only, masks = words("H", [0x0005] * 1_000_000), words("H", [0x8000, 0x6000, *[0x4FFF] * 1000])
    decoder = decoder_for(PACKET_TYPE, Layout.ROS2)
    decoder.decode(packet(masks, encoding="evt3"))
    message = packet(rows_only, encoding="evt3")
    tracemalloc.start()
    decoder.decode(message)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    item_bytes = 13
    assert peak < 1.3 * 1_000_000 * item_bytes


@EVERY_ENCODING
def test_messages_of_any_size_and_buffer_run_the_kernels_compiled_first(message_of):
    for count in (0, 1, 2, 3000):
        type_name, layout, message = message_of(some_events(3, count))
        for buffer in (bytes(message), bytearray(message), memoryview(b"!" + message)[1:]):
            assert len(decoder_for(type_name, layout).decode(buffer).events) == count
    kernels = {
        f"{module.__name__}.{name}": len(kernel.signatures)
        for module in KERNEL_MODULES
        for name, kernel in vars(module).items()
        if isinstance(kernel, Dispatcher) and name != "_encode"
    }
    # The records of an EventArray are of another type in each layout.
    assert kernels.pop("msg_adapters.event_array._decode") <= len(Layout)
    assert len(kernels) == 16
    assert max(kernels.values()) == 1, kernels
