"""Diagnostics: round trips, against real ROS 2, cut messages."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from msg_adapters import DiagnosticStatus, Level, MessageError, decode_diagnostics, encode_diagnostics

TEXTS = st.text(max_size=8).filter(lambda text: "\0" not in text)
STATUSES = st.lists(
    st.builds(
        DiagnosticStatus,
        level=st.sampled_from(Level),
        name=TEXTS,
        message=TEXTS,
        hardware_id=TEXTS,
        values=st.lists(st.tuples(TEXTS, TEXTS), max_size=4).map(tuple),
    ),
    max_size=4,
)
TWO = [
    DiagnosticStatus(Level.WARN, "tracker: car", "recovering", "", (("state", "recovering"), ("rate", "31.5"))),
    DiagnosticStatus(Level.OK, "events", "fine", "davis", ()),
]


@settings(deadline=None, max_examples=40)
@given(STATUSES, TEXTS)
def test_statuses_return_as_they_were(statuses, frame_id):
    decoded = decode_diagnostics(encode_diagnostics(statuses, stamp_ns=5, frame_id=frame_id))
    assert (decoded.stamp_ns, decoded.frame_id, list(decoded.statuses)) == (5, frame_id, statuses)


def test_real_ros_2_reads_the_statuses_written_here_and_the_other_way_round():
    read = deserialize_message(encode_diagnostics(TWO, stamp_ns=2_000_000_001), DiagnosticArray)
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == (2, 1)
    first = read.status[0]
    assert (first.level, first.name, first.message, first.hardware_id) == (b"\1", "tracker: car", "recovering", "")
    assert [(value.key, value.value) for value in first.values] == list(TWO[0].values)
    assert list(decode_diagnostics(serialize_message(read)).statuses) == TWO


def test_statuses_cut_at_any_byte_are_refused():
    message = encode_diagnostics(TWO, stamp_ns=0)
    for size in range(len(message)):
        with pytest.raises(MessageError):
            decode_diagnostics(message[:size])


def test_an_unknown_level_is_refused():
    message = bytearray(encode_diagnostics(TWO[1:], stamp_ns=0))
    assert message[24] == Level.OK
    message[24] = 4
    with pytest.raises(MessageError, match="level 4"):
        decode_diagnostics(message)
