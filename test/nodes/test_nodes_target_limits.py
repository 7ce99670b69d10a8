"""What senders of targets cannot do: take all memory, all places, or a target that the operator has given."""

import dataclasses
import itertools

import numpy as np
import pytest
from camera import Camera, Shot, shots_of
from conftest import Bench
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from rclpy.publisher import Publisher
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger
from vision_msgs.msg import Detection2DArray

from etd_ros.boxes import Box
from etd_ros.events import Events
from etd_ros.nodes.connections import FRAME_QOS
from etd_ros.nodes.remarks import REMARKS_PERIOD_S
from etd_ros.nodes.target_limits import LOST_MIN_S, START_AHEAD_MAX_S, EventClock, LostTimes, Refusals
from etd_ros.nodes.target_places import names_of
from etd_ros.tracking import TargetReport, TargetState
from msg_adapters import (
    Detection,
    PointMessage,
    decode_diagnostics,
    encode_detections,
    encode_image,
    encode_point,
)

REMAP = ("-r", "~/events:=/event_camera/events")
BALL, DRUM = Box(64.866, 34.762, 40, 40), Box(139.382, 47.099, 46, 36)
TARGETS = "targets:=ball:64.866,34.762,40,40;drum:139.382,47.099,46,36"
EMPTY_CORNER = Box(2.0, 150.0, 20.0, 20.0)
FOR_EVER_NS = 2 * 10**18
"""Later than any stamp of the recording, and than today."""
S_NS = 1_000_000_000
FIRST_NS = 1_700_000_000 * S_NS


def boxes_at(box: Box, *names: str, stamp_ns: int = 0) -> bytes:
    detections = [Detection(name, box, 1.0, "") for name in names]
    return encode_detections(detections, stamp_ns=stamp_ns, frame_id="")


def sender(bench: Bench, node: str = "pipeline") -> Publisher:
    publisher = bench.node.create_publisher(Detection2DArray, f"/{node}/targets", FRAME_QOS)
    bench.wait_until(lambda: publisher.get_subscription_count() == 1, "targets are taken")
    return publisher


def states_of(bench: Bench, node: str = "pipeline") -> dict[str, str]:
    """Names and states in the newest message of `~/status`."""
    messages = bench.messages[f"/{node}/status"]
    return (
        {}
        if not messages
        else {dict(status.values)["target"]: status.message for status in decode_diagnostics(messages[-1]).statuses}
    )


def start_looping(bench: Bench, repository, *parameters: str) -> Publisher:
    bench.listen("/pipeline/status", DiagnosticArray)
    bench.start("pipeline", ros=(*REMAP, *(word for value in parameters for word in ("-p", value))))
    targets = sender(bench)
    bench.start("replay", str(repository / "bags" / "demo"), "--loop", "--wait-for", "1")
    bench.wait_until(lambda: bool(bench.messages["/pipeline/status"]), "frames come")
    return targets


def start_with_camera(bench: Bench, repository) -> tuple[list[Shot], Publisher, Camera]:
    """What a camera sees of the demo, who sends boxes, and the camera, as a pipeline that follows TARGETS reads it."""
    bench.listen("/pipeline/status", DiagnosticArray)
    bench.start("pipeline", ros=(*REMAP, "-p", TARGETS))
    targets = sender(bench)
    camera = Camera(bench, "/pipeline/detections")
    camera.wait_for_readers()
    return shots_of(repository / "bags" / "demo"), targets, camera


def errors(bench: Bench, node: str = "pipeline") -> int:
    return int(bench.figure(node, "errors") or 0)


