"""Detections: round trips, against real ROS 2, several or no results, rotation, cut messages."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from vision_msgs.msg import Detection2D, Detection2DArray, ObjectHypothesisWithPose

from etd_ros.boxes import Box
from msg_adapters import Detection, MessageError, decode_detections, encode_detections

NUMBERS = st.integers(-4000, 4000).map(lambda quarters: quarters / 4)
TEXTS = st.text(max_size=8).filter(lambda text: "\0" not in text)
DETECTIONS = st.lists(
    st.builds(
        Detection, id=TEXTS, box=st.builds(Box, NUMBERS, NUMBERS, NUMBERS, NUMBERS), score=NUMBERS, class_id=TEXTS
    ),
    max_size=5,
)
TWO = [Detection("car", Box(1, 2, 30, 40), 0.75, "vehicle"), Detection("b", Box(-1.5, 0, 5, 6), 0.5, "")]


@settings(deadline=None, max_examples=40)
@given(DETECTIONS, st.integers(0, 2**31 * 10**9 - 1), TEXTS)
def test_detections_return_as_they_were(detections, stamp_ns, frame_id):
    decoded = decode_detections(encode_detections(detections, stamp_ns=stamp_ns, frame_id=frame_id))
    assert (decoded.stamp_ns, decoded.frame_id, list(decoded.detections)) == (stamp_ns, frame_id, detections)


def test_real_ros_2_reads_the_detections_written_here_and_the_other_way_round():
    message = encode_detections(TWO, stamp_ns=2_000_000_001, frame_id="cam")
    read = deserialize_message(message, Detection2DArray)
    assert len(message) == len(serialize_message(read))
    car = read.detections[0]
    for header in (read.header, car.header):
        assert (header.stamp.sec, header.stamp.nanosec, header.frame_id) == (2, 1, "cam")
    assert (car.id, car.bbox.center.position.x, car.bbox.center.position.y) == ("car", 16, 22)
    assert (car.bbox.center.theta, car.bbox.size_x, car.bbox.size_y) == (0, 30, 40)
    hypothesis = car.results[0].hypothesis
    assert (len(car.results), hypothesis.class_id, hypothesis.score) == (1, "vehicle", 0.75)
    assert car.results[0].pose.pose.orientation.w == 1
    assert list(decode_detections(serialize_message(read)).detections) == TWO


def ros_detection(theta=0.0, results=()):
    detection = Detection2D(id="x")
    detection.bbox.center.position.x, detection.bbox.center.position.y = 10.0, 20.0
    detection.bbox.center.theta, detection.bbox.size_x, detection.bbox.size_y = theta, 4.0, 2.0
    for class_id, score in results:
        result = ObjectHypothesisWithPose()
        result.hypothesis.class_id, result.hypothesis.score = class_id, score
        detection.results.append(result)
    return decode_detections(serialize_message(Detection2DArray(detections=[detection]))).detections[0]


def test_the_surest_of_several_results_counts():
    assert ros_detection(results=[("cat", 0.2), ("dog", 0.9), ("cow", 0.3)]) == Detection(
        "x", Box(8, 19, 4, 2), 0.9, "dog"
    )


def test_a_detection_without_results_has_no_class_and_score_0():
    assert ros_detection() == Detection("x", Box(8, 19, 4, 2), 0.0, "")


def test_a_rotated_box_becomes_the_upright_one_around_it():
    assert ros_detection(theta=math.pi / 2).box == pytest.approx((9, 18, 2, 4))
    side = (4 + 2) / math.sqrt(2)
    assert ros_detection(theta=-math.pi / 4).box == pytest.approx((10 - side / 2, 20 - side / 2, side, side))


def test_detections_cut_at_any_byte_are_refused():
    message = encode_detections(TWO, stamp_ns=0, frame_id="cam")
    for size in range(len(message)):
        with pytest.raises(MessageError):
            decode_detections(message[:size])


@settings(deadline=None, max_examples=60)
@given(st.binary(max_size=200))
def test_garbage_is_refused_or_read(data):
    try:
        decoded = decode_detections(b"\0\1\0\0" + data)
    except MessageError:
        return
    assert len(decoded.detections) * 60 <= len(data)


@pytest.mark.parametrize(("stamp_ns", "frame_id"), [(2**31 * 10**9, ""), (0, "a\0b"), (0, "\ud800")])
def test_what_a_message_cannot_hold_is_refused(stamp_ns, frame_id):
    with pytest.raises(MessageError):
        encode_detections([], stamp_ns=stamp_ns, frame_id=frame_id)
