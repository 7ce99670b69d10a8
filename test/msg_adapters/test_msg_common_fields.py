"""A decoder that knows a topic's messages reads the next one as a decoder does that has seen none."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msg_oracles import NS, event_array, libcaer_payload, mono_payload, packet, rows_of

from msg_adapters import Layout, MessageError, decoder_for

EXAMPLES = settings(deadline=None, max_examples=60)
BOTH_LAYOUTS = pytest.mark.parametrize("layout", Layout)
TYPES = pytest.mark.parametrize("type_name", ["event_camera_msgs/msg/EventPacket", "dvs_msgs/msg/EventArray"])
SIZES = st.sampled_from([*[(640, 480)] * 5, (640, 481), (0, 480), (65536, 480)])
FRAMES = st.sampled_from(["cam", "cam", "map", "", "kämera"])
ENCODINGS = {"mono": mono_payload, "libcaer": libcaer_payload}


def some_events(count, first_ns=NS):
    return [(first_ns + 1000 * k, k % 640, k % 480, k % 2) for k in range(count)]


@st.composite
def messages(draw, type_name, layout):
    """A message that often has all fields, but its stamp and events, in common with the last one."""
    events, (width, height) = some_events(draw(st.integers(0, 3))), draw(SIZES)
    stamp_ns, frame_id = draw(st.integers(0, 2**31 * NS - 1)), draw(FRAMES)
    common = {"layout": layout, "width": width, "height": height, "stamp_ns": stamp_ns, "frame_id": frame_id}
    if type_name.endswith("EventArray"):
        return event_array(events, **common)
    encoding = draw(st.sampled_from(sorted(ENCODINGS)))
    return packet(
        ENCODINGS[encoding](events, NS),
        encoding=encoding,
        base_ns=draw(st.sampled_from([NS, NS, NS, NS, 2**63])),
        seq=draw(st.integers(0, 2**64 - 1)),
        is_bigendian=draw(st.integers(0, 5)) == 5,
        **common,
    )


def plain_message(type_name, layout):
    if type_name.endswith("EventArray"):
        return event_array(some_events(3), layout=layout, width=640, height=480)
    return packet(mono_payload(some_events(3), NS), layout=layout, base_ns=NS)


def outcome(decoder, message):
    """All that a message says, or the error."""
    try:
        decoded = decoder.decode(message)
    except MessageError as err:
        return str(err)
    events = decoded.events
    return rows_of(events), (events.width, events.height), decoded._replace(events=None, triggers=len(decoded.triggers))


def check_the_same_as_anew(decoder, message, type_name, layout):
    assert outcome(decoder, message) == outcome(decoder_for(type_name, layout), message)


@TYPES
@BOTH_LAYOUTS
@EXAMPLES
@given(data=st.data())
def test_every_message_of_a_stream_is_read_as_if_it_were_the_first(type_name, layout, data):
    decoder = decoder_for(type_name, layout)
    for message in data.draw(st.lists(messages(type_name, layout), min_size=2, max_size=6)):
        check_the_same_as_anew(decoder, message, type_name, layout)


@TYPES
@BOTH_LAYOUTS
def test_a_message_cut_at_any_byte_is_refused_after_a_whole_one_too(type_name, layout):
    decoder = decoder_for(type_name, layout)
    message = plain_message(type_name, layout)
    for size in range(len(message)):
        assert rows_of(decoder.decode(message).events) == some_events(3)
        with pytest.raises(MessageError):
            decoder.decode(message[:size])


@TYPES
@BOTH_LAYOUTS
def test_a_message_with_any_byte_changed_is_read_as_if_it_were_the_first(type_name, layout):
    decoder = decoder_for(type_name, layout)
    message = plain_message(type_name, layout)
    for place in range(len(message)):
        for change in (1, 0x80, 0xFF):
            decoder.decode(message)
            changed = bytearray(message)
            changed[place] ^= change
            check_the_same_as_anew(decoder, changed, type_name, layout)


@TYPES
@BOTH_LAYOUTS
def test_the_same_topic_in_the_other_layout_is_refused_or_read_as_if_it_were_the_first(type_name, layout):
    decoder = decoder_for(type_name, layout)
    decoder.decode(plain_message(type_name, layout))
    other = Layout.ROS1 if layout is Layout.ROS2 else Layout.ROS2
    check_the_same_as_anew(decoder, plain_message(type_name, other), type_name, layout)
