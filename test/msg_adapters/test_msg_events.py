"""Messages of events: both layouts, every type, cut at every byte, garbage, and what real Fast CDR writes."""

import array

import numpy as np
import pytest
from dvs_msgs.msg import Event, EventArray
from event_camera_msgs.msg import EventPacket
from hypothesis import given, settings
from hypothesis import strategies as st
from msg_oracles import NS, event_array, events_of, mono_payload, packet, rows, rows_of, words
from rclpy.serialization import deserialize_message, serialize_message

from etd_ros.events import Events
from msg_adapters import (
    ENCODINGS,
    EVENT_TYPES,
    Layout,
    MessageError,
    decoder_for,
    encode_event_packet,
    packet_to_ros2,
    ros2_type_name,
)

EXAMPLES = settings(deadline=None, max_examples=40)
LAYOUTS = st.sampled_from(Layout)
PACKET_TYPE = "event_camera_msgs/msg/EventPacket"
ARRAY_TYPES = sorted(name for name in EVENT_TYPES if name.endswith("EventArray") and "event_array" not in name)
BOTH_LAYOUTS = pytest.mark.parametrize("layout", Layout)
SOME_EVENTS = [(NS + 5, 3, 2, 1), (NS + 6, 0, 0, 0), (2 * NS, 639, 479, 1)]


def decode(message, layout=Layout.ROS2, type_name=PACKET_TYPE):
    return decoder_for(type_name, layout).decode(message)


@EXAMPLES
@given(rows(640, 480, time_max=2**32 - 1), LAYOUTS, st.text(max_size=9).filter(lambda text: "\0" not in text))
def test_a_packet_returns_its_fields_and_events_in_either_layout(events, layout, frame_id):
    events = [(t + 9 * NS, x, y, p) for t, x, y, p in events]
    message = packet(mono_payload(events, 9 * NS), layout=layout, seq=2**63, base_ns=9 * NS, frame_id=frame_id)
    decoded = decode(message, layout)
    assert rows_of(decoded.events) == events
    assert (decoded.events.width, decoded.events.height) == (640, 480)
    assert (decoded.stamp_ns, decoded.frame_id, decoded.seq) == (5 * NS + 7, frame_id, 2**63)
    assert (decoded.encoding, decoded.is_sensor_time, len(decoded.triggers)) == ("mono", False, 0)


@EXAMPLES
@given(rows(640, 480, time_max=2**32 - 1), LAYOUTS)
def test_an_encoded_packet_is_the_message_of_its_layout(events, layout):
    base_ns = events[0][0] if events else 77
    message = encode_event_packet(
        events_of(events, 640, 480), stamp_ns=77, frame_id="davis", seq=3 if layout is Layout.ROS2 else 4, layout=layout
    )
    decoded = decode(message, layout)
    assert rows_of(decoded.events) == events
    expected = packet(mono_payload(events, base_ns), layout=layout, base_ns=base_ns, stamp_ns=77, frame_id="davis")
    assert len(message) == len(expected)
    assert (decoded.stamp_ns, decoded.frame_id, decoded.encoding) == (77, "davis", "mono")


def test_events_longer_than_a_packet_are_refused():
    events = events_of([(0, 1, 1, 1), (2**32, 1, 1, 1)], 640, 480)
    with pytest.raises(MessageError, match="split"):
        encode_event_packet(events, stamp_ns=0, frame_id="", seq=0)


def test_real_ros_2_reads_the_packets_written_here():
    message = encode_event_packet(events_of(SOME_EVENTS, 640, 480), stamp_ns=2 * NS + 1, frame_id="cam", seq=12)
    read = deserialize_message(message, EventPacket)
    assert (read.header.stamp.sec, read.header.stamp.nanosec, read.header.frame_id) == (2, 1, "cam")
    assert (read.width, read.height, read.seq, read.time_base) == (640, 480, 12, NS + 5)
    assert (read.encoding, read.is_bigendian) == ("mono", False)
    assert bytes(read.events) == mono_payload(SOME_EVENTS, NS + 5)


def test_the_packets_that_real_ros_2_writes_are_read_here():
    sent = EventPacket(width=640, height=480, seq=12, time_base=NS, encoding="mono")
    sent.header.frame_id = "camera"
    sent.events = array.array("B", mono_payload(SOME_EVENTS, NS))
    decoded = decode(serialize_message(sent))
    assert rows_of(decoded.events) == SOME_EVENTS
    assert (decoded.frame_id, decoded.seq) == ("camera", 12)


