"""ROS messages to arrays and back, on message bytes: no rclpy, no message classes."""

from msg_adapters.clock import SensorClock
from msg_adapters.codecs import DecodedWords, Evt2Decoder, Evt3Decoder, Evt21Decoder, Triggers, WordDecoder
from msg_adapters.decoding import EVENT_TYPES, decoder_for, ros2_type_name
from msg_adapters.detections import (
    Detection,
    DetectionsMessage,
    decode_detections,
    encode_detections,
)
from msg_adapters.diagnostics import (
    DiagnosticsMessage,
    DiagnosticStatus,
    Level,
    decode_diagnostics,
    encode_diagnostics,
)
from msg_adapters.event_message import EventMessage, EventMessageDecoder
from msg_adapters.event_packet import ENCODINGS, encode_event_packet, packet_to_ros2
from msg_adapters.header import Header
from msg_adapters.image import IMAGE_TYPE, ImageMessage, decode_image, encode_image
from msg_adapters.layout import Layout, MessageBytes, MessageError
from msg_adapters.point import PointMessage, decode_point, encode_point

__all__ = [
    "ENCODINGS",
    "EVENT_TYPES",
    "IMAGE_TYPE",
    "DecodedWords",
    "Detection",
    "DetectionsMessage",
    "DiagnosticStatus",
    "DiagnosticsMessage",
    "EventMessage",
    "EventMessageDecoder",
    "Evt2Decoder",
    "Evt3Decoder",
    "Evt21Decoder",
    "Header",
    "ImageMessage",
    "Layout",
    "Level",
    "MessageBytes",
    "MessageError",
    "PointMessage",
    "SensorClock",
    "Triggers",
    "WordDecoder",
    "decode_detections",
    "decode_diagnostics",
    "decode_image",
    "decode_point",
    "decoder_for",
    "encode_detections",
    "encode_diagnostics",
    "encode_event_packet",
    "encode_image",
    "encode_point",
    "packet_to_ros2",
    "ros2_type_name",
]
