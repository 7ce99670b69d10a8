"""Clicked points: round trips, against real ROS 2, cut messages."""

import pytest
from geometry_msgs.msg import PointStamped
from rclpy.serialization import deserialize_message, serialize_message

from msg_adapters import MessageError, PointMessage, decode_point, encode_point

POINT = PointMessage(2_000_000_001, "cam", 12.5, -3.0)


def test_a_point_returns_as_it_was():
    assert decode_point(encode_point(POINT)) == POINT


def test_real_ros_2_reads_the_point_written_here_and_the_other_way_round():
    read = deserialize_message(encode_point(POINT), PointStamped)
    assert (read.header.stamp.sec, read.header.stamp.nanosec, read.header.frame_id) == (2, 1, "cam")
    assert (read.point.x, read.point.y, read.point.z) == (12.5, -3.0, 0.0)
    assert decode_point(bytes(serialize_message(read))) == POINT


@pytest.mark.parametrize("length", [0, 3, 12, 30, -1])
def test_a_cut_point_is_refused(length):
    with pytest.raises(MessageError):
        decode_point(encode_point(POINT)[:length])
