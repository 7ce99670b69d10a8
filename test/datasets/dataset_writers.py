"""Recordings as the datasets' publishers give them, written for the tests: ROS 1 bags by rosbags, text by hand."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np
from rosbags import rosbag1
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from etd_ros.events import Events

EVENT_DEFINITION = "uint16 x\nuint16 y\ntime ts\nbool polarity\n"
EVENT_ARRAY_DEFINITION = "Header header\nuint32 height\nuint32 width\ndvs_msgs/Event[] events\n"
EVENTS_PER_MESSAGE = 100
ROS_EPOCH_NS = 1_468_939_800_000_000_000


def moving_events(start_ns: int, *, duration_ns: int = 2 * 10**9, count: int = 1000, size=(190, 180)) -> Events:
    """Events of a point that goes along the sensor's diagonal."""
    share = np.linspace(0, 1, count)
    return Events(
        start_ns + (share * duration_ns).astype(np.int64),
        (share * (size[0] - 1)).astype(np.uint16),
        (share * (size[1] - 1)).astype(np.uint16),
        (np.arange(count) % 2).astype(np.uint8),
        *size,
    )


def image_stamps(events: Events, count: int) -> list[int]:
    """Times of `count` video frames, evenly from the first event to the last."""
    return [int(stamp) for stamp in np.linspace(events.t[0], events.t[-1], count).astype(np.int64)]


def write_text_folder(folder: Path, events: Events, images: Sequence[int] = ()) -> Path:
    """events.txt, images.txt and images/, as the Event Camera Dataset has them."""
    (folder / "images").mkdir(parents=True)
    rows = zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist(), strict=True)
    (folder / "events.txt").write_text("".join(f"{_seconds(t)} {x} {y} {p}\n" for t, x, y, p in rows))
    names = [f"images/frame_{number:08d}.png" for number in range(len(images))]
    for name in names:
        cv2.imwrite(str(folder / name), np.zeros((events.height, events.width), np.uint8))
    lines = (f"{_seconds(stamp_ns)} {name}\n" for stamp_ns, name in zip(images, names, strict=True))
    (folder / "images.txt").write_text("".join(lines))
    return folder


def write_ros1_bag(path: Path, events: Events, images: Sequence[int] = (), *, namespace: str = "/dvs") -> Path:
    """A bag of dvs_msgs/EventArray and mono8 images, as rosbag record leaves it."""
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(EVENT_DEFINITION, "dvs_msgs/msg/Event"))
    store.register(get_types_from_msg(EVENT_ARRAY_DEFINITION, "dvs_msgs/msg/EventArray"))
    path.parent.mkdir(parents=True, exist_ok=True)
    messages = [(int(part.t[-1]), f"{namespace}/events", _event_array(store, part)) for part in _parts(events)]
    messages += [(stamp_ns, f"{namespace}/image_raw", _image(store, stamp_ns, events)) for stamp_ns in images]
    with rosbag1.Writer(path) as writer:
        connections = {
            f"{namespace}/events": writer.add_connection(
                f"{namespace}/events", "dvs_msgs/msg/EventArray", typestore=store
            ),
            f"{namespace}/image_raw": writer.add_connection(
                f"{namespace}/image_raw", "sensor_msgs/msg/Image", typestore=store
            ),
        }
        for receive_ns, topic, message in sorted(messages, key=lambda item: item[0]):
            data = store.serialize_ros1(message, connections[topic].msgtype)
            writer.write(connections[topic], receive_ns, data)
    return path


def write_csv(path: Path, rows: Iterable[tuple[str, int, float, float, float, float]]) -> Path:
    """A BOXES.csv."""
    lines = (",".join(str(cell) for cell in row) for row in rows)
    path.write_text("\n".join(["target,stamp_ns,x,y,w,h", *lines]) + "\n")
    return path


def _seconds(stamp_ns: int) -> str:
    return f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d}"


def _parts(events: Events) -> list[Events]:
    return [events[start : start + EVENTS_PER_MESSAGE] for start in range(0, len(events), EVENTS_PER_MESSAGE)]


def _event_array(store, events: Events):
    types = store.types
    made = [
        types["dvs_msgs/msg/Event"](x=x, y=y, ts=_time(store, t), polarity=bool(p))
        for t, x, y, p in zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist(), strict=True)
    ]
    header = _header(store, int(events.t[-1]))
    return types["dvs_msgs/msg/EventArray"](header=header, height=events.height, width=events.width, events=made)


def _image(store, stamp_ns: int, events: Events):
    return store.types["sensor_msgs/msg/Image"](
        header=_header(store, stamp_ns),
        height=events.height,
        width=events.width,
        encoding="mono8",
        is_bigendian=0,
        step=events.width,
        data=np.zeros(events.height * events.width, np.uint8),
    )


def _header(store, stamp_ns: int):
    return store.types["std_msgs/msg/Header"](seq=0, stamp=_time(store, stamp_ns), frame_id="")


def _time(store, stamp_ns: int):
    return store.types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
