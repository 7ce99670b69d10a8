"""Files that are no bags: the dataset's text, Prophesee raw and AEDAT4."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_writers import DATA, evt2_words, evt3_words, evt21_words, random_events, write_ecd, write_raw

from etd_ros.events import EventsError, concatenate
from etd_ros.recordings import RecordedImage, RecordingError, open_recording
from etd_ros.recordings.ecd import SECONDS_MAX, _parse_lines

EVENTS = random_events(3000, step_ns=100_000)
RAW_HEADERS = {
    "evt2": "% evt 2.0\n% geometry 64x48\n% end\n",
    "evt21": "% evt 2.1\n% format EVT21;height=48;width=64\n% end\n",
    "evt3": "% date 2024-01-01 10:00:00\n% format EVT3;height=48;width=64\n",
}
RAW_WORDS = {"evt2": evt2_words, "evt21": evt21_words, "evt3": evt3_words}


def read(path: Path, **options: object) -> np.ndarray:
    with open_recording(path, **options) as recording:
        return concatenate(list(recording.events())).to_structured()


def error_of(path: Path, **options: object) -> str:
    with pytest.raises(RecordingError) as caught, open_recording(path, **options) as recording:
        for _ in recording.packets():
            pass
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_text_events_are_read_to_the_nanosecond_from_the_folder_or_the_file(tmp_path):
    events = random_events(500, start_ns=1_700_000_000_123_456_789, step_ns=1001)
    folder = write_ecd(tmp_path / "ecd", events)
    assert np.array_equal(read(folder), events.to_structured())
    assert np.array_equal(read(folder / "events.txt"), events.to_structured())


def test_text_without_a_size_is_of_the_datasets_camera(tmp_path):
    with open_recording(write_ecd(tmp_path / "ecd", EVENTS)) as recording:
        assert (recording.width, recording.height) == (240, 180)


def test_a_first_line_with_the_size_is_taken(tmp_path):
    folder = write_ecd(tmp_path / "ecd", EVENTS)
    text = folder / "events.txt"
    text.write_text("64 48\n" + text.read_text())
    with open_recording(folder) as recording:
        assert (recording.width, recording.height) == (64, 48)
    assert np.array_equal(read(folder), EVENTS.to_structured())


def test_text_events_off_the_sensor_name_the_option_that_helps(tmp_path):
    folder = write_ecd(tmp_path / "ecd", random_events(10, width=640, height=480))
    assert "--size" in error_of(folder)
    assert len(read(folder, size=(640, 480))) == 10


def test_an_impossible_size_is_refused(tmp_path):
    with pytest.raises(EventsError, match="0x480"):
        open_recording(write_ecd(tmp_path / "ecd", EVENTS), size=(0, 480))


@pytest.mark.parametrize("name", ["traffic.mcap", "traffic.aedat4"])
def test_a_size_beside_a_recording_that_tells_its_own_is_refused(data, name):
    with pytest.raises(RecordingError, match="leave --size out"):
        open_recording(data / "traffic" / name, size=(640, 480))


def test_images_give_the_size_and_come_between_the_events(tmp_path):
    folder = write_ecd(tmp_path / "ecd", EVENTS)
    cv2.imwrite(str(folder / "frame.png"), np.full((48, 64), 7, np.uint8))
    (folder / "images.txt").write_text("0.1 frame.png\n0.25 frame.png\n")
    with open_recording(folder) as recording:
        assert (recording.width, recording.height) == (64, 48)
        items = list(recording.items())
    for i, item in enumerate(items):
        if isinstance(item, RecordedImage):
            assert item.data.shape == (48, 64)
            assert items[i - 1].t[-1] < item.stamp_ns <= items[i + 1].t[0]
    assert [item.stamp_ns for item in items if isinstance(item, RecordedImage)] == [100_000_000, 250_000_000]


def test_a_listed_image_that_is_missing_is_an_error(tmp_path):
    folder = write_ecd(tmp_path / "ecd", EVENTS)
    (folder / "images.txt").write_text("0.1 nothing.png\n")
    assert "nothing.png" in error_of(folder)


@pytest.mark.parametrize(
    "line",
    [
        "0.5 1 2",
        "0.5 1 2 3",
        "0.5 1 2 1 9",
        "x 1 2 1",
        "-0.5 1 2 1",
        "1e-3 1 2 1",
        "0.5 70000 2 1",
        "99999999999 1 2 1",
        f"{SECONDS_MAX + 1}.0 1 2 1",
    ],
)
def test_a_line_that_is_no_event_is_named(tmp_path, line):
    folder = write_ecd(tmp_path / "ecd", EVENTS[:2])
    with (folder / "events.txt").open("a") as file:
        file.write(f"{line}\n")
    assert "line 3" in error_of(folder)


@settings(deadline=None, max_examples=200)
@given(st.binary(max_size=80))
def test_the_text_parser_never_writes_more_than_there_is_room_for(text):
    arrays = np.zeros(3, np.int64), np.zeros(3, np.uint16), np.zeros(3, np.uint16), np.zeros(3, np.uint8)
    count, bad_line = _parse_lines(np.frombuffer(text, np.uint8), *arrays)
    assert 0 <= count <= 3
    assert bad_line <= text.count(b"\n")


@settings(deadline=None, max_examples=100)
@given(
    st.lists(
        st.tuples(st.integers(0, SECONDS_MAX * 10**9), st.integers(0, 65535), st.integers(0, 65535), st.integers(0, 1)),
        min_size=1,
        max_size=5,
    )
)
def test_the_text_parser_agrees_with_pythons_own(rows):
    text = "".join(f"{t // 10**9}.{t % 10**9:09d} {x}\t{y} {p}\r\n" for t, x, y, p in rows)
    n = len(rows)
    arrays = np.zeros(n, np.int64), np.zeros(n, np.uint16), np.zeros(n, np.uint16), np.zeros(n, np.uint8)
    assert _parse_lines(np.frombuffer(text.encode(), np.uint8), *arrays) == (n, -1)
    assert list(zip(*(array.tolist() for array in arrays), strict=True)) == rows


def test_long_text_is_read_in_memory_far_below_its_size(tmp_path):
    events = random_events(500_000, step_ns=5000)
    folder = write_ecd(tmp_path / "ecd", events)
    tracemalloc.start()
    with open_recording(folder) as recording:
        count = sum(len(batch) for batch in recording.events())
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert count == len(events)
    assert peak < (folder / "events.txt").stat().st_size / 2


def test_batches_last_at_most_10_ms(tmp_path):
    with open_recording(write_ecd(tmp_path / "ecd", EVENTS)) as recording:
        assert all(batch.t[-1] - batch.t[0] < 10_000_000 for batch in recording.events())


@pytest.mark.parametrize("encoding", list(RAW_WORDS))
def test_raw_words_give_their_events(tmp_path, encoding):
    path = write_raw(tmp_path / "a.raw", RAW_HEADERS[encoding], RAW_WORDS[encoding](EVENTS))
    with open_recording(path) as recording:
        assert (recording.width, recording.height) == (64, 48)
        assert recording.topics[0].encoding == encoding
    assert np.array_equal(read(path), EVENTS.to_structured())


def test_evt21_words_of_legacy_endianness_have_their_halves_swapped(tmp_path):
    words = evt21_words(EVENTS).view("<u4").reshape(-1, 2)[:, ::-1].copy()
    path = write_raw(tmp_path / "a.raw", "% format EVT21;height=48;width=64;endianness=legacy\n% end\n", words)
    assert np.array_equal(read(path), EVENTS.to_structured())


@pytest.mark.parametrize("encoding", list(RAW_WORDS))
def test_a_raw_file_that_ends_inside_a_word_is_truncated(tmp_path, encoding):
    path = write_raw(tmp_path / "a.raw", RAW_HEADERS[encoding], RAW_WORDS[encoding](EVENTS))
    path.write_bytes(path.read_bytes()[:-1])
    assert "truncated" in error_of(path)


def test_a_raw_file_without_geometry_names_the_option_that_helps(tmp_path):
    path = write_raw(tmp_path / "a.raw", "% evt 3.0\n", evt3_words(EVENTS))
    assert "--size" in error_of(path)
    assert np.array_equal(read(path, size=(64, 48)), EVENTS.to_structured())


@pytest.mark.parametrize("header", ["% evt 4.0\n% geometry 64x48\n", "% geometry 64x48\n", ""])
def test_a_raw_file_of_unknown_encoding_lists_the_known_ones(tmp_path, header):
    path = write_raw(tmp_path / "a.raw", header, evt3_words(EVENTS))
    assert "2.0, 2.1 and 3.0" in error_of(path)


def test_a_raw_file_with_a_header_only_is_empty(tmp_path):
    assert "empty" in error_of(write_raw(tmp_path / "a.raw", RAW_HEADERS["evt3"], np.empty(0, "<u2")))


def test_events_off_a_raw_files_sensor_are_dropped_and_counted(tmp_path):
    path = write_raw(tmp_path / "a.raw", "% evt 3.0\n% geometry 32x48\n", evt3_words(EVENTS))
    with open_recording(path) as recording:
        off_sensor = sum(packet.off_sensor for packet in recording.packets())
    assert off_sensor == np.count_nonzero(EVENTS.x >= 32)
    assert len(read(path)) == len(EVENTS) - off_sensor


def test_the_same_recording_as_mcap_and_as_aedat4_gives_the_same_events_and_images():
    traffic = DATA / "traffic"
    assert np.array_equal(read(traffic / "traffic.mcap"), read(traffic / "traffic.aedat4"))
    with open_recording(traffic / "traffic.mcap") as bag, open_recording(traffic / "traffic.aedat4") as file:
        for expected, image in zip(bag.images(), file.images(), strict=True):
            assert image.stamp_ns == expected.stamp_ns
            assert np.array_equal(image.data, expected.data)


@pytest.mark.parametrize("kept", [100, 3000, 300_000])
def test_a_truncated_aedat4_file_is_an_error(tmp_path, kept):
    path = tmp_path / "cut.aedat4"
    path.write_bytes((DATA / "traffic" / "traffic.aedat4").read_bytes()[:kept])
    assert "truncated or damaged" in error_of(path)


def test_a_file_that_is_no_bag_has_no_messages(tmp_path):
    with (
        open_recording(write_ecd(tmp_path / "ecd", EVENTS)) as recording,
        pytest.raises(RecordingError, match="no ROS messages"),
    ):
        recording.messages()