def test_targets_are_kept_while_events_of_a_smaller_sensor_come_and_start_again_after_them(bench, repository):
    shots = shots_of(repository / "bags" / "demo")
    bench.start("pipeline", ros=(*REMAP, "-p", TARGETS))
    camera = Camera(bench, "/pipeline/detections")
    camera.wait_for_readers()
    numbers = itertools.count()

    def play(part: slice) -> set[str]:
        camera.play(dataclasses.replace(shot, seq=next(numbers)) for shot in shots[part])
        return set(camera.boxes[camera.latest_ns])

    def send_of_small_sensor(shot: Shot) -> None:
        zeros = np.zeros(500, np.uint16)
        t = np.linspace(shot.events.t[0], shot.events.t[-1] + 5 * 10_000_000, 500).astype(np.int64)
        small = Events(t, zeros, zeros, np.zeros(500, np.uint8), 32, 24)
        camera.send(Shot(small, next(numbers)).encoded())
        bench.wait_until(lambda: bench.figure("pipeline", "targets") == "0", "none is on the small sensor")

    assert play(slice(0, 40)) == {"ball", "drum"}
    bench.wait_until(lambda: bench.figure("pipeline", "targets") == "2", "both are followed")
    send_of_small_sensor(shots[40])
    bench.wait_until(lambda: errors(bench) == 2, "both are counted")
    (line,) = [line for line in bench.log("pipeline").splitlines() if "32x24 sensor" in line and "off" in line]
    assert "'ball'" in line
    assert "'drum'" in line
    assert play(slice(50, 90)) == {"ball", "drum"}
    bench.wait_until(lambda: bench.figure("pipeline", "targets") == "2", "both are followed again")
    send_of_small_sensor(shots[90])
    assert bench.call(Trigger, "/pipeline/reset", Trigger.Request()).success
    assert play(slice(100, 140)) == {"ball", "drum"}
    bench.wait_until(lambda: bench.figure("pipeline", "targets") == "2", "both are followed after a reset, too")
    assert errors(bench) == 2, "what was said is not counted again"
    assert bench.log("pipeline").count("off the 32x24 sensor") == 1


def test_a_frame_of_one_pixel_does_not_delete_the_trackers_targets(bench):
    bench.listen("/tracker/status", DiagnosticArray)
    bench.start("tracker", ros=("-p", "targets:=cup:100,80,30,30"))
    frames = bench.node.create_publisher(Image, "/accumulator/frames", FRAME_QOS)
    bench.wait_until(lambda: frames.get_subscription_count() == 1, "frames are read")

    def send(step: int, width: int, height: int) -> None:
        before = len(bench.messages["/tracker/status"])
        data = np.zeros((height, width, 2), np.uint8)
        frames.publish(encode_image(data, stamp_ns=S_NS + step * 10_000_000, frame_id="camera"))
        bench.wait_until(lambda: len(bench.messages["/tracker/status"]) > before, "the frame is tracked")

    bench.wait_until(lambda: bench.node.count_publishers("/tracker/status") == 1, "states are published")
    found = []
    for step, size in enumerate([(240, 180), (1, 1), (240, 180)]):
        send(step, *size)
        found.append(set(states_of(bench, "tracker")))
    assert found == [{"cup"}, set(), {"cup"}]
    assert bench.log("tracker").count("off the 1x1 sensor") == 1


def test_a_message_that_names_thousands_of_boxes_takes_no_more_places_than_there_are(bench, repository):
    targets = start_looping(bench, repository, TARGETS, "targets_max:=3", "method:=etd-plus")
    targets.publish(boxes_at(EMPTY_CORNER, *(f"flood_{number}" for number in range(5000))))
    bench.wait_until(lambda: errors(bench) == 4999, "all but one are refused")
    bench.wait_until(lambda: bench.figure("pipeline", "targets") == "3", "three are followed")
    # The states come on a topic of their own, which may reach a busy machine's bench later.
    bench.wait_until(lambda: states_of(bench).keys() == {"ball", "drum", "flood_0"}, "these are the three")
    (line,) = [line for line in bench.log("pipeline").splitlines() if "flood_" in line]
    for part in ("4999 new targets", "targets_max = 3", "an id that stays the same", "a box of size 0"):
        assert part in line
    clicks = bench.node.create_publisher(PointStamped, "/pipeline/clicked_point", FRAME_QOS)
    bench.wait_until(lambda: clicks.get_subscription_count() == 1, "clicks are taken")
    clicks.publish(encode_point(PointMessage(0, "", 100.0, 90.0)))
    bench.wait_until(lambda: errors(bench) == 5000, "a click is refused, too")
    targets.publish(boxes_at(Box(100, 80, 30, 30), "ball", "flood_0"))
    targets.publish(boxes_at(Box(0, 0, 0, 0), "flood_0"))
    targets.publish(boxes_at(EMPTY_CORNER, "other"))
    bench.wait_until(lambda: states_of(bench).keys() == {"ball", "drum", "other"}, "who is stopped makes room")
    assert bench.set_parameter("pipeline", "targets_max", 4) == (True, "")
    targets.publish(boxes_at(EMPTY_CORNER, "one_more"))
    bench.wait_until(lambda: "one_more" in states_of(bench), "there is room at once")
    assert errors(bench) == 5000


