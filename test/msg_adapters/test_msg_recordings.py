"""The drivers' recordings, read by rosbags, give the sums that the drivers' own decoders give."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2 import Reader as Ros2Reader

from msg_adapters import Layout, decoder_for, packet_to_ros2

DRIVERS = Path(os.environ.get("ETD_DATA", Path(__file__).parents[3] / "shared/data")) / "drivers"
EXPECTED = json.loads((DRIVERS / "checksums.json").read_text())


def messages(path):
    with (Ros1Reader if path.suffix == ".bag" else Ros2Reader)(path) as reader:
        for connection, _, message in reader.messages():
            yield connection.msgtype, message


def checksums(typed_messages, layout):
    decoder = None
    sums = dict.fromkeys(("messages", "events", "sum_t_ns_mod_2_64", "sum_x", "sum_y", "on_events"), 0)
    for type_name, message in typed_messages:
        decoder = decoder or decoder_for(type_name, layout)
        decoded = decoder.decode(message)
        events = decoded.events
        sums["messages"] += 1
        sums["events"] += len(events)
        sums["sum_t_ns_mod_2_64"] += int(events.t.astype(np.uint64).sum())
        sums["sum_x"] += int(events.x.sum())
        sums["sum_y"] += int(events.y.sum())
        sums["on_events"] += int(events.p.sum())
    sums["sum_t_ns_mod_2_64"] %= 2**64
    return {"encoding": decoded.encoding, **sums}


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_a_recording_decodes_to_the_publishers_own_sums(name):
    assert checksums(messages(DRIVERS / name), Layout.ROS2) == EXPECTED[name]


def test_the_same_packets_in_a_ros_1_bag_decode_to_the_same_sums():
    assert checksums(messages(DRIVERS / "evt3_640x480_ros1.bag"), Layout.ROS1) == EXPECTED["evt3_640x480"]


def test_ros_1_packets_rewritten_for_ros_2_decode_to_the_same_sums():
    rewritten = (
        (type_name, packet_to_ros2(message)) for type_name, message in messages(DRIVERS / "evt3_640x480_ros1.bag")
    )
    assert checksums(rewritten, Layout.ROS2) == EXPECTED["evt3_640x480"]
