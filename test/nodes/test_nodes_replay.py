"""replay publishes what was recorded, when it was recorded."""

import os
import signal
import subprocess
import sys

import pytest
from event_camera_msgs.msg import EventPacket
from rosgraph_msgs.msg import Clock

from etd_ros.nodes.replay import replay_messages
from etd_ros.recordings import open_recording
from msg_adapters import Layout, decoder_for

EVENTS = "/event_camera/events"
PACKET = "event_camera_msgs/msg/EventPacket"


def test_event_packets_arrive_byte_for_byte_and_the_clock_runs(bench, data):
    recording_path = data / "traffic" / "traffic.mcap"
    with open_recording(recording_path) as recording:
        sent = [message.data for message in replay_messages(recording) if message.is_events]
    bench.listen(EVENTS, EventPacket, events=True)
    bench.listen("/clock", Clock, events=True)
    replay = bench.start("replay", str(recording_path), "--rate", "2", "--clock")
    bench.wait_until(lambda: replay.poll() is not None, "the replay is over")
    bench.wait_until(lambda: len(bench.messages[EVENTS]) == len(sent), "every message has come")
    assert bench.messages[EVENTS] == sent
    assert len(bench.messages["/clock"]) > 100
    assert replay.returncode == 0


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_a_loop_starts_again_until_it_is_interrupted(bench, data, by):
    recording_path = data / "drivers" / "mono_1280x720"
    bench.listen(EVENTS, EventPacket, events=True)
    with open_recording(recording_path) as recording:
        topic, sent = recording.topic, sum(message.is_events for message in replay_messages(recording))
    bench.listen(topic, EventPacket, events=True)
    bench.start("replay", str(recording_path), "--loop")
    bench.wait_until(lambda: len(bench.messages[topic]) > 3 * sent, "the fourth round has begun")
    assert bench.end("replay", by) == 0, bench.log("replay")


def test_it_cannot_wait_for_less_than_no_subscriber(bench, repository):
    assert bench.start("replay", str(repository / "bags" / "demo"), "--wait-for", "-1").wait(timeout=60) == 2
    assert "--wait-for -1 is out of range" in bench.log("replay")


def test_the_command_takes_what_is_for_ros(bench, data, repository):
    recording_path = data / "drivers" / "mono_1280x720"
    with open_recording(recording_path) as recording:
        topic, sent = recording.topic, sum(message.is_events for message in replay_messages(recording))
    bench.listen("/elsewhere", EventPacket, events=True)
    subprocess.run(
        [sys.executable, "-m", "etd_ros", "replay", recording_path, "--ros-args", "-r", f"{topic}:=/elsewhere"],
        cwd=repository,
        env={**os.environ, "ROS_DOMAIN_ID": str(bench.domain)},
        check=True,
        timeout=60,
    )
    bench.wait_until(lambda: len(bench.messages["/elsewhere"]) == sent, "every message has come")


def test_other_recordings_are_sent_as_mono_packets_with_the_same_events(data):
    with open_recording(data / "traffic" / "traffic.aedat4") as recording:
        expected = sum(len(events) for events in recording.events())
        decoder = decoder_for(PACKET, Layout.ROS2)
        decoded = [decoder.decode(message.data) for message in replay_messages(recording) if message.is_events]
    assert sum(len(message.events) for message in decoded) == expected
    assert {message.encoding for message in decoded} == {"mono"}
    assert [message.seq for message in decoded] == list(range(len(decoded)))
