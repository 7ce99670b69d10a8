"""Codecs: round trips through readable encoders, agreement with readable decoders on any words, state, bounds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msg_oracles import (
    decode_evt3,
    decode_libcaer_cmp,
    events_of,
    evt2_payload,
    evt3_payload,
    evt21_payload,
    libcaer_cmp_payload,
    libcaer_payload,
    mono_payload,
    rows,
    rows_of,
    words,
)

from etd_ros.events import Events
from msg_adapters import Evt2Decoder, Evt3Decoder, Evt21Decoder, MessageError
from msg_adapters.codecs import LibcaerCmpDecoder, LibcaerDecoder, MonoDecoder, TriggerDecoder, encode_mono
from msg_adapters.codecs.words import MESSAGE_EVENTS_MAX

WIDTH, HEIGHT = 1280, 720
BASE_NS = 1_700_000_000_000_000_000
EXAMPLES = settings(deadline=None, max_examples=40)

ANY_CODEC = pytest.mark.parametrize(
    "codec",
    [Evt2Decoder, Evt21Decoder, Evt3Decoder, LibcaerDecoder, LibcaerCmpDecoder, MonoDecoder, TriggerDecoder],
    ids=lambda codec: codec.__name__,
)


def shifted(events, base_ns):
    return [(t + base_ns, x, y, p) for t, x, y, p in events]


@EXAMPLES
@given(rows(WIDTH, HEIGHT, time_max=2**32 - 1))
def test_mono_returns_what_was_encoded(events):
    events = shifted(events, BASE_NS)
    assert rows_of(MonoDecoder().decode(mono_payload(events, BASE_NS), WIDTH, HEIGHT, BASE_NS).events) == events


@EXAMPLES
@given(rows(65535, 32768, time_max=2**32 - 1))
def test_the_mono_encoder_writes_the_words_of_the_format(events):
    events = shifted(events, BASE_NS)
    assert encode_mono(events_of(events, 65535, 32768), BASE_NS).tobytes() == mono_payload(events, BASE_NS)


@pytest.mark.parametrize(
    ("t_ns", "row"), [(BASE_NS - 1, 0), (BASE_NS + 2**32, 0), (BASE_NS, 32768)], ids=["early", "late", "row"]
)
def test_the_mono_encoder_refuses_what_its_words_cannot_hold(t_ns, row):
    with pytest.raises(MessageError):
        encode_mono(events_of([(t_ns, 0, row, 0)], 100, 40000), BASE_NS)


@EXAMPLES
@given(rows(WIDTH, HEIGHT, time_max=2**31 - 1, unit_ns=1000))
def test_libcaer_returns_what_was_encoded(events):
    events = shifted(events, BASE_NS)
    assert rows_of(LibcaerDecoder().decode(libcaer_payload(events, BASE_NS), WIDTH, HEIGHT, BASE_NS).events) == events


def test_libcaer_time_goes_on_when_its_31_bits_wrap_inside_a_packet():
    events = [((2**31 + us) * 1000, 3, 4, 1) for us in (-2, -1, 0, 5)]
    assert rows_of(LibcaerDecoder().decode(libcaer_payload(events, 0), WIDTH, HEIGHT).events) == events


@EXAMPLES
@given(rows(WIDTH, HEIGHT, time_max=2**24 - 1, unit_ns=1000), st.booleans())
def test_libcaer_cmp_returns_what_was_encoded(events, as_masks):
    events = shifted(events, BASE_NS)
    payload = libcaer_cmp_payload(events, BASE_NS, as_masks=as_masks)
    assert rows_of(LibcaerCmpDecoder().decode(payload, WIDTH, HEIGHT, BASE_NS).events) == events


def test_libcaer_cmp_starts_every_message_with_time_0():
    codec = LibcaerCmpDecoder()
    codec.decode(words("H", [0x0001, 0x1001, 0x2001, 0x3001]), WIDTH, HEIGHT)
    assert rows_of(codec.decode(words("H", [0x2001, 0x3002]), WIDTH, HEIGHT, 7).events) == [(7, 1, 2, 0)]


@EXAMPLES
@given(st.binary(max_size=400).map(lambda data: data[: len(data) // 2 * 2]))
def test_libcaer_cmp_reads_any_words_as_the_table_says(payload):
    decoded = LibcaerCmpDecoder().decode(payload, 700, 500, BASE_NS)
    expected = decode_libcaer_cmp(payload, 700, 500, BASE_NS)
    assert (rows_of(decoded.events), decoded.skipped_words, decoded.off_sensor) == expected


@EXAMPLES
@given(rows(WIDTH, HEIGHT, time_max=3 * 2**24, unit_ns=1000, max_size=8), st.sampled_from([0, 8, 12]))
def test_evt3_returns_what_was_encoded_over_wraps_of_its_time(events, mask_bits):
    assert rows_of(Evt3Decoder().decode(evt3_payload(events, mask_bits), WIDTH, HEIGHT).events) == events


def joined(parts):
    return [word for part in parts for word in part]


EVT3_ANY_WORD = st.one_of(
    st.integers(0, 0xFFFF),
    st.builds(lambda code, value: code << 12 | value, st.sampled_from([2, 3, 4, 5, 6, 8]), st.integers(0, 0xFFF)),
)
EVT3_REGULAR_RUN = st.lists(
    st.builds(
        lambda high, low, row, single: [*high, 0x6000 | low, row, 0x2000 | single],
        st.sampled_from([[], [0x8001], [0x8001], [0x8001, 0x8001], [0x8002]]),
        *[st.integers(0, 0xFFF)] * 3,
    ),
    max_size=40,
).map(joined)
"""A time, a row and an event each."""
EVT3_WORDS = st.lists(st.one_of(EVT3_ANY_WORD.map(lambda word: [word]), EVT3_REGULAR_RUN), max_size=50).map(joined)


@EXAMPLES
@given(EVT3_WORDS, st.booleans(), st.integers(0, 300))
def test_evt3_reads_any_words_as_the_table_says_however_they_are_cut(said, is_synchronised, cut):
    said = [0x8001, 0x6002, *said] if is_synchronised else said
    codec = Evt3Decoder()
    parts = [codec.decode(words("H", part), 1000, 700) for part in (said[:cut], said[cut:])]
    found = [row for part in parts for row in rows_of(part.events)]
    skipped, off_sensor = sum(part.skipped_words for part in parts), sum(part.off_sensor for part in parts)
    assert (found, skipped, off_sensor) == decode_evt3(words("H", said), 1000, 700)


def test_evt3_emits_nothing_before_one_time_high_followed_by_one_time_low():
    event = [0x0005, 0x2007]
    said = [*event, 0x6003, *event, 0x8001, *event, 0x6004, *event]
    decoded = Evt3Decoder().decode(words("H", said), WIDTH, HEIGHT)
    assert rows_of(decoded.events) == [((1 << 12 | 4) * 1000, 7, 5, 0)]


@pytest.mark.parametrize(("fall", "loops"), [(10, 0), (11, 1)])
def test_evt3_takes_small_falls_of_time_high_for_bit_errors_and_large_ones_for_wraps(fall, loops):
    said = [0x8000 | 100, 0x6000, 0x0001, 0x8000 | 100 - fall, 0x2001]
    decoded = Evt3Decoder().decode(words("H", said), WIDTH, HEIGHT)
    assert decoded.events.t.tolist() == [1000 * (loops << 24 | 100 - fall << 12)]


def test_evt3_gives_triggers_apart_and_counts_padding():
    decoded = Evt3Decoder().decode(words("H", [0x8000, 0x6009, 0x9999, 0xA301, 0xE123, 0x6010, 0xA200]), WIDTH, HEIGHT)
    triggers = decoded.triggers
    assert (triggers.t.tolist(), triggers.id.tolist(), triggers.edge.tolist()) == ([9000, 16000], [3, 2], [1, 0])
    assert (len(decoded.events), decoded.skipped_words) == (0, 1)


def test_evt3_gives_triggers_among_more_events_than_there_are_words():
    said = [0x8000, 0x6000, 0x0005, *[0x3000, 0x4FFF, 0xA301, 0x6009, 0xA200] * 1000]
    decoded = Evt3Decoder().decode(words("H", said), WIDTH, HEIGHT)
    triggers = decoded.triggers
    assert decoded.events.x.tolist() == list(range(12)) * 1000
    assert (triggers.t.tolist(), triggers.id.tolist()) == ([0, *[9000] * 1999], [3, 2] * 1000)
    assert triggers.edge.tolist() == [1, 0] * 1000


def test_evt3_triggers_are_kept_when_the_next_message_is_decoded():
    codec = Evt3Decoder()
    triggers = codec.decode(words("H", [0x8000, 0x6009, 0xA301]), WIDTH, HEIGHT).triggers
    codec.decode(words("H", [0x600A, 0xA400]), WIDTH, HEIGHT)
    assert (triggers.t.tolist(), triggers.id.tolist(), triggers.edge.tolist()) == ([9000], [3], [1])


@pytest.mark.parametrize("is_time_first", [False, True])
def test_evt3_learns_nothing_from_a_message_that_is_refused(is_time_first):
    codec = Evt3Decoder()
    time, masks = [0x8001, 0x6002, 0x0007, 0x3009], [0x4FFF] * (MESSAGE_EVENTS_MAX // 12 + 1)
    with pytest.raises(MessageError, match="smaller messages"):
        codec.decode(words("H", [*time, *masks] if is_time_first else [*masks, *time]), WIDTH, HEIGHT)
    for _ in range(2):
        assert len(codec.decode(words("H", [0x0005, 0x2005]), WIDTH, HEIGHT).events) == 0
    told = codec.decode(words("H", [0x8000, 0x6001, 0x4001]), WIDTH, HEIGHT)
    assert rows_of(told.events) == [(1000, 0, 5, 0)]


@pytest.mark.parametrize(
    "messages",
    [
        pytest.param([[0x8FFF, 0x6000, 0x8000], [0x8000, 0x6001, 0x0005, 0x2003] * 3], id="after a wrap"),
        pytest.param(
            [[0x8001, 0x6000, *[0x8001, 0x6001, 0x0005, 0x2003] * 3, 0x2004, 0x4001]], id="then its row again"
        ),
        pytest.param([[0x8001, 0x6000, *[0x6001, 0x0805, 0x2803] * 3, 0x2804]], id="with a system type beside the row"),
        pytest.param(
            [[0x8001, 0x6000], *[[0x0005, 0x2003, 0x8001, 0x6001] * 40] * 3], id="cut in the middle of a group"
        ),
        pytest.param([[0x8001, 0x6000], [0x6001, 0x0005, 0x2003], [0x2004], [0x6002, 0x0006]], id="in short messages"),
    ],
)
def test_evt3_goes_on_where_a_run_of_times_rows_and_events_ends(messages):
    codec = Evt3Decoder()
    found = [row for said in messages for row in rows_of(codec.decode(words("H", said), 1000, 700).events)]
    assert found == decode_evt3(words("H", joined(messages)), 1000, 700)[0]


def test_evt3_triggers_that_are_kept_keep_no_events():
    codec = Evt3Decoder()
    triggers = codec.decode(words("H", [0x8000, 0x6009, 0xA301, *[0x2000] * 9]), WIDTH, HEIGHT).triggers
    assert [array.base for array in (triggers.t, triggers.id, triggers.edge)] == [None] * 3


def test_evt3_forgets_its_time_on_reset():
    codec = Evt3Decoder()
    codec.decode(words("H", [0x8000, 0x6009]), WIDTH, HEIGHT)
    codec.reset()
    assert len(codec.decode(words("H", [0x0001, 0x2001]), WIDTH, HEIGHT).events) == 0


@pytest.mark.parametrize("mask", [0x4FFF, 0x50FF])
def test_a_senseless_run_of_evt3_masks_leaves_the_sensor_and_does_not_come_back(mask):
    said = [0x8000, 0x6000, 0x0005, 0x3000 | 1270, *[mask] * 20_000]
    decoded = Evt3Decoder().decode(words("H", said), WIDTH, HEIGHT)
    assert decoded.events.x.tolist() == list(range(1270, 1280))
    assert decoded.off_sensor == 20_000 * (mask & 0xFFF).bit_count() - 10


def test_a_senseless_run_of_libcaer_cmp_masks_leaves_the_sensor_and_does_not_come_back():
    said = [0x2005, 0x4000 | 710, *[0x50FF] * 20_000]
    decoded = LibcaerCmpDecoder().decode(words("H", said), WIDTH, HEIGHT)
    assert decoded.events.y.tolist() == list(range(710, 720))
    assert decoded.off_sensor == 20_000 * 8 - 10


@EXAMPLES
@given(st.lists(EVT3_WORDS, max_size=5))
def test_one_evt3_decoder_reads_payload_after_payload_as_the_table_says(payloads):
    codec, said, kept = Evt3Decoder(), [], []
    for payload in payloads:
        said += payload
        kept.append(codec.decode(words("H", payload), 1000, 700).events)
    assert [row for events in kept for row in rows_of(events)] == decode_evt3(words("H", said), 1000, 700)[0]


def test_trigger_words_are_no_events():
    decoded = TriggerDecoder().decode(words("Q", [1 << 63 | 5 << 48 | 77, 6 << 48 | 78]), WIDTH, HEIGHT, BASE_NS)
    triggers = decoded.triggers
    assert triggers.t.tolist() == [BASE_NS + 77, BASE_NS + 78]
    assert (triggers.id.tolist(), triggers.edge.tolist(), len(decoded.events)) == ([5, 6], [1, 0], 0)


@EXAMPLES
@given(rows(WIDTH, HEIGHT, time_max=2**34 - 1, unit_ns=1000))
def test_evt2_returns_what_was_encoded(events):
    assert rows_of(Evt2Decoder().decode(evt2_payload(events), WIDTH, HEIGHT).events) == events


@EXAMPLES
@given(rows(WIDTH, HEIGHT, time_max=2**34 - 1, unit_ns=1000), st.booleans())
def test_evt21_returns_what_was_encoded(events, halves_swapped):
    payload = evt21_payload(events, halves_swapped=halves_swapped)
    codec = Evt21Decoder(halves_swapped=halves_swapped)
    assert rows_of(codec.decode(payload, WIDTH, HEIGHT).events) == events


@pytest.mark.parametrize(("codec", "encode"), [(Evt2Decoder, evt2_payload), (Evt21Decoder, evt21_payload)])
def test_evt2_and_evt21_go_on_over_a_wrap_and_from_payload_to_payload(codec, encode):
    events = [((2**34 + us) * 1000, 40, 4, 1) for us in (-64, -1, 0, 63, 64)]
    decoder = codec()
    found = [row for event in events for row in rows_of(decoder.decode(encode([event]), WIDTH, HEIGHT).events)]
    assert found == events


@pytest.mark.parametrize(
    ("codec", "payload"),
    [
        (Evt2Decoder, words("I", [0x8000_0001, 0xA << 28 | 5 << 22 | 9 << 8 | 1, 0x7000_0000])),
        (Evt21Decoder, words("Q", [0x8 << 60 | 1 << 32, 0xA << 60 | 5 << 54 | 9 << 40 | 1 << 32, 0x7 << 60])),
    ],
)
def test_evt2_and_evt21_give_triggers_apart_and_count_unknown_words(codec, payload):
    decoded = codec().decode(payload, WIDTH, HEIGHT)
    triggers = decoded.triggers
    assert (triggers.t.tolist(), triggers.id.tolist(), triggers.edge.tolist()) == ([69_000], [9], [1])
    assert (len(decoded.events), decoded.skipped_words) == (0, 1)


@pytest.mark.parametrize(
    ("codec", "payload"),
    [(Evt2Decoder, words("I", [0x1000_0801])), (Evt21Decoder, words("Q", [1 << 60 | 1]))],
)
def test_evt2_and_evt21_emit_nothing_before_a_time_high(codec, payload):
    assert len(codec().decode(payload, WIDTH, HEIGHT).events) == 0


def test_evt21_masks_give_an_event_for_each_bit_on_the_sensor():
    payload = words("Q", [0x8 << 60, 1 << 60 | 630 << 43 | 2 << 32 | 1 << 31 | 0b1001_0000_0001])
    decoded = Evt21Decoder().decode(payload, 640, 480)
    assert rows_of(decoded.events) == [(0, 630, 2, 1), (0, 638, 2, 1)]
    assert decoded.off_sensor == 2


@EXAMPLES
@given(st.lists(st.tuples(st.integers(0, 700), st.integers(0, 500), st.integers(0, 1), st.integers(0, 2**32 - 1))))
def test_evt21_reads_any_masks_bit_by_bit(vectors):
    said = [0x8 << 60, *(p << 60 | x << 43 | y << 32 | mask for x, y, p, mask in vectors)]
    every = [(0, x + i, y, p) for x, y, p, mask in vectors for i in range(32) if mask >> i & 1]
    decoded = Evt21Decoder().decode(words("Q", said), 640, 480)
    expected = [row for row in every if row[1] < 640 and row[2] < 480]
    assert rows_of(decoded.events) == expected
    assert decoded.off_sensor == len(every) - len(expected)


@ANY_CODEC
@EXAMPLES
@given(data=st.binary(max_size=600))
def test_any_bytes_give_valid_events_or_an_error(codec, data):
    try:
        decoded = codec().decode(data, 300, 200, BASE_NS)
    except MessageError:
        return
    events = decoded.events
    assert (events.width, events.height) == (300, 200)
    Events(np.sort(events.t), events.x, events.y, events.p, 300, 200).check()


@ANY_CODEC
def test_a_payload_that_ends_inside_a_word_is_refused(codec):
    with pytest.raises(MessageError, match="cut short"):
        codec().decode(b"\0" * 17, WIDTH, HEIGHT)


@ANY_CODEC
def test_an_empty_payload_has_no_events(codec):
    assert len(codec().decode(b"", WIDTH, HEIGHT).events) == 0
