"""Damaged recordings of every kind: refused in words, or read as far as they go; never another exception."""

from __future__ import annotations

import random
import resource
import shutil
import sqlite3
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import recording_writers as writers
from rosbags import rosbag2

from etd_ros.errors import EtdError
from etd_ros.recordings import RecordingError, open_recording
from msg_adapters import Layout

COUNT = 100
EVENTS = writers.random_events(200, start_ns=10**9)
RAW_HEADER = "% evt {}\n% geometry 64x48\n% end\n"
BOUNDARIES = (0, 1, 0x7F, 0xFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF)
MEMORY_MAX_MIB = 300
WITHOUT_CONSTRAINTS = (
    "CREATE TABLE loose AS SELECT * FROM {table}; DROP TABLE {table}; ALTER TABLE loose RENAME TO {table};"
)


def ros2_bag(folder: Path, storage: rosbag2.StoragePlugin, *, compressed: bool = False) -> tuple[Path, Path]:
    mode = rosbag2.CompressionMode.STORAGE if compressed else rosbag2.CompressionMode.NONE
    bag = writers.write_ros2_bag(folder / "bag", writers.packets(EVENTS, 20), storage=storage, compression=mode)
    (file,) = (file for file in bag.iterdir() if file.name != "metadata.yaml")
    return file, file


def mcap(folder: Path) -> tuple[Path, Path]:
    return ros2_bag(folder, rosbag2.StoragePlugin.MCAP)


def mcap_compressed(folder: Path) -> tuple[Path, Path]:
    return ros2_bag(folder, rosbag2.StoragePlugin.MCAP, compressed=True)


def sqlite(folder: Path) -> tuple[Path, Path]:
    return ros2_bag(folder, rosbag2.StoragePlugin.SQLITE3)


def metadata(folder: Path) -> tuple[Path, Path]:
    file, _ = mcap(folder)
    return file.parent, file.parent / "metadata.yaml"


def ros1_bag(folder: Path) -> tuple[Path, Path]:
    bag = writers.write_ros1_bag(folder / "a.bag", writers.packets(EVENTS, 20, Layout.ROS1))
    return bag, bag


def text(folder: Path) -> tuple[Path, Path]:
    recording = writers.write_ecd(folder, EVENTS)
    return recording, recording / "events.txt"


def video(folder: Path) -> tuple[Path, Path]:
    recording = writers.write_ecd(folder, EVENTS)
    (recording / "images.txt").write_text("1.0 frame.png\n")
    cv2.imwrite(str(recording / "frame.png"), np.arange(48 * 64, dtype=np.uint8).reshape(48, 64))
    return recording, recording / "frame.png"


def raw(version: str, words: np.ndarray, folder: Path) -> tuple[Path, Path]:
    recording = writers.write_raw(folder / "a.raw", RAW_HEADER.format(version), words)
    return recording, recording


KINDS = {
    "mcap": mcap,
    "mcap compressed": mcap_compressed,
    "sqlite": sqlite,
    "metadata": metadata,
    "ros1": ros1_bag,
    "text": text,
    "video": video,
    "evt2": lambda folder: raw("2.0", writers.evt2_words(EVENTS), folder),
    "evt21": lambda folder: raw("2.1", writers.evt21_words(EVENTS), folder),
    "evt3": lambda folder: raw("3.0", writers.evt3_words(EVENTS), folder),
}
"""What makes a small recording in a folder: the recording, and the file of it that is damaged."""


def damaged(rng: random.Random, good: bytes) -> bytes:
    data = bytearray(good)
    for _ in range(rng.choice((1, 1, 3))):
        place = rng.randrange(len(data)) if data else 0
        how = rng.randrange(5)
        if how == 0:
            del data[place:]
        elif how == 1:
            data[place : place + 4] = struct.pack("<I", rng.choice(BOUNDARIES))
        elif how == 2:
            data[place : place + 8] = rng.randbytes(8)
        elif how == 3:
            data[place:place] = data[place : place + rng.randrange(1, 200)]
        elif data:
            data[place] ^= 1 << rng.randrange(8)
    return bytes(data)


def read(path: Path) -> int:
    """Everything in a recording; the number of events."""
    with open_recording(path) as recording:
        for _ in recording.images():
            pass
        return sum(len(batch.events) for batch in recording.streams())


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_recording_is_read_or_refused(tmp_path, kind):
    path, file = KINDS[kind](tmp_path)
    good, rng = file.read_bytes(), random.Random(kind)
    assert read(path) == len(EVENTS)
    refusals = []
    for _ in range(COUNT):
        file.write_bytes(damaged(rng, good))
        try:
            read(path)
        except EtdError as err:
            refusals.append(str(err))
    assert 0 < len(refusals) < COUNT
    assert all(str(tmp_path) in text for text in refusals), "each names the recording"


@pytest.mark.parametrize(
    "change",
    [
        "UPDATE topics SET type = NULL",
        "UPDATE topics SET name = x'00ff'",
        "UPDATE topics SET id = 'one'",
        "UPDATE messages SET data = 10000000000",
        "UPDATE messages SET data = 'text'",
        "UPDATE messages SET data = NULL",
        "UPDATE messages SET timestamp = 'yesterday'",
        "DROP TABLE messages",
    ],
)
def test_a_database_of_other_things_than_messages_is_refused(tmp_path, change):
    path, _ = sqlite(tmp_path)
    database = sqlite3.connect(path)
    for table in ("topics", "messages"):
        database.executescript(WITHOUT_CONSTRAINTS.format(table=table))
    database.executescript(f"{change};")
    database.close()
    with pytest.raises(RecordingError):
        read(path)


@pytest.mark.parametrize("content", ["[" * 5000, "a: 2001-99-99", "- 1", "rosbag2_bagfile_information: [x]", "\x00"])
def test_metadata_that_are_none_leave_the_word_to_the_storage_file(tmp_path, content):
    path, file = metadata(tmp_path)
    file.write_text(content)
    assert read(path) == len(EVENTS)


def test_a_picture_that_claims_a_billion_pixels_gets_no_memory(tmp_path):
    path, file = video(tmp_path)
    header = b"IHDR" + struct.pack(">IIBBBBB", 32768, 32768, 8, 0, 0, 0, 0)
    rest = file.read_bytes()[33:]
    file.write_bytes(
        b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header)) + rest
    )
    before_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    with pytest.raises(RecordingError, match=r"frame\.png: missing, or no image"):
        read(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 - before_mib < MEMORY_MAX_MIB


def test_a_picture_whose_name_no_file_can_have_is_missing(tmp_path):
    path, file = video(tmp_path)
    index = file.parent / "images.txt"
    index.write_text(index.read_text().replace(file.name, f"{'a' * 300}.png"))
    with pytest.raises(RecordingError, match=r"aaa\.png: missing, or no image"):
        read(path)


def test_a_bag_whose_parts_are_numbered_in_other_scripts_is_read(tmp_path):
    path, file = metadata(tmp_path)
    file.unlink()
    (part,) = path.glob("*.mcap")
    shutil.move(part, path / "bag_1²2.mcap")
    assert read(path) == len(EVENTS)
