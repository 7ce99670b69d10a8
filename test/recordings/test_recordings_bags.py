"""ROS bags: every container gives the same events, and damage is one line."""

from __future__ import annotations

import shutil
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from recording_writers import (
    DATA,
    EVENT_TOPIC,
    PACKET_TYPE,
    packets,
    random_events,
    write_ros1_bag,
    write_ros2_bag,
)
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from etd_ros.events import Events, concatenate
from etd_ros.recordings import RecordedImage, RecordingError, open_recording
from etd_ros.stream import Restart
from msg_adapters import Layout, encode_image

EVENTS = random_events(1000, start_ns=1_700_000_000_000_000_000)


def read(path: Path, **options: object) -> Events:
    with open_recording(path, **options) as recording:
        return concatenate(list(recording.events()))


def assert_same(events: Events, expected: Events) -> None:
    assert (events.width, events.height) == (expected.width, expected.height)
    assert np.array_equal(events.to_structured(), expected.to_structured())


def error_of(path: Path, **options: object) -> str:
    """The one line that opening and reading the recording raises."""
    with pytest.raises(RecordingError) as caught, open_recording(path, **options) as recording:
        for _ in recording.packets():
            pass
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    return str(caught.value)


@pytest.fixture
def mcap_bag(tmp_path: Path) -> Path:
    return write_ros2_bag(tmp_path / "bag", packets(EVENTS, 100))


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_a_ros2_bag_gives_its_events(tmp_path, storage):
    assert_same(read(write_ros2_bag(tmp_path / "bag", packets(EVENTS, 100), storage=storage)), EVENTS)


@pytest.mark.parametrize(
    ("storage", "compression"),
    [
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
    ],
)
def test_a_compressed_bag_gives_its_events(tmp_path, storage, compression):
    bag = write_ros2_bag(tmp_path / "bag", packets(EVENTS, 100), storage=storage, compression=compression)
    assert_same(read(bag), EVENTS)


def test_a_ros1_bag_gives_its_events(tmp_path):
    assert_same(read(write_ros1_bag(tmp_path / "a.bag", packets(EVENTS, 100, Layout.ROS1))), EVENTS)


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_a_storage_file_alone_gives_its_events(tmp_path, storage):
    bag = write_ros2_bag(tmp_path / "bag", packets(EVENTS, 100), storage=storage)
    (file,) = (file for file in bag.iterdir() if file.suffix in (".mcap", ".db3"))
    assert_same(read(file), EVENTS)


@pytest.mark.parametrize("metadata", [None, "", "rosbag2_bagfile_information: [", "empty identifier"])
def test_a_bag_whose_metadata_is_missing_or_useless_is_read_from_its_storage(mcap_bag, metadata):
    file = mcap_bag / "metadata.yaml"
    if metadata == "empty identifier":
        metadata = file.read_text().replace("storage_identifier: mcap", "storage_identifier: ''")
        assert "storage_identifier: ''" in metadata
    file.unlink()
    if metadata is not None:
        file.write_text(metadata)
    assert_same(read(mcap_bag), EVENTS)


def test_split_storage_files_without_metadata_are_read_in_the_order_of_their_numbers(tmp_path):
    folder = tmp_path / "split"
    folder.mkdir()
    for number in range(11):
        part = packets(EVENTS[number * 90 : (number + 1) * 90], 30)
        bag = write_ros2_bag(tmp_path / f"part{number}", part)
        shutil.copy(bag / f"part{number}.mcap", folder / f"split_{number}.mcap")
    assert_same(read(folder), EVENTS[:990])


def test_topics_size_and_duration_are_known_without_reading_all(mcap_bag):
    with open_recording(mcap_bag) as recording:
        (topic,) = recording.topics
        assert (topic.name, topic.type_name, topic.count, topic.encoding) == (EVENT_TOPIC, PACKET_TYPE, 10, "mono")
        assert (recording.width, recording.height) == (EVENTS.width, EVENTS.height)
        assert (recording.topic, recording.event_type) == (EVENT_TOPIC, PACKET_TYPE)
        assert recording.duration_ns == int(EVENTS.t[-1] - EVENTS.t[99])