def test_of_boxes_of_one_id_in_a_message_the_first_one_counts_and_the_others_are_said_and_counted(bench, repository):
    targets = start_looping(bench, repository, "method:=etd-plus")
    boxes = [("ball", BALL), ("ball", EMPTY_CORNER), ("drum", DRUM), ("drum", DRUM), ("", BALL), ("", EMPTY_CORNER)]
    message = encode_detections([Detection(name, box, 1.0, "") for name, box in boxes], stamp_ns=0, frame_id="")
    targets.publish(message)
    bench.wait_until(lambda: errors(bench) == 1, "the ball's second box is refused")
    (line,) = [line for line in bench.log("pipeline").splitlines() if "are refused" in line]
    for part in ("1 boxes ('ball')", "has the same id, and counts", "an id of its own"):
        assert part in line
    bench.wait_until(lambda: states_of(bench).keys() == {"ball", "drum", "target_1", "target_2"}, "all are followed")
    assert errors(bench) == 1


def test_a_target_that_is_lost_for_long_makes_room_and_those_of_the_parameters_do_not(bench, repository):
    # Without recovery what has no events is lost at once, and for good.
    nothing_there = "targets:=mine:2,150,20,20"
    targets = start_looping(bench, repository, nothing_there, "targets_max:=3", "method:=etd-nr")
    targets.publish(boxes_at(EMPTY_CORNER, "first"))
    bench.wait_until(lambda: states_of(bench).get("first") == "lost", "the first is lost")
    targets.publish(boxes_at(EMPTY_CORNER, "second"))
    bench.wait_until(lambda: set(states_of(bench).values()) == {"lost"} and len(states_of(bench)) == 3, "all are lost")

    def has_place(name: str) -> bool:
        targets.publish(boxes_at(EMPTY_CORNER, name))
        bench.spin_once()
        return name in states_of(bench)

    bench.wait_until(lambda: has_place("third"), "the one lost longest makes room")
    assert states_of(bench).keys() == {"mine", "second", "third"}


def test_more_targets_of_the_parameters_than_may_be_are_refused_when_it_is_configured(bench, repository):
    file = repository / "bags" / "demo" / "boxes.csv"
    process = bench.start("tracker", ros=("-p", f"targets_file:={file}", "-p", "targets_max:=2"))
    assert process.wait(timeout=60) == 2
    (line,) = bench.log("tracker").strip().splitlines()
    assert "name 3 targets, more than targets_max = 2" in line


def test_a_box_stamped_by_a_clock_that_is_ahead_is_refused_and_what_is_followed_goes_on(bench, repository):
    bench.listen("/pipeline/status", DiagnosticArray)
    waiting = f"later:100,80,30,30@{FOR_EVER_NS}"
    bench.start("pipeline", ros=(*REMAP, "-p", f"{TARGETS};{waiting}"))
    targets = sender(bench)
    targets.publish(boxes_at(BALL, "early_bird", stamp_ns=FOR_EVER_NS))
    bench.wait_until(lambda: bench.figure("pipeline", "targets") == "4", "it waits for the first events")
    assert errors(bench) == 0
    bench.start("replay", str(repository / "bags" / "demo"), "--loop", "--wait-for", "1")
    bench.wait_until(lambda: errors(bench) == 1, "it is refused when they come")
    (line,) = [line for line in bench.log("pipeline").splitlines() if "early_bird" in line]
    for part in ("after the newest events", "the sender's clock is ahead of the events'", "or 0: now"):
        assert part in line
    targets.publish(boxes_at(BALL, "ball", "stranger", stamp_ns=FOR_EVER_NS))
    bench.wait_until(lambda: errors(bench) == 3, "others are refused as they come")
    bench.wait_until(lambda: bench.figure("pipeline", "targets") == "3", "those of the parameters are left")
    states = states_of(bench)
    assert states.keys() == {"ball", "drum", "later"}
    assert states["later"] == "idle", "those of the parameters may wait"
    assert states["ball"] != "idle"


