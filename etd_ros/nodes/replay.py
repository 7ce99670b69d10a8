"""`replay`: a recording's events and images on ROS topics, at its own pace, faster or slower."""

from __future__ import annotations

import argparse
import sys
import threading
import time
from collections.abc import Generator, Iterator
from contextlib import closing
from dataclasses import dataclass

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from event_camera_msgs.msg import EventPacket
from rclpy.node import Node
from rclpy.publisher import Publisher
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image

from etd_ros.commands.one_line_parser import EXIT_BAD_INPUT, OneLineParser
from etd_ros.commands.recording_options import add_replay_options
from etd_ros.errors import EtdError
from etd_ros.events import Events
from etd_ros.nodes.arguments import own_arguments, warn_of_unknown_parameters
from etd_ros.nodes.connections import EVENT_QOS, FRAME_QOS
from etd_ros.nodes.ros_errors import ros_refusals
from etd_ros.nodes.running import start_ros
from etd_ros.recordings import RecordedMessage, Recording, open_recording
from msg_adapters import Layout, decode_image, encode_event_packet, encode_image, packet_to_ros2

EVENT_TOPIC = "/event_camera/events"
PACKET_TYPES = ("event_camera_msgs/msg/EventPacket", "event_array_msgs/msg/EventArray")
PACKET_DURATION_NS = 10_000_000
CLOCK_PERIOD_NS = 5_000_000
SUBSCRIBER_POLL_S = 0.05
LINGER_S = 0.5


class ReplayError(EtdError):
    """Options that do not make a replay."""


@dataclass(frozen=True, slots=True)
class ReplayMessage:
    """One message to publish.

    Attributes:
        due_ns: when, on the recording's clock (ns).
        is_events: an EventPacket, else an Image.
        data: serialised bytes.
    """

    due_ns: int
    is_events: bool
    data: bytes


def replay_messages(recording: Recording) -> Generator[ReplayMessage, None, None]:
    """The recording as serialised ROS 2 messages, in the order of their time.

    Event packets keep their encoding and their bytes; all other events are sent as EventPackets of encoding
    `mono`, which holds nanoseconds.
    """
    if recording.event_type in PACKET_TYPES:
        for message in recording.messages():
            if message.type_name == "sensor_msgs/msg/Image":
                data = message.data if message.layout is Layout.ROS2 else _image_to_ros2(message)
                yield ReplayMessage(message.receive_ns, False, data)
            elif message.topic == recording.topic:
                native = message.layout is Layout.ROS2
                data = message.data if native else packet_to_ros2(message.data)
                yield ReplayMessage(message.receive_ns, True, data)
        return
    seq = 0
    for item in recording.items():
        if isinstance(item, Events):
            for part in _split(item):
                due_ns = int(part.t[-1])
                packet = encode_event_packet(part, stamp_ns=due_ns, frame_id="event_camera", seq=seq)
                seq += 1
                yield ReplayMessage(due_ns, True, packet)
        else:
            image = encode_image(item.data, stamp_ns=item.stamp_ns, frame_id=item.frame_id)
            yield ReplayMessage(item.stamp_ns, False, image)


def _image_to_ros2(message: RecordedMessage) -> bytes:
    image = decode_image(message.data, message.layout)
    return encode_image(image.data, stamp_ns=image.stamp_ns, frame_id=image.frame_id, encoding=image.encoding)


def _split(events: Events) -> Iterator[Events]:
    """Parts of less than 10 ms, none of which goes back before its first event: times may step back in a recording."""
    while len(events):
        since_ns = events.t - events.t[0]
        beyond = np.flatnonzero((since_ns < 0) | (since_ns >= PACKET_DURATION_NS))
        part = events[: int(beyond[0])] if len(beyond) else events
        yield part
        events = events[len(part) :]