def test_messages_are_the_bytes_recorded(mcap_bag):
    with open_recording(mcap_bag) as recording:
        messages = list(recording.messages())
    assert [(message.receive_ns, message.data) for message in messages] == packets(EVENTS, 100)
    assert {(message.topic, message.layout) for message in messages} == {(EVENT_TOPIC, Layout.ROS2)}


def test_iterators_of_one_recording_do_not_disturb_each_other(mcap_bag):
    with open_recording(mcap_bag) as recording:
        for first, second in zip(recording.events(), recording.events(), strict=True):
            assert_same(first, second)


def test_streams_restart_where_recorded_messages_are_missing(tmp_path):
    stored = packets(EVENTS, 100)
    del stored[4:6]
    with open_recording(write_ros2_bag(tmp_path / "bag", stored)) as recording:
        batches = list(recording.streams())
    assert [batch.restart for batch in batches] == [None] * 4 + [Restart.GAP] + [None] * 3
    assert_same(concatenate([batch.events for batch in batches[4:]]), EVENTS[600:])


def test_several_event_topics_are_listed_and_one_can_be_chosen(tmp_path):
    bag = write_ros2_bag(tmp_path / "bag", packets(EVENTS, 100), topics=("/left/events", "/right/events"))
    message = error_of(bag)
    assert "/left/events" in message
    assert "/right/events" in message
    assert "--topic" in message
    assert_same(read(bag, topic="/right/events"), EVENTS)
    assert "/up/events is no event topic" in error_of(bag, topic="/up/events")


def test_a_bag_without_event_messages_is_an_error(tmp_path):
    assert "holds no messages" in error_of(write_ros2_bag(tmp_path / "bag", []))


def test_a_message_cut_short_is_an_error_that_names_it(tmp_path):
    stored = packets(EVENTS, 100)
    stored[3] = (stored[3][0], stored[3][1][:-4])
    message = error_of(write_ros2_bag(tmp_path / "bag", stored))
    assert f"message 3 of {EVENT_TOPIC}" in message


def test_a_message_of_a_size_that_no_sensor_has_is_an_error_that_names_it(tmp_path):
    bag = write_ros2_bag(tmp_path / "bag", packets(random_events(200, width=60_000, height=1_000), 100))
    assert f"message 0 of {EVENT_TOPIC}: sensor size 60000x1000 is impossible" in error_of(bag)


def test_a_break_is_raised_when_it_is_reached(tmp_path):
    stored = packets(EVENTS, 100)
    stored[5] = (stored[5][0], b"")
    with open_recording(write_ros2_bag(tmp_path / "bag", stored)) as recording:
        batches = recording.events()
        assert_same(concatenate([next(batches) for _ in range(5)]), EVENTS[:500])
        with pytest.raises(RecordingError, match="message 5"):
            next(batches)


@pytest.mark.parametrize("container", ["bag", "mcap", "db3"])
@pytest.mark.parametrize("kept", [0.001, 0.3, 0.9, 0.999])
def test_a_truncated_bag_is_an_error(tmp_path, container, kept):
    if container == "bag":
        whole = write_ros1_bag(tmp_path / "a.bag", packets(EVENTS, 100, Layout.ROS1))
    else:
        storage = StoragePlugin.MCAP if container == "mcap" else StoragePlugin.SQLITE3
        whole = write_ros2_bag(tmp_path / "a", packets(EVENTS, 100), storage=storage) / f"a.{container}"
    data = whole.read_bytes()
    cut = tmp_path / f"cut.{container}"
    cut.write_bytes(data[: int(len(data) * kept)])
    assert "truncated or damaged" in error_of(cut)


