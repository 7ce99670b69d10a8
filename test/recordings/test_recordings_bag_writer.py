"""Bags that the package writes are read back by the package and hold what a ROS 2 player needs."""

from __future__ import annotations

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_writers import EVENT_TOPIC, packets, random_events
from rosbags.rosbag2 import Reader

from etd_ros.events import concatenate
from etd_ros.recordings import RecordingError, open_recording
from etd_ros.recordings.bag_writer import EVENT_PACKET_DEFINITION, EVENT_PACKET_TYPE, BagWriter

DEFINITIONS = {EVENT_PACKET_TYPE: EVENT_PACKET_DEFINITION}
PACKET_HASH = "RIHS01_d6fa176260b1f37e5a40845305315e150a0f18191241eb64f407442aa29844aa"


def write(path, messages, *, compressed=False):
    with BagWriter(path, DEFINITIONS, compressed=compressed) as bag:
        bag.add_topic(EVENT_TOPIC, EVENT_PACKET_TYPE, reliable=False)
        for receive_ns, data in messages:
            bag.write(EVENT_TOPIC, receive_ns, data)
    return path


@settings(deadline=None, max_examples=15)
@given(count=st.integers(1, 400), per_packet=st.integers(1, 150), compressed=st.booleans())
def test_events_are_read_back_as_written(tmp_path_factory, count, per_packet, compressed):
    events = random_events(count, start_ns=1_700_000_000_000_000_000)
    path = tmp_path_factory.mktemp("bags") / "bag"
    with open_recording(write(path, packets(events, per_packet), compressed=compressed)) as recording:
        read = concatenate(list(recording.events()))
    assert (read.width, read.height) == (events.width, events.height)
    assert read.to_structured().tobytes() == events.to_structured().tobytes()


def test_messages_keep_their_bytes_times_and_topics(tmp_path):
    messages = packets(random_events(100), 30)
    with BagWriter(tmp_path / "bag", DEFINITIONS) as bag:
        bag.add_topic("/clock", "rosgraph_msgs/msg/Clock", reliable=False)
        bag.add_topic(EVENT_TOPIC, EVENT_PACKET_TYPE, reliable=False)
        for receive_ns, data in messages:
            bag.write("/clock", receive_ns, b"\0\1\0\0" + bytes(8))
            bag.write(EVENT_TOPIC, receive_ns, data)
    with Reader(tmp_path / "bag") as reader:
        read = [
            (time_ns, bytes(data)) for connection, time_ns, data in reader.messages() if "event" in connection.topic
        ]
        assert {(c.topic, c.msgtype, c.msgcount) for c in reader.connections} == {
            ("/clock", "rosgraph_msgs/msg/Clock", 4),
            (EVENT_TOPIC, EVENT_PACKET_TYPE, 4),
        }
    assert read == messages


def test_a_topic_carries_its_type_hash_and_the_reliability_to_replay_it_with(tmp_path):
    with BagWriter(tmp_path / "bag", DEFINITIONS) as bag:
        bag.add_topic(EVENT_TOPIC, EVENT_PACKET_TYPE, reliable=False)
        bag.add_topic("/frames", "sensor_msgs/msg/Image", reliable=True)
    metadata = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    topics = {item["topic_metadata"]["name"]: item["topic_metadata"] for item in metadata["topics_with_message_count"]}
    assert topics[EVENT_TOPIC]["type_description_hash"] == PACKET_HASH
    reliability = {}
    for name, topic in topics.items():
        profiles = topic["offered_qos_profiles"]
        profiles = yaml.safe_load(profiles) if isinstance(profiles, str) else profiles
        reliability[name] = profiles[0]["reliability"]
    assert reliability == {EVENT_TOPIC: "best_effort", "/frames": "reliable"}


def test_compression_makes_a_bag_smaller(tmp_path):
    messages = [(number, packets(random_events(200), 200)[0][1]) for number in range(50)]
    sizes = {}
    for compressed in (False, True):
        folder = write(tmp_path / str(compressed), messages, compressed=compressed)
        sizes[compressed] = sum(file.stat().st_size for file in folder.iterdir())
    assert sizes[True] < sizes[False] / 2


def test_an_interrupted_writer_leaves_a_sound_bag_of_what_it_has_got(tmp_path):
    first, _ = packets(random_events(60), 30)

    def interrupted():
        yield first
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write(tmp_path / "bag", interrupted())
    with open_recording(tmp_path / "bag") as recording:
        assert sum(len(events) for events in recording.events()) == 30


@pytest.mark.parametrize("kind", ["folder", "file"])
def test_an_existing_path_is_refused_and_left_alone(tmp_path, kind):
    path = tmp_path / "bag"
    if kind == "folder":
        path.mkdir()
        (path / "mine").touch()
    else:
        path.write_text("mine")
    with pytest.raises(RecordingError, match="bag.*new folder"), BagWriter(path, DEFINITIONS):
        pass
    assert path.read_text() == "mine" if kind == "file" else [item.name for item in path.iterdir()] == ["mine"]


def test_a_place_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(RecordingError, match="file/bag.*cannot be written"), BagWriter(tmp_path / "file" / "bag", {}):
        pass
