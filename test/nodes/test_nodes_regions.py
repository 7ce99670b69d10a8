"""NZGE in the targets' search regions, with the accumulator and the tracker in two processes."""

import math
from collections.abc import Iterator

import pytest
from event_camera_msgs.msg import EventPacket
from rclpy.publisher import Publisher
from sensor_msgs.msg import Image
from vision_msgs.msg import Detection2DArray

from etd_ros.boxes import Box
from etd_ros.engine import Step, track
from etd_ros.events import Events, concatenate
from etd_ros.nodes.connections import EVENT_QOS, FRAME_QOS
from etd_ros.recordings import open_recording
from etd_ros.settings import settings_from_mapping
from etd_ros.stream import StreamBatch
from etd_ros.targets import TargetStart
from etd_ros.tracking import TargetState
from msg_adapters import Detection, decode_detections, decode_image, encode_detections, encode_event_packet

EVENTS = "/event_camera/events"
REGIONS = "/tracker/search_regions"
ACCUMULATOR = ("-r", f"~/events:={EVENTS}", "-p", "atsltd.entropy_region:=targets", "-p", "conversion:=atsltd")
BOX = Box(100.0, 200.0, 40.0, 30.0)
# No candidate overlaps that much: the target is lost on the first frame, and its region stays where it is.
SETTINGS = {"tracking.failure_iou": 1.0, "atsltd.entropy_region": "targets"}
EVENTS_MAX = 25_000
"""So few that their frames find room in the queue of a reader that is late."""
EVENTS_A_MESSAGE = 1_000


@pytest.fixture(scope="module")
def events(data) -> Events:
    with open_recording(data / "traffic" / "traffic.mcap") as recording:
        return concatenate([batch.events for batch in recording.streams()])[:EVENTS_MAX]


@pytest.fixture(scope="module")
def offline(events) -> list[Step]:
    target = TargetStart("spot", BOX)
    return list(track([StreamBatch(events, None)], [target], method="etd-nr", settings=settings_from_mapping(SETTINGS)))


def messages_of(events: Events, first: int) -> Iterator[bytes]:
    """The events from the first on; the message before has number 0."""
    for seq, start in enumerate(range(first, len(events), EVENTS_A_MESSAGE), 1):
        part = events[start : start + EVENTS_A_MESSAGE]
        yield encode_event_packet(part, stamp_ns=int(part.t[0]), frame_id="camera", seq=seq)


def wait_until_linked(bench, source: Publisher, *, frame_subscribers: int) -> None:
    """Everybody hears everybody, the bench the search regions too."""
    bench.wait_until(
        lambda: (
            source.get_subscription_count() == 1
            and bench.figure("accumulator", "frame subscribers") == str(frame_subscribers)
            and bench.figure("tracker", "search region subscribers") == "2"
        ),
        "the nodes are linked",
    )


def test_frames_are_measured_round_a_lost_target_as_offline_until_its_tracker_ends(bench, events, offline):
    assert {step.reports[0].state for step in offline} == {TargetState.LOST}
    for topic, kind in (("/accumulator/frames", Image), (REGIONS, Detection2DArray)):
        bench.listen(topic, kind)
    source = bench.node.create_publisher(EventPacket, EVENTS, EVENT_QOS)
    bench.start("accumulator", ros=ACCUMULATOR)
    spot = f"spot:{BOX.x},{BOX.y},{BOX.w},{BOX.h}"
    bench.start("tracker", ros=("-p", f"targets:={spot}", "-p", "method:=etd-nr", "-p", "tracking.failure_iou:=1.0"))
    wait_until_linked(bench, source, frame_subscribers=2)
    # The first frame's last event, and none of the next one: that asks for the regions with its own first event.
    first = offline[0].frame.events
    source.publish(encode_event_packet(events[:first], stamp_ns=int(events.t[0]), frame_id="camera", seq=0))
    bench.wait_until(lambda: bench.figure("accumulator", "search regions") == "1", "the accumulator knows the region")
    for message in messages_of(events, first):
        source.publish(message)
    bench.wait_until(lambda: bench.figure("accumulator", "events") == str(len(events)), "all events have come")
    stamps, regions = [step.frame.stamp_ns for step in offline], bench.messages[REGIONS]
    bench.wait_until(
        lambda: bool(regions) and decode_detections(regions[-1]).stamp_ns >= stamps[-1], "the last frame is tracked"
    )
    assert [decode_image(message).stamp_ns for message in bench.messages["/accumulator/frames"]] == stamps
    for message in map(decode_detections, regions):
        assert [tuple(region.box) for region in message.detections] == [pytest.approx(BOX.scaled(1.5))]
    assert bench.end("tracker") == 0
    bench.wait_until(lambda: bench.figure("accumulator", "search regions") == "0", "the accumulator forgets the region")


def test_search_regions_that_cannot_be_are_left_out_and_counted_and_frames_go_on(bench, events):
    bench.listen("/accumulator/frames", Image)
    source = bench.node.create_publisher(EventPacket, EVENTS, EVENT_QOS)
    regions = bench.node.create_publisher(Detection2DArray, REGIONS, FRAME_QOS)
    bench.start("accumulator", ros=ACCUMULATOR)
    bench.wait_until(
        lambda: source.get_subscription_count() == regions.get_subscription_count() == 1, "both topics are read"
    )

    def send(*boxes: Box) -> None:
        detections = [Detection("", box, 1.0, "") for box in boxes]
        regions.publish(encode_detections(detections, stamp_ns=0, frame_id=""))

    wrong = [Box(math.nan, 1, 10, 10), Box(1, 1, math.inf, 10), Box(1e308, 1, 1e308, 10), Box(1, 1, 0, 10)]
    send(*wrong, BOX)
    bench.wait_until(lambda: bench.figure("accumulator", "errors") == "4", "they are counted")
    assert bench.next_figure("accumulator", "search regions") == "1"
    send(*wrong)
    bench.wait_until(lambda: bench.figure("accumulator", "errors") == "8", "they are counted again")
    assert bench.next_figure("accumulator", "search regions") == "0"
    for message in messages_of(events, 0):
        source.publish(message)
    bench.wait_until(lambda: bool(bench.messages["/accumulator/frames"]), "frames come")
    assert f"{REGIONS}: 4 box(es) are left out" in bench.log("accumulator")
    assert bench.next_figure("accumulator", "errors") == "8"


def test_no_search_regions_before_a_target_has_started(bench, events):
    bench.listen(REGIONS, Detection2DArray)
    source = bench.node.create_publisher(EventPacket, EVENTS, EVENT_QOS)
    bench.start("accumulator", ros=ACCUMULATOR)
    late_ns = int(events.t[-1]) + 1
    bench.start("tracker", ros=("-p", f"targets:=late:100,200,40,30@{late_ns}", "-p", "method:=etd-nr"))
    wait_until_linked(bench, source, frame_subscribers=1)
    for message in messages_of(events, 0):
        source.publish(message)
    bench.wait_until(lambda: bool(bench.messages[REGIONS]), "a frame is tracked")
    assert {decode_detections(message).detections for message in bench.messages[REGIONS]} == {()}
    assert bench.next_figure("accumulator", "search regions") == "0"
