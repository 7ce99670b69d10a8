"""Recordings whose times step back are sent event by event as they were recorded."""

import numpy as np

from etd_ros.nodes.replay import replay_messages
from etd_ros.recordings import open_recording
from msg_adapters import Layout, decoder_for


def test_events_whose_times_step_back_are_sent_once_each_and_in_order(tmp_path):
    times_ms = [1000, 998, 1001, 1030, 1028, 1005, 1031, 1, 2, 1032]
    lines = (f"{ms // 1000}.{ms % 1000:03d} {column} 3 1\n" for column, ms in enumerate(times_ms))
    (tmp_path / "events.txt").write_text("".join(lines))
    decoder = decoder_for("event_camera_msgs/msg/EventPacket", Layout.ROS2)
    with open_recording(tmp_path) as recording:
        sent = [decoder.decode(message.data).events for message in replay_messages(recording)]
    assert np.concatenate([events.x for events in sent]).tolist() == list(range(len(times_ms)))
    assert np.concatenate([events.t for events in sent]).tolist() == [ms * 10**6 for ms in times_ms]