@pytest.mark.parametrize("name", ["a.bag", "a.mcap", "a.db3", "a.aedat4", "a.raw", "events.txt"])
def test_garbage_empty_and_missing_files_are_errors(tmp_path, name):
    path = tmp_path / name
    assert "no such file" in error_of(path)
    path.write_bytes(b"")
    assert "empty" in error_of(path)
    path.write_bytes(np.random.default_rng(5).bytes(5000))
    error_of(path)


def test_unknown_kinds_list_the_known_ones(tmp_path):
    path = tmp_path / "recording.avi"
    path.write_bytes(b"RIFF")
    assert ".mcap" in error_of(path)
    folder = tmp_path / "folder"
    folder.mkdir()
    assert "without .mcap, .db3 or events.txt" in error_of(folder)


def test_a_folder_of_other_recordings_is_refused_by_naming_some(tmp_path):
    for name in ("b.bag", "a.aedat4", "notes.md", "d.bag", "c.raw"):
        (tmp_path / name).touch()
    refused = error_of(tmp_path)
    assert f"give one that is in it, as {tmp_path}/a.aedat4, {tmp_path}/b.bag, {tmp_path}/c.raw" in refused
    assert "d.bag" not in refused


@pytest.mark.parametrize("container", ["ros1", *StoragePlugin])
def test_a_bag_is_read_in_memory_far_below_its_size(tmp_path, container):
    events = random_events(2_000_000)
    if container == "ros1":
        bag = write_ros1_bag(tmp_path / "a.bag", packets(events, 5000, Layout.ROS1))
    else:
        bag = write_ros2_bag(tmp_path / "bag", packets(events, 5000), storage=container)
    size = sum(file.stat().st_size for file in (bag.iterdir() if bag.is_dir() else [bag]))
    count = 0
    tracemalloc.start()
    with open_recording(bag) as recording:
        for batch in recording.events():
            count += len(batch)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert count == len(events)
    assert peak < size / 3


def test_items_of_a_real_bag_come_in_the_order_of_time():
    with open_recording(DATA / "traffic") as recording:
        items = list(recording.items())
    ends = [item.stamp_ns if isinstance(item, RecordedImage) else int(item.t[-1]) for item in items]
    starts = [item.stamp_ns if isinstance(item, RecordedImage) else int(item.t[0]) for item in items]
    assert all(end <= start for end, start in zip(ends[:-1], starts[1:], strict=True))
    images = [item for item in items if isinstance(item, RecordedImage)]
    assert len(images) == 59
    assert images[0].data.shape[:2] == (260, 346)
    assert sum(len(item) for item in items if isinstance(item, Events)) == 78830


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8"])
def test_colour_images_have_blue_first_however_they_were_recorded(tmp_path, encoding):
    picture = np.zeros((48, 64, 3), np.uint8)
    picture[:, :, encoding.index("b")] = 200
    message = encode_image(picture, stamp_ns=5_000, frame_id="cam", encoding=encoding)
    bag = write_ros2_bag(tmp_path / "bag", packets(random_events(10), 10), images=[(5_000, message)])
    with open_recording(bag) as recording:
        (image,) = recording.images()
    assert (image.data == (200, 0, 0)).all()


def test_slider_depth_has_its_events_and_images():
    with open_recording(DATA / "slider_depth" / "slider_depth.bag") as recording:
        assert (recording.width, recording.height) == (240, 180)
        assert sum(len(batch) for batch in recording.events()) == 1_078_541
        assert sum(1 for _ in recording.images()) == 87


def test_sensor_time_is_mapped_to_the_clock_of_the_headers():
    with open_recording(DATA / "drivers" / "evt3_640x480") as recording:
        packet = next(packet for packet in recording.packets() if len(packet.events))
        batch = next(recording.events())
    assert packet.events.t[0] < 10**12
    assert batch.t[0] == packet.stamp_ns
