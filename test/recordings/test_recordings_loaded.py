"""Recordings in memory."""

from __future__ import annotations

import numpy as np
import pytest

from etd_ros.events import Events, concatenate
from etd_ros.recordings import open_recording
from etd_ros.recordings.interface import RecordingError
from etd_ros.recordings.loaded import LoadedRecording
from etd_ros.stream import Restart


def test_a_loaded_recording_gives_what_the_recording_gives(data):
    with open_recording(data / "traffic") as recording:
        loaded = LoadedRecording.load(recording)
        assert (loaded.width, loaded.height) == (recording.width, recording.height)
        for _ in range(2):
            batches, expected = list(loaded.streams()), list(recording.streams())
            assert [batch.restart for batch in batches] == [batch.restart for batch in expected]
            got, wanted = (concatenate([batch.events for batch in given]) for given in (batches, expected))
            np.testing.assert_array_equal(got.to_structured(), wanted.to_structured())
            images, expected_images = list(loaded.images()), list(recording.images())
            assert [image.stamp_ns for image in images] == [image.stamp_ns for image in expected_images]
            np.testing.assert_array_equal(images[-1].data, expected_images[-1].data)
    assert loaded.events == len(got) == 78_830


def test_what_comes_before_a_time_is_passed_over_without_a_copy(data):
    with open_recording(data / "traffic") as recording:
        loaded = LoadedRecording.load(recording)
    events = concatenate([batch.events for batch in loaded.streams()])
    stamp_ns = int(events.t[len(events) // 2])
    since = loaded.since(stamp_ns)
    rest = concatenate([batch.events for batch in since.streams()])
    np.testing.assert_array_equal(rest.to_structured(), events.between(stamp_ns, 2**62).to_structured())
    assert [image.stamp_ns for image in since.images()] == [
        image.stamp_ns for image in loaded.images() if image.stamp_ns >= stamp_ns
    ]
    held = [batch.events.t for batch in loaded.streams()]
    assert all(any(np.shares_memory(batch.events.t, t) for t in held) for batch in since.streams())
    with pytest.raises(RecordingError, match="no events from"):
        loaded.since(int(events.t[-1]) + 1)


def packet(stamp_ns: int, seq: int):
    one = np.ones(1, np.uint16)
    return Events(np.array([stamp_ns]), one, one, one.astype(np.uint8), 4, 4), seq, "mono"


def test_messages_without_events_are_not_taken_for_lost():
    recording = LoadedRecording([packet(1, 0), (Events.empty(4, 4), 1, "mono"), packet(3, 2), packet(4, 3)], [])
    assert [batch.restart for batch in recording.streams()] == [None] * 3
    assert [batch.restart for batch in recording.since(1).since(1).streams()] == [None] * 3
    assert [batch.events.t.tolist() for batch in recording.since(2).streams()] == [[3], [4]]


def test_lost_messages_are_still_seen():
    restarts = [batch.restart for batch in LoadedRecording([packet(1, 0), packet(2, 1), packet(3, 5)], []).streams()]
    assert restarts == [None, None, Restart.GAP]
