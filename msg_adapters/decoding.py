"""From the name of a topic's type to the decoder of its messages."""

from __future__ import annotations

from msg_adapters.event_array import EventArrayDecoder
from msg_adapters.event_message import EventMessageDecoder
from msg_adapters.event_packet import EventPacketDecoder
from msg_adapters.layout import Layout, MessageError, known_names

_PACKET_TYPES = frozenset({"event_camera_msgs/msg/EventPacket", "event_array_msgs/msg/EventArray"})
_ARRAY_TYPES = frozenset(
    {"dvs_msgs/msg/EventArray", "prophesee_event_msgs/msg/EventArray", "dv_ros2_msgs/msg/EventArray"}
)

EVENT_TYPES = _PACKET_TYPES | _ARRAY_TYPES
"""The types of messages that hold events, named as in ROS 2."""


def ros2_type_name(type_name: str) -> str:
    """A type's name as in ROS 2: `dvs_msgs/EventArray` is `dvs_msgs/msg/EventArray`."""
    package, _, name = type_name.partition("/")
    return f"{package}/msg/{name}" if name and "/" not in name else type_name


def decoder_for(type_name: str, layout: Layout) -> EventMessageDecoder:
    """A decoder for one topic.

    Args:
        type_name: type of its messages, named as in ROS 1 or ROS 2.
        layout: how their fields are laid out.

    Raises:
        MessageError: no type of `EVENT_TYPES`.
    """
    name = ros2_type_name(type_name)
    if name in _PACKET_TYPES:
        return EventPacketDecoder(layout)
    if name in _ARRAY_TYPES:
        return EventArrayDecoder(layout)
    msg = f"{type_name} is no known type of events: known are {known_names(EVENT_TYPES)}"
    raise MessageError(msg)
