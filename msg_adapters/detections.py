"""vision_msgs/Detection2DArray 4.1.1 in ROS 2 layout: boxes by their centre there, by their top-left corner here.

Detection2DArray: Header header; Detection2D[] detections
Detection2D: Header header; ObjectHypothesisWithPose[] results; BoundingBox2D bbox; string id
ObjectHypothesisWithPose: string class_id; float64 score; geometry_msgs/PoseWithCovariance pose
BoundingBox2D: float64 center.x, center.y, theta; float64 size_x, size_y
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from etd_ros.boxes import Box
from msg_adapters.header import Header, read_header, write_header
from msg_adapters.layout import Layout, MessageBytes, Reader, Writer

# Fewest bytes in CDR of a detection (header, two counts, box, id) and of a result (class, score, pose, covariance).
_DETECTION_SIZE_MIN = 12 + 4 + 40 + 4
_RESULT_SIZE_MIN = 4 + 8 + 56 + 288

_NO_POSITION = (0.0, 0.0, 0.0)
_NO_ROTATION = (0.0, 0.0, 0.0, 1.0)
_NO_COVARIANCE = (0.0,) * 36


@dataclass(frozen=True, slots=True)
class Detection:
    """One box.

    Attributes:
        id: name of the object, the same from message to message.
        box: top-left corner, width and height (pixels).
        score: how sure the sender is.
        class_id: what the object is.
    """

    id: str
    box: Box
    score: float
    class_id: str


@dataclass(frozen=True, slots=True)
class DetectionsMessage:
    """The boxes of one image.

    Attributes:
        stamp_ns: the header's stamp (ns), that of the data the boxes were computed from.
        frame_id: the header's coordinate frame.
        detections: in the order sent.
    """

    stamp_ns: int
    frame_id: str
    detections: tuple[Detection, ...]


def encode_detections(detections: Sequence[Detection], *, stamp_ns: int, frame_id: str) -> bytes:
    """A vision_msgs/msg/Detection2DArray in ROS 2 layout; each detection repeats the header and has one result.

    Raises:
        MessageError: a stamp or text does not fit the message.
    """
    header = Header(stamp_ns, frame_id)
    writer = Writer()
    write_header(writer, header)
    writer.u32(len(detections))
    for detection in detections:
        write_header(writer, header)
        writer.u32(1)
        writer.string(detection.class_id)
        writer.f64(detection.score, *_NO_POSITION, *_NO_ROTATION, *_NO_COVARIANCE)
        writer.f64(*detection.box.center, 0.0, detection.box.w, detection.box.h)
        writer.string(detection.id)
    return writer.finish()


def decode_detections(message: MessageBytes) -> DetectionsMessage:
    """The boxes of a vision_msgs/msg/Detection2DArray in ROS 2 layout.

    Class and score are those of the result with the highest score ("" and 0 where there is none); a rotated box becomes
    the upright one around it. Values are delivered as sent: whoever uses a box checks it (`Box.check`).

    Raises:
        MessageError: cut short, or not of this type.
    """
    reader = Reader(message, Layout.ROS2)
    header = read_header(reader)
    detections = tuple(_read_detection(reader) for _ in range(reader.count(_DETECTION_SIZE_MIN)))
    return DetectionsMessage(header.stamp_ns, header.frame_id, detections)


def _read_detection(reader: Reader) -> Detection:
    read_header(reader)
    results = [_read_result(reader) for _ in range(reader.count(_RESULT_SIZE_MIN))]
    score, class_id = max(results, default=(0.0, ""), key=lambda result: result[0])
    center_x, center_y, theta, size_x, size_y = (reader.f64() for _ in range(5))
    w, h = _upright_size(size_x, size_y, theta)
    return Detection(reader.string(), Box(center_x - w / 2, center_y - h / 2, w, h), score, class_id)


def _read_result(reader: Reader) -> tuple[float, str]:
    class_id = reader.string()
    score = reader.f64()
    reader.blob(8 * len(_NO_POSITION + _NO_ROTATION + _NO_COVARIANCE))
    return score, class_id


def _upright_size(size_x: float, size_y: float, theta: float) -> tuple[float, float]:
    if theta == 0 or not math.isfinite(theta):
        return size_x, size_y
    cos, sin = abs(math.cos(theta)), abs(math.sin(theta))
    return size_x * cos + size_y * sin, size_x * sin + size_y * cos
