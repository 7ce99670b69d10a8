"""What every message of events decodes to, and the interface of its decoders."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from etd_ros.events import Events, EventsError, check_sensor_size
from msg_adapters.codecs import Triggers
from msg_adapters.layout import MessageBytes, MessageError


class EventMessage(NamedTuple):
    """One decoded message of events.

    Attributes:
        stamp_ns: the header's stamp (ns): for EventPackets the host's time of arrival, for EventArrays unreliable.
        frame_id: the header's coordinate frame.
        seq: count of the messages sent, where the type has one: a gap is lost data.
        encoding: the EventPacket's encoding, or `array`.
        events: the events on the sensor in the order sent, with the times that the message says.
        is_sensor_time: whether those times (the triggers' too) are the camera's own, near 0 at its start, and not ROS
            time; see `SensorClock`.
        triggers: edges at the camera's trigger inputs.
        skipped_words: words of no known meaning.
        off_sensor: events dropped since they lie outside width x height.
    """

    stamp_ns: int
    frame_id: str
    seq: int | None
    encoding: str
    events: Events
    is_sensor_time: bool
    triggers: Triggers
    skipped_words: int
    off_sensor: int


class EventMessageDecoder(Protocol):
    """Decodes the messages of one topic, in the order sent."""

    def decode(self, message: MessageBytes) -> EventMessage:
        """One message.

        Raises:
            MessageError: the bytes are cut short, no such message, or hold too many events; the next message can be
                decoded all the same.
        """

    def reset(self) -> None:
        """Forget everything that earlier messages said: a new stream begins."""


def checked_size(width: int, height: int) -> tuple[int, int]:
    """The sensor's (width, height) as a message says it.

    Raises:
        MessageError: one of them is 0 or above 65535 pixels.
    """
    try:
        check_sensor_size(width, height)
    except EventsError as err:
        msg = f"the message's {err}"
        raise MessageError(msg) from err
    return width, height