@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_the_event_arrays_that_real_ros_2_writes_are_read_here(count):
    sent = EventArray(width=640, height=480)
    sent.header.frame_id = "camera"
    expected = [(k * NS + k, 600 - k, 400 + k, k % 2) for k in range(count)]
    for t, x, y, p in expected:
        event = Event(x=x, y=y, polarity=bool(p))
        event.ts.sec, event.ts.nanosec = divmod(t, NS)
        sent.events.append(event)
    decoded = decode(serialize_message(sent), type_name="dvs_msgs/msg/EventArray")
    assert rows_of(decoded.events) == expected
    assert (decoded.frame_id, decoded.seq, decoded.encoding) == ("camera", None, "array")


@pytest.mark.parametrize("type_name", ARRAY_TYPES)
@EXAMPLES
@given(events=rows(65535, 65535, time_max=2**31 * NS - 1), layout=LAYOUTS, frame_id=st.text("ab", max_size=5))
def test_an_event_array_returns_what_was_encoded_in_either_layout(type_name, events, layout, frame_id):
    message = event_array(events, layout=layout, width=65535, height=65535, stamp_ns=NS + 3, frame_id=frame_id)
    decoded = decode(message, layout, type_name)
    assert rows_of(decoded.events) == events
    assert (decoded.stamp_ns, decoded.frame_id, decoded.is_sensor_time) == (NS + 3, frame_id, False)


@BOTH_LAYOUTS
def test_events_off_the_sensor_are_dropped_and_counted(layout):
    events = [(1, 9, 9, 1), (2, 10, 9, 1), (3, 9, 10, 0), (4, 0, 0, 1)]
    kept = [events[0], events[3]]
    from_array = decode(event_array(events, layout=layout, width=10, height=10), layout, "dvs_msgs/EventArray")
    from_packet = decode(packet(mono_payload(events, 0), layout=layout, width=10, height=10), layout)
    for decoded in (from_array, from_packet):
        assert (rows_of(decoded.events), decoded.off_sensor) == (kept, 2)


@BOTH_LAYOUTS
def test_times_that_fall_inside_a_message_are_delivered_as_they_are(layout):
    events = [(5, 1, 1, 1), (3, 2, 2, 0)]
    message = event_array(events, layout=layout, width=10, height=10)
    assert rows_of(decode(message, layout, "dvs_msgs/EventArray").events) == events


@BOTH_LAYOUTS
@pytest.mark.parametrize("type_name", [PACKET_TYPE, "dvs_msgs/msg/EventArray"])
def test_a_message_cut_at_any_byte_is_refused(layout, type_name):
    if type_name == PACKET_TYPE:
        message = packet(mono_payload(SOME_EVENTS, 0), layout=layout)
    else:
        message = event_array(SOME_EVENTS, layout=layout, width=640, height=480)
    assert len(decode(message, layout, type_name).events) == len(SOME_EVENTS)
    for size in range(len(message)):
        with pytest.raises(MessageError):
            decode(message[:size], layout, type_name)


@pytest.mark.parametrize("type_name", sorted(EVENT_TYPES))
@EXAMPLES
@given(data=st.binary(max_size=120), layout=LAYOUTS, has_head=st.booleans())
def test_garbage_gives_valid_events_or_an_error(type_name, data, layout, has_head):
    check_result(b"\0\1\0\0" + data if has_head else data, layout, type_name)


@EXAMPLES
@given(data=st.data(), layout=LAYOUTS, is_packet=st.booleans())
def test_a_message_with_any_byte_changed_gives_valid_events_or_an_error(data, layout, is_packet):
    if is_packet:
        message = bytearray(packet(mono_payload(SOME_EVENTS, 0), layout=layout))
    else:
        message = bytearray(event_array(SOME_EVENTS, layout=layout, width=640, height=480))
    message[data.draw(st.integers(0, len(message) - 1))] = data.draw(st.integers(0, 255))
    check_result(message, layout, PACKET_TYPE if is_packet else "dvs_msgs/msg/EventArray")


def check_result(message, layout, type_name):
    try:
        events = decode(message, layout, type_name).events
    except MessageError:
        return
    Events(np.sort(events.t), events.x, events.y, events.p, events.width, events.height).check()