def test_a_box_is_held_against_the_frame_that_it_would_start_with(bench, repository):
    """As it comes, the events may be on another clock, or not have come for so long that nobody knows theirs."""
    shots, targets, camera = start_with_camera(bench, repository)
    camera.play(dataclasses.replace(shot, shift_ns=60 * S_NS) for shot in shots[:40])
    too_small = Box(100, 80, 1e-9, 1e-9)
    detections = [Detection("ball", BALL, 1.0, ""), Detection("tiny", too_small, 1.0, "")]
    targets.publish(encode_detections(detections, stamp_ns=camera.latest_ns, frame_id=""))
    bench.wait_until(lambda: errors(bench) == 1, "one is refused, and the other waits for the next frame")
    camera.play(shots[40:80])
    bench.wait_until(lambda: errors(bench) == 2, "it is refused with that frame")
    (line,) = [line for line in bench.log("pipeline").splitlines() if "after the newest events" in line]
    assert "1 targets ('ball') are refused" in line
    assert states_of(bench)["ball"] != "idle", "what is followed goes on"


def test_boxes_that_come_late_are_said_to_be_old(bench, repository):
    shots, targets, camera = start_with_camera(bench, repository)
    camera.play(shots[:60])
    late_ns = camera.latest_ns - 400_000_000
    targets.publish(encode_detections([Detection("late", DRUM, 1.0, "")], stamp_ns=late_ns, frame_id=""))
    camera.play(shots[60:90])
    bench.wait_until(lambda: "late" in states_of(bench), "it starts nevertheless")
    (line,) = [line for line in bench.log("pipeline").splitlines() if "what moves is elsewhere by now" in line]
    assert "1 targets ('late') start at boxes that are 0." in line
    assert errors(bench) == 0


def test_boxes_of_a_class_without_ids_are_targets_of_their_own_and_start_again_with_the_next_message(bench, repository):
    targets = start_looping(bench, repository)
    boxes = [(BALL, "thing"), (DRUM, "thing"), (EMPTY_CORNER, "")]
    detections = [Detection("", box, 1.0, class_id) for box, class_id in boxes]
    targets.publish(encode_detections(detections, stamp_ns=0, frame_id=""))
    bench.wait_until(lambda: states_of(bench).keys() == {"thing", "thing_2", "target_1"}, "all are followed")
    targets.publish(encode_detections(detections[:2], stamp_ns=0, frame_id=""))
    targets.publish(boxes_at(BALL, "last"))
    bench.wait_until(lambda: "last" in states_of(bench), "the next message is taken")
    assert states_of(bench).keys() == {"thing", "thing_2", "target_1", "last"}
    assert errors(bench) == 0


@pytest.mark.parametrize(
    ("ids_and_classes", "names"),
    [
        ([("a", "cup"), ("b", "cup"), ("a", "cup")], ["a", "b", "a"]),
        ([("", "cup"), ("", "can"), ("", "cup"), ("", "can")], ["cup", "can", "cup_2", "can_2"]),
        ([("", "cup"), ("", "cup"), ("cup", ""), ("cup_3", "")], ["cup_2", "cup_4", "cup", "cup_3"]),
        ([("", "cup_2"), ("", "cup"), ("", "cup")], ["cup_2", "cup", "cup_3"]),
        ([("", ""), ("", "")], ["", ""]),
    ],
)
def test_boxes_are_called_by_their_ids_or_else_by_their_classes_with_numbers(ids_and_classes, names):
    assert names_of([Detection(name, BALL, 1.0, class_id) for name, class_id in ids_and_classes]) == names


def test_a_box_for_a_later_time_of_a_looping_bag_waits_for_it_in_every_round(bench, repository):
    states: list[str] = []

    def take(message: bytes) -> None:
        for status in decode_diagnostics(message).statuses:
            if not states or states[-1] != status.message:
                states.append(status.message)

    bench.listen("/pipeline/status", DiagnosticArray, take)
    bench.start("pipeline", ros=REMAP)
    sender(bench).publish(boxes_at(BALL, "ball", stamp_ns=FIRST_NS + S_NS))
    bench.start("replay", str(repository / "bags" / "demo"), "--loop", "--wait-for", "1")
    bench.wait_until(lambda: states.count("idle") == 3, "a third round begins")
    assert states[:2] == ["idle", "tracking"]
    assert errors(bench) == 0


