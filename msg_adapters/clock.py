"""Sensor time to ROS time.

Encodings such as evt3 carry the camera's own time, which starts near 0. The offset to ROS time is the header's stamp
(the host's time of arrival) minus the time of the packet's first event. Arrival jitters: the first packet's offset is
kept and moved by an exponential average of the later ones, which also follows the drift between the two clocks.
"""

from __future__ import annotations

import numpy as np

from etd_ros.buffers import ArrayPool
from etd_ros.events import Events
from msg_adapters.event_message import EventMessage
from msg_adapters.header import NS_PER_S

GAIN = 0.01
"""Share of the difference by which a packet moves the offset."""
JUMP_NS = NS_PER_S
"""The largest step that is taken for jitter."""


class SensorClock:
    """Maps the sensor times of one topic's messages to ROS time; deterministic, a function of the messages alone.

    Where sensor time does not go back from one message to the next, neither does ROS time. The offset is taken anew,
    and `resets` counts it, when sensor time goes back by more than `JUMP_NS` (a bag loops, a camera restarts) or when
    arrival and sensor time part by more than that (the sensor's wraps passed unseen while messages were missing).
    """

    def __init__(self) -> None:
        self._resets = 0
        self._pool = ArrayPool(np.int64)
        self.reset()

    @property
    def resets(self) -> int:
        """How often the offset was taken anew because of a jump; a rise over one call: this message jumped."""
        return self._resets

    def reset(self) -> None:
        """Forget the offset: the next message starts a new stream, which is not counted as a jump."""
        self._offset_ns: int | None = None
        self._last_sensor_ns = 0

    def to_ros(self, message: EventMessage) -> Events:
        """The message's events on the ROS clock; as they are where the message has ROS time already."""
        events = message.events
        if not message.is_sensor_time or not len(events):
            return events
        offset_ns = self._follow(message.stamp_ns, int(events.t[0]))
        self._last_sensor_ns = int(events.t[-1])
        (times,) = self._pool.take(len(events))
        np.add(events.t, offset_ns, out=times)
        return Events(times, events.x, events.y, events.p, events.width, events.height)

    def _follow(self, stamp_ns: int, first_sensor_ns: int) -> int:
        measured_ns = stamp_ns - first_sensor_ns
        last_ns = self._offset_ns
        if last_ns is None:
            self._offset_ns = measured_ns
        elif self._last_sensor_ns - first_sensor_ns > JUMP_NS or abs(measured_ns - last_ns) > JUMP_NS:
            self._resets += 1
            self._offset_ns = measured_ns
        else:
            # A falling offset may eat up the time that passed between the packets, but no more.
            passed_ns = max(first_sensor_ns - self._last_sensor_ns, 0)
            self._offset_ns = last_ns + max(round(GAIN * (measured_ns - last_ns)), -passed_ns)
        return self._offset_ns