@BOTH_LAYOUTS
def test_a_count_of_events_that_are_not_there_is_refused_before_memory_is_taken(layout):
    message = bytearray(event_array([], layout=layout, width=640, height=480))
    message[-4:] = b"\xff\xff\xff\xff"
    with pytest.raises(MessageError, match="4294967295 items"):
        decode(message, layout, "dvs_msgs/msg/EventArray")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"encoding": "evt9"}, "evt3, libcaer, libcaer_cmp, mono, trigger"),
        ({"width": 0}, "1..65535"),
        ({"height": 65536}, "1..65535"),
        ({"is_bigendian": True}, "big-endian"),
        ({"base_ns": 2**63}, "time base"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else None,
)
def test_a_packet_that_cannot_be_is_refused_with_the_reason(change, text):
    with pytest.raises(MessageError, match=text):
        decode(packet(b"", **change))


@pytest.mark.parametrize(("width", "height"), [(0, 480), (640, 0), (65536, 1)])
def test_an_event_array_of_an_impossible_size_is_refused(width, height):
    with pytest.raises(MessageError, match=r"1\.\.65535"):
        decode(event_array([], layout=Layout.ROS2, width=width, height=height), type_name="dvs_msgs/EventArray")


EVT3_START = words("H", [0x8000, 0x6001])
EVT3_EVENT = words("H", [0x0002, 0x2003])


def test_evt3_goes_on_from_message_to_message_and_has_sensor_time():
    decoder = decoder_for(PACKET_TYPE, Layout.ROS2)
    decoder.decode(packet(EVT3_START, encoding="evt3"))
    decoded = decoder.decode(packet(EVT3_EVENT, encoding="evt3"))
    assert rows_of(decoded.events) == [(1000, 3, 2, 0)]
    assert decoded.is_sensor_time


@pytest.mark.parametrize("between", [{"encoding": "mono"}, {"encoding": "evt3", "width": 320}])
def test_a_new_encoding_or_size_starts_the_codec_anew(between):
    decoder = decoder_for(PACKET_TYPE, Layout.ROS2)
    decoder.decode(packet(EVT3_START, encoding="evt3"))
    decoder.decode(packet(b"", **between))
    assert len(decoder.decode(packet(EVT3_EVENT, encoding="evt3")).events) == 0


def test_a_reset_starts_the_codec_anew():
    decoder = decoder_for(PACKET_TYPE, Layout.ROS2)
    decoder.decode(packet(EVT3_START, encoding="evt3"))
    decoder.reset()
    assert len(decoder.decode(packet(EVT3_EVENT, encoding="evt3")).events) == 0


def test_a_bad_message_leaves_the_stream_decodable():
    decoder = decoder_for(PACKET_TYPE, Layout.ROS2)
    decoder.decode(packet(EVT3_START, encoding="evt3"))
    with pytest.raises(MessageError):
        decoder.decode(packet(EVT3_EVENT, encoding="evt3")[:-1])
    assert len(decoder.decode(packet(EVT3_EVENT, encoding="evt3")).events) == 1


def test_a_trigger_packet_has_triggers_only():
    decoded = decode(packet(words("Q", [1 << 63 | 2 << 48 | 5]), encoding="trigger", base_ns=NS))
    assert (len(decoded.events), decoded.triggers.t.tolist(), decoded.triggers.id.tolist()) == (0, [NS + 5], [2])


@pytest.mark.parametrize("encoding", sorted(ENCODINGS))
def test_a_ros_1_packet_becomes_the_same_packet_of_ros_2(encoding):
    payload = bytes(range(32))
    read = deserialize_message(
        packet_to_ros2(packet(payload, layout=Layout.ROS1, encoding=encoding, seq=8, base_ns=9)), EventPacket
    )
    assert (read.encoding, read.seq, read.time_base, bytes(read.events)) == (encoding, 8, 9, payload)
    assert (read.width, read.height, read.header.frame_id) == (640, 480, "camera")
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == (5, 7)


@pytest.mark.parametrize("buffer", [bytes, bytearray, memoryview])
def test_any_buffer_is_a_message(buffer):
    assert rows_of(decode(buffer(packet(mono_payload(SOME_EVENTS, 0)))).events) == SOME_EVENTS


def test_types_are_known_by_their_ros_1_names_too():
    assert ros2_type_name("dvs_msgs/EventArray") == "dvs_msgs/msg/EventArray"
    assert {ros2_type_name(name.replace("/msg/", "/")) for name in EVENT_TYPES} == EVENT_TYPES
    assert {ros2_type_name(name) for name in EVENT_TYPES} == EVENT_TYPES


def test_an_unknown_type_is_refused_with_the_known_ones():
    with pytest.raises(MessageError, match="dvs_msgs/msg/EventArray"):
        decoder_for("sensor_msgs/msg/Image", Layout.ROS2)