def test_the_events_clock_goes_on_before_a_quiet_scene_and_is_not_known_before_the_first():
    clock = EventClock()
    assert clock.ahead_s(FOR_EVER_NS) == 0.0
    clock.note(FIRST_NS)
    first_s = clock.ahead_s(FIRST_NS + 20 * S_NS)
    assert START_AHEAD_MAX_S < clock.ahead_s(FIRST_NS + 20 * S_NS) <= first_s <= 20.0
    assert clock.ahead_s(FIRST_NS - S_NS) == 0.0


def test_a_box_without_room_for_an_object_is_refused_and_what_is_followed_goes_on(bench, repository):
    targets = start_looping(bench, repository, TARGETS)
    targets.publish(boxes_at(Box(100, 80, 1e-9, 1e-9), "tiny", "ball"))
    bench.wait_until(lambda: errors(bench) == 2, "both are counted")
    assert "'tiny' (x 100, y 80, w 1e-09, h 1e-09) is too small to be followed" in bench.log("pipeline")
    targets.publish(boxes_at(DRUM, "good"))
    bench.wait_until(lambda: states_of(bench).keys() == {"ball", "drum", "good"}, "a good one is taken")


class _Speaker:
    """A node that only counts its errors and keeps what it says."""

    def __init__(self) -> None:
        self.errors = 0
        self.said: list[str] = []

    def get_logger(self):
        return self

    def warning(self, text: str) -> None:
        self.said.append(text)


def test_what_is_refused_without_a_word_is_told_together_when_the_time_is_over():
    node, clock = _Speaker(), [0.0]
    refusals = Refusals(node, lambda: clock[0])
    for number in range(7):
        refusals.note("box", f"box {number} is off the sensor")
    refusals.note("click", "click 1 is off the sensor")
    clock[0] = 0.5
    refusals.note("click", "click 2 is off the sensor")
    assert node.errors == 9
    assert node.said == ["box 0 is off the sensor (1 so far)", "click 1 is off the sensor (8 so far)"]
    clock[0] = REMARKS_PERIOD_S - 0.1
    refusals.say_rest()
    assert len(node.said) == 2
    clock[0] = REMARKS_PERIOD_S
    for _ in range(2):
        refusals.say_rest()
    (rest,) = node.said[2:]
    assert rest == "7 more such remarks in the last 5 s, the last one: click 2 is off the sensor (9 so far)"
    assert node.errors == 9


def test_a_node_tells_how_many_more_it_has_refused(bench, repository):
    targets = start_looping(bench, repository, TARGETS)
    for number in range(7):
        targets.publish(boxes_at(Box(9000, 9000, 10, 10), f"far_{number}"))
    bench.wait_until(lambda: errors(bench) == 7, "all are counted")
    bench.wait_until(lambda: "more such remarks" in bench.log("pipeline"), "the rest is told")
    (line,) = [line for line in bench.log("pipeline").splitlines() if "more such remarks" in line]
    assert "'far_6'" in line
    assert "off the 240x180 sensor" in line


@pytest.mark.parametrize("step_back_s", [0.0, 5.0])
def test_times_of_being_lost_go_on_when_the_stamps_of_a_looping_bag_step_back(step_back_s):
    lost = LostTimes()

    def note(stamp_s: float, *names: str) -> None:
        reports = [TargetReport(name, TargetState.LOST, None, 0.0) for name in names]
        lost.note(int(stamp_s * S_NS), [*reports, TargetReport("well", TargetState.TRACKING, BALL, 1.0)])

    note(10.0, "a")
    note(10.0 + LOST_MIN_S / 2, "a", "b", "found")
    note(11.0 - step_back_s, "a", "b")
    assert lost.long_lost() == []
    note(12.0 - step_back_s + LOST_MIN_S, "b", "a", "found")
    assert lost.long_lost() == ["a", "b"]
    note(12.0 - step_back_s + 2 * LOST_MIN_S, "b", "found")
    assert lost.long_lost() == ["b", "found"]