class Replay(Node):
    """Publishes one recording. Waiting is interruptible: `stopped` is set when ROS shuts down."""

    def __init__(self, recording: Recording, *, rate: float, clock: bool) -> None:
        with ros_refusals():
            super().__init__("replay")
        warn_of_unknown_parameters(self)
        self.stopped = threading.Event()
        self.context.on_shutdown(self.stopped.set)
        self._rate = rate
        topic = recording.topic if recording.topic.startswith("/") else EVENT_TOPIC
        self._events = self.create_publisher(EventPacket, topic, EVENT_QOS)
        self._images = self.create_publisher(Image, f"{topic.rpartition('/')[0]}/image_raw", FRAME_QOS)
        self._clock_publisher = self.create_publisher(Clock, "/clock", 10) if clock else None
        self._clock_ns = 0

    def wait_for_subscribers(self, number: int) -> None:
        """Return when the events have so many subscribers, or ROS shuts down."""
        if self._events.get_subscription_count() < number:
            self.get_logger().info(
                f"waiting for {number} subscriber(s) of {self._events.topic_name} "
                "(event_camera_msgs/msg/EventPacket, best effort): start `ros2 run etd_ros pipeline` or the three "
                "nodes; they read events once somebody reads their boxes"
            )
        while self._events.get_subscription_count() < number and not self.stopped.wait(SUBSCRIBER_POLL_S):
            pass

    def play(self, messages: Iterator[ReplayMessage]) -> Iterator[ReplayMessage]:
        """Publish each message when it is due, then yield it."""
        start_ns: int | None = None
        start_s = 0.0
        for message in messages:
            if start_ns is None:
                start_ns, start_s = message.due_ns, time.monotonic()
            self._wait_until_due(start_ns, start_s, message.due_ns)
            if self.stopped.is_set():
                return
            self._publish_clock(message.due_ns)
            publisher: Publisher = self._events if message.is_events else self._images
            publisher.publish(message.data)
            yield message

    def _wait_until_due(self, start_ns: int, start_s: float, due_ns: int) -> None:
        while not self.stopped.is_set():
            now_ns = start_ns + int((time.monotonic() - start_s) * 1e9 * self._rate)
            if now_ns >= due_ns:
                return
            pause_ns = min(due_ns - now_ns, CLOCK_PERIOD_NS) if self._clock_publisher else due_ns - now_ns
            self.stopped.wait(pause_ns / 1e9 / self._rate)
            self._publish_clock(min(due_ns, now_ns + pause_ns))

    def _publish_clock(self, now_ns: int) -> None:
        is_news = now_ns >= self._clock_ns + CLOCK_PERIOD_NS or now_ns < self._clock_ns
        if self._clock_publisher is not None and is_news and not self.stopped.is_set():
            self._clock_ns = now_ns
            self._clock_publisher.publish(Clock(clock=Time(sec=now_ns // 10**9, nanosec=now_ns % 10**9)))


def run(options: argparse.Namespace, ros_arguments: list[str]) -> int:
    """Replay as the options say; ROS's arguments have the program's name before them.

    Raises:
        EtdError: the recording cannot be read, or an option is out of range.
    """
    if not 0 < options.rate <= 1000:
        msg = f"--rate {options.rate:g} is out of range (0, 1000]: 1 is the recorded pace"
        raise ReplayError(msg)
    if options.wait_for < 0:
        msg = f"--wait-for {options.wait_for} is out of range: give a number of subscribers, 0 not to wait"
        raise ReplayError(msg)
    with open_recording(options.recording, topic=options.topic, size=options.size) as recording:
        start_ros(ros_arguments)
        node = Replay(recording, rate=options.rate, clock=options.clock)
        try:
            node.wait_for_subscribers(options.wait_for)
            _play_with_progress(node, recording, options.loop)
            # Best-effort messages lie in this process' shared memory until they are read: the last ones would be lost.
            node.stopped.wait(LINGER_S)
        except KeyboardInterrupt:
            return 0
        except RuntimeError:
            # A signal ends ROS at any moment, and a message that was on its way then cannot be published any more.
            if node.context.ok():
                raise
        finally:
            node.destroy_node()
            rclpy.try_shutdown()
    return 0


def _play_with_progress(node: Replay, recording: Recording, loop: bool) -> None:
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        rounds = 0
        while not node.stopped.is_set() and (loop or rounds == 0):
            rounds += 1
            name = f"{recording.path.name} (round {rounds})" if loop else recording.path.name
            task = progress.add_task(name, total=recording.duration_ns)
            first_ns = None
            with closing(replay_messages(recording)) as messages:
                for message in node.play(messages):
                    first_ns = message.due_ns if first_ns is None else first_ns
                    progress.update(task, completed=message.due_ns - first_ns)
            if loop:
                progress.remove_task(task)


def main() -> int:
    """Entry point of `ros2 run etd_ros replay`."""
    parser = OneLineParser(prog="ros2 run etd_ros replay", description=__doc__)
    add_replay_options(parser)
    try:
        return run(parser.parse_args(own_arguments(sys.argv)), sys.argv)
    except EtdError as err:
        print(f"etd_ros: {' '.join(str(err).split())}", file=sys.stderr)  # noqa: T201
        return EXIT_BAD_INPUT
