"""The load of the live benchmark: a process that publishes EventPackets at an exact rate, and one that echoes.

They are processes of their own, so that neither shares an interpreter lock with whoever measures.
"""

from __future__ import annotations

import multiprocessing
import signal
import struct
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from multiprocessing.connection import Connection
from types import TracebackType
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from event_camera_msgs.msg import EventPacket
from vision_msgs.msg import Detection2DArray

from etd_ros.benchmarking.live_packets import Packets
from etd_ros.benchmarking.live_scene import NS_PER_US, TARGET, LiveScene
from etd_ros.nodes.connections import EVENT_QOS, FRAME_QOS
from etd_ros.nodes.own_context import node_in_own_context
from msg_adapters import Detection, encode_detections

NS_PER_S = 1_000_000_000
END_TIMEOUT_S = 10.0
POLL_S = 0.05
HEADER_STAMP = struct.Struct("<4xiI")
"""Seconds and nanoseconds of a message that begins with a header, after the encapsulation."""

ChildT = TypeVar("ChildT", bound="Child")


@dataclass(frozen=True)
class Place:
    """Where the processes of one benchmark meet.

    Attributes:
        domain: ROS domain.
        namespace: of all nodes; others that happen to use the domain do not disturb.
    """

    domain: int
    namespace: str

    @property
    def events(self) -> str:
        """The topic of the EventPackets."""
        return f"/{self.namespace}/events"

    @property
    def echo(self) -> str:
        """The topic of the echo's boxes."""
        return f"/{self.namespace}/echo"


@dataclass(frozen=True)
class Prepare:
    """What is to be encoded: so many events per second, in so many messages."""

    rate: float
    messages_per_s: int


@dataclass(frozen=True)
class Play:
    """What is to be published, of what was prepared.

    Attributes:
        start_ns: of the scene (ns on the ROS clock), a multiple of `TIME_HIGH_NS`.
        duration_s: how long.
    """

    start_ns: int
    duration_s: float


@dataclass(frozen=True)
class Played:
    """What was published.

    Attributes:
        start_ns: of the scene (ns on the ROS clock).
        message_ns: how long a message lasts (ns).
        published_ns: when each message was handed to DDS (ns on the machine's monotonic clock), int64, shape (n,).
    """

    start_ns: int
    message_ns: int
    published_ns: npt.NDArray[np.int64]

    @property
    def duration_s(self) -> float:
        """How long the messages took (s)."""
        return float(self.published_ns[-1] - self.published_ns[0] + self.message_ns) / NS_PER_S


class Order(Enum):
    """What else the generator is told."""

    STOP = "stop"
    COUNT_SUBSCRIBERS = "count subscribers"


class Child:
    """A process with a pipe to it, gone when the context ends."""

    def __init__(self, work: Callable[..., None], *arguments: object) -> None:
        # Spawned, not forked: a fork would take half of a running DDS with it.
        context = multiprocessing.get_context("spawn")
        self._pipe, self._other_end = context.Pipe()
        self._process = context.Process(target=work, args=(self._other_end, *arguments), daemon=True)

    def __enter__(self: ChildT) -> ChildT:
        self._process.start()
        self._other_end.close()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._pipe.close()
        self._process.join(END_TIMEOUT_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


class LoadGenerator(Child):
    """Publishes the picture of one sensor.

    Args:
        width, height: the sensor's size (pixels).
        place: where.

    Attributes:
        message_s: how long a message of what was prepared lasts (s).
    """

    def __init__(self, width: int, height: int, place: Place) -> None:
        super().__init__(_generate, width, height, place)
        self.message_s = 0.0

    def prepare(self, rate: float, messages_per_s: int) -> None:
        """Encode the scene at `rate` events/s."""
        self.message_s = 1 / messages_per_s
        self._pipe.send(Prepare(rate, messages_per_s))
        self._pipe.recv()

    def subscribers(self) -> int:
        """How many read the events."""
        self._pipe.send(Order.COUNT_SUBSCRIBERS)
        return int(self._pipe.recv())

    def play(self, play: Play) -> None:
        """Begin to publish what was prepared; a message is due when its last event has happened."""
        self._pipe.send(play)

    def stop(self) -> None:
        """End the play early."""
        self._pipe.send(Order.STOP)

    @property
    def is_done(self) -> bool:
        """Whether the play is over."""
        return self._pipe.poll()

    def played(self) -> Played:
        """What was published, when the play is over."""
        played: Played = self._pipe.recv()
        return played


class Echo(Child):
    """Answers each message by a box that is stamped as the message: what the way there and back takes.

    Args:
        place: where.
    """

    def __init__(self, place: Place) -> None:
        super().__init__(_echo, place)


def _generate(pipe: Connection, width: int, height: int, place: Place) -> None:
    """Prepare and play until the other end closes the pipe."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    scene, seq, packets = LiveScene(width, height), 0, None
    with node_in_own_context("live_load", place.domain, place.namespace) as (node, _):
        publisher = node.create_publisher(EventPacket, place.events, EVENT_QOS)
        for order in _orders(pipe):
            if isinstance(order, Prepare):
                # The last rate's packets may be a quarter of a gigabyte: they go before the next ones come.
                packets = None
                packets = Packets(scene, order.rate, order.messages_per_s)
                pipe.send(len(packets))
            elif isinstance(order, Play) and packets is not None:
                played = _play(order, packets, publisher.publish, seq, pipe)
                seq += len(played.published_ns)
                pipe.send(played)
            elif order is Order.COUNT_SUBSCRIBERS:
                pipe.send(publisher.get_subscription_count())


def _orders(pipe: Connection) -> Iterator[Prepare | Play | Order]:
    while True:
        try:
            yield pipe.recv()
        except EOFError:
            return


def _play(play: Play, packets: Packets, publish: Callable[[bytes], None], seq: int, pipe: Connection) -> Played:
    period_ns = packets.duration_us * NS_PER_US
    count = round(play.duration_s * NS_PER_S / period_ns)
    published_ns = np.zeros(count, np.int64)
    first_due_ns = time.monotonic_ns() + play.start_ns + period_ns - time.time_ns()
    for number in range(count):
        message = packets.message(number, seq + number, play.start_ns)
        due_ns = first_due_ns + number * period_ns
        time.sleep(max(0, due_ns - time.monotonic_ns()) / NS_PER_S)
        published_ns[number] = time.monotonic_ns()
        publish(message)
        if pipe.poll():
            count = number + 1
            break
    return Played(play.start_ns, period_ns, published_ns[:count])


def _echo(pipe: Connection, place: Place) -> None:
    """Echo until the other end closes the pipe."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with node_in_own_context("live_echo", place.domain, place.namespace) as (node, executor):
        publisher = node.create_publisher(Detection2DArray, place.echo, FRAME_QOS)
        boxes = [Detection(TARGET, LiveScene(240, 180).box(0), 1.0, TARGET)]

        def answer(message: bytes) -> None:
            seconds, nanoseconds = HEADER_STAMP.unpack_from(message)
            publisher.publish(encode_detections(boxes, stamp_ns=seconds * NS_PER_S + nanoseconds, frame_id=""))

        node.create_subscription(EventPacket, place.events, answer, EVENT_QOS, raw=True)
        while not pipe.poll():
            executor.spin_once(timeout_sec=POLL_S)
