"""Streams that end and begin again: looping bags, readers that come and go, publishers that change."""

import numpy as np
from dvs_msgs.msg import Event, EventArray
from event_camera_msgs.msg import EventPacket
from sensor_msgs.msg import Image
from vision_msgs.msg import Detection2DArray

from etd_ros.events import Events
from etd_ros.nodes.connections import EVENT_QOS
from etd_ros.nodes.event_input import EventCounters, EventDecoding
from etd_ros.settings import Settings
from etd_ros.stream import Restart
from msg_adapters import decode_detections, decode_image, encode_event_packet

EVENTS = "/event_camera/events"
REMAP = ("-r", f"~/events:={EVENTS}")
PACKET = "event_camera_msgs/msg/EventPacket"


def packet(first_ns: int, seq: int) -> bytes:
    t = first_ns + np.arange(4, dtype=np.int64)
    zeros = np.zeros(4, np.uint16)
    events = Events(t, zeros, zeros, np.zeros(4, np.uint8), 16, 12)
    return encode_event_packet(events, stamp_ns=first_ns, frame_id="camera", seq=seq)


def rounds(stamps: list[int]) -> list[list[int]]:
    """Stamps split where they step back."""
    split: list[list[int]] = [[]]
    for stamp_ns in stamps:
        if split[-1] and stamp_ns < split[-1][-1]:
            split.append([])
        split[-1].append(stamp_ns)
    return split


def test_reading_again_after_a_pause_starts_a_new_stream():
    settings = Settings()
    counters = EventCounters()
    first = EventDecoding(PACKET, settings, resumes=False, counters=counters)
    assert [batch.restart for number in range(2) for _, batch in first.decode(packet(10 * number, number))] == [
        None
    ] * 2
    # The clock may have gone back meanwhile, which the new decoder cannot know.
    again = EventDecoding(PACKET, settings, resumes=True, counters=counters)
    restarts = [batch.restart for number in range(2) for _, batch in again.decode(packet(5 + number, 7 + number))]
    assert restarts == [Restart.PAUSE, None]
    assert (counters.stream.restarts, counters.stream.gaps) == (1, 0)


def test_what_the_node_dropped_itself_is_not_told_as_lost():
    counters = EventCounters()
    decoding = EventDecoding(PACKET, Settings(), resumes=False, counters=counters, dropped=5)
    messages = ((0, 5), (3, 7), (4, 7), (6, 7))
    restarts = [
        batch.restart for seq, dropped in messages for _, batch in decoding.decode(packet(10 * seq, seq), dropped)
    ]
    assert restarts == [None, Restart.DROPPED, None, Restart.GAP]
    assert (counters.stream.gaps, counters.stream.lost_messages) == (1, 1)


def test_a_looping_replay_is_tracked_again_in_its_second_round(bench, repository):
    recording, truth = repository / "bags" / "demo", repository / "bags" / "demo" / "boxes.csv"
    stamps: dict[str, list[int]] = {"/accumulator/frames": [], "/reconstruction/image_raw": []}
    for topic, found in stamps.items():
        bench.listen(topic, Image, lambda message, found=found: found.append(decode_image(message).stamp_ns))
    bench.listen("/tracker/detections", Detection2DArray)
    bench.start("accumulator", ros=REMAP)
    bench.start("reconstruction", ros=(*REMAP, "-p", "image_interval_s:=0.0"))
    bench.start("tracker", ros=("-p", f"targets_file:={truth}"))
    bench.wait_until(
        lambda: (
            bench.figure("accumulator", "frame subscribers") == "3"
            and bench.figure("reconstruction", "image subscribers") == "2"
        ),
        "the nodes are linked",
    )
    # Half as fast: an image for each of 555 frames a second is more than two cores bring through four processes.
    bench.start("replay", str(recording), "--loop", "--rate", "0.5", "--wait-for", "2")
    bench.wait_until(lambda: all(len(rounds(found)) > 2 for found in stamps.values()), "two rounds are over")

    def has_boxes_again() -> bool:
        messages = [decode_detections(message) for message in bench.messages["/tracker/detections"]]
        first = rounds([message.stamp_ns for message in messages])[0]
        return any(message.detections for message in messages[len(first) :])

    bench.wait_until(has_boxes_again, "the tracker has boxes of a second round")
    bench.end("replay")
    frames, images = (rounds(found)[1] for found in stamps.values())
    assert len(set(images) & set(frames)) > len(frames) / 2
    for name in ("accumulator", "reconstruction", "tracker"):
        assert "internal error" not in bench.log(name)
        assert bench.next_figure(name, "errors") == "0"


def test_a_publisher_of_another_event_type_is_read_when_it_takes_the_place_of_the_first(bench):
    bench.listen("/accumulator/frames", Image)
    first = bench.node.create_publisher(EventPacket, EVENTS, EVENT_QOS)
    bench.start("accumulator", ros=REMAP)
    bench.wait_until(lambda: first.get_subscription_count() == 1, "the accumulator reads packets")
    bench.node.destroy_publisher(first)
    second = bench.node.create_publisher(EventArray, EVENTS, EVENT_QOS)
    bench.wait_until(lambda: second.get_subscription_count() == 1, "the accumulator reads arrays")
    message = EventArray(width=16, height=12, events=[Event(x=1, y=2, polarity=True)])

    def counted() -> bool:
        second.publish(message)
        return bench.figure("accumulator", "events") not in ("", "0")

    bench.wait_until(counted, "its events are counted")
