"""Targets that cannot be started are counted, and the others are tracked; clicks, what moves, and stopping."""

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger
from vision_msgs.msg import Detection2D, Detection2DArray, ObjectHypothesisWithPose

from etd_ros.boxes import Box
from etd_ros.conversion import Frame
from etd_ros.engine import FrameSource
from etd_ros.evaluation import read_boxes, read_tracks
from etd_ros.events import concatenate
from etd_ros.nodes.connections import FRAME_QOS
from etd_ros.settings import Settings
from etd_ros.simulation import Path, Scene, Sprite, Waypoint, simulate
from etd_ros.simulation.textures import checks, smooth_noise
from msg_adapters import Detection, PointMessage, decode_detections, encode_detections, encode_image, encode_point

CLICKS = 40


def test_targets_off_the_sensor_or_too_early_are_counted_and_the_others_are_tracked(bench, repository):
    targets = "far:9000,9000,5,5;early:20,20,100,80@5;near:20,20,100,80"
    bench.listen("/pipeline/detections", Detection2DArray)
    bench.start("pipeline", ros=("-r", "~/events:=/event_camera/events", "-p", f"targets:={targets}"))
    bench.start("replay", str(repository / "bags" / "demo"), "--rate", "2")
    bench.wait_until(
        lambda: any(decode_detections(message).detections for message in bench.messages["/pipeline/detections"]),
        "a target is tracked",
    )
    bench.wait_until(lambda: bench.figure("pipeline", "errors") == "2", "the others are counted")
    names = {
        item.id for message in bench.messages["/pipeline/detections"] for item in decode_detections(message).detections
    }
    assert names == {"early", "near"}
    assert bench.next_figure("pipeline", "targets") == "2"
    assert "internal error" not in bench.log("pipeline")


@pytest.mark.parametrize("name", ["tracker", "pipeline"])
def test_a_node_that_tracks_can_be_reset(bench, name):
    client = bench.node.create_client(Trigger, f"/{name}/reset")
    bench.start(name)
    bench.wait_until(client.service_is_ready, "the service is there")
    answer = client.call_async(Trigger.Request())
    bench.wait_until(answer.done, "the service answers")
    assert answer.result().success
    assert "those that a click or motion started are forgotten" in answer.result().message
    assert bench.end(name) == 0


def detections_of(bench) -> set[str]:
    """The ids in the newest message of the pipeline."""
    messages = bench.messages["/pipeline/detections"]
    return {item.id for item in decode_detections(messages[-1]).detections} if messages else set()


def test_what_moves_is_tracked_without_any_target_given_until_it_is_stopped(bench, repository):
    bench.listen("/pipeline/detections", Detection2DArray)
    bench.start("pipeline", ros=("-r", "~/events:=/event_camera/events", "-p", "auto:=true"))
    targets = bench.node.create_publisher(Detection2DArray, "/pipeline/targets", FRAME_QOS)
    bench.start("replay", str(repository / "bags" / "demo"), "--rate", "0.5")
    bench.wait_until(lambda: "auto_1" in detections_of(bench), "a moving object is tracked")
    stop = encode_detections([Detection("auto_1", Box(0, 0, 0, 0), 1.0, "")], stamp_ns=0, frame_id="")
    targets.publish(stop)
    bench.wait_until(lambda: "auto_1" not in detections_of(bench), "it is stopped")
    assert bench.next_figure("pipeline", "errors") == "0"


def test_a_click_starts_what_moves_there_and_one_beside_the_sensor_is_counted(bench, repository):
    bench.listen("/pipeline/detections", Detection2DArray)
    bench.start("pipeline", ros=("-r", "~/events:=/event_camera/events"))
    points = bench.node.create_publisher(PointStamped, "/pipeline/clicked_point", FRAME_QOS)
    bench.start("replay", str(repository / "bags" / "demo"), "--rate", "0.3")
    bench.wait_until(lambda: bool(bench.messages["/pipeline/detections"]), "frames come")
    points.publish(encode_point(PointMessage(0, "", 9000, 10)))
    bench.wait_until(lambda: bench.figure("pipeline", "errors") == "1", "the click off the sensor is counted")
    stamp_ns = decode_detections(bench.messages["/pipeline/detections"][-1]).stamp_ns
    rows = read_boxes(repository / "bags" / "demo" / "boxes.csv")["ball"]
    box = min(rows, key=lambda row: abs(row.stamp_ns - stamp_ns)).box
    points.publish(encode_point(PointMessage(0, "", *box.center)))
    bench.wait_until(lambda: detections_of(bench) == {"point_2"}, "what was clicked is tracked")
    bench.wait_until(lambda: bench.figure("pipeline", "targets") == "1", "it is counted among the targets")


def test_clicks_that_start_nothing_do_not_flood_the_log(bench, repository):
    bench.listen("/pipeline/detections", Detection2DArray)
    bench.start("pipeline", ros=("-r", "~/events:=/event_camera/events", "-p", "discovery.click_wait_s:=0.2"))
    points = bench.node.create_publisher(PointStamped, "/pipeline/clicked_point", FRAME_QOS)
    bench.wait_until(lambda: points.get_subscription_count() == 1, "clicks are taken")
    for _ in range(CLICKS):
        points.publish(encode_point(PointMessage(0, "", 5, 175)))
    points.publish(encode_point(PointMessage(0, "", 9000, 10)))
    bench.start("replay", str(repository / "bags" / "demo"), "--loop")
    bench.wait_until(lambda: bench.figure("pipeline", "errors") == "1", "the last one, off the sensor, is counted")
    frames = len(bench.messages["/pipeline/detections"])
    bench.wait_until(lambda: len(bench.messages["/pipeline/detections"]) > frames + 1000, "all others have waited")
    lines = [line for line in bench.log("pipeline").splitlines() if "nothing has moved there" in line]
    assert 1 <= len(lines) < CLICKS // 4


def of_classes(name: str, box: Box, **scores: float) -> Detection2D:
    """A box that is of several classes, each more or less surely."""
    detection = Detection2D(id=name)
    detection.bbox.center.position.x, detection.bbox.center.position.y = box.center
    detection.bbox.size_x, detection.bbox.size_y = box.w, box.h
    for class_id, score in scores.items():
        result = ObjectHypothesisWithPose()
        result.hypothesis.class_id, result.hypothesis.score = class_id, score
        detection.results.append(result)
    return detection


def frames_of_turning_square() -> tuple[Box, list[Frame]]:
    """A checked square that turns on its way: its box at first, and frames."""
    rng = np.random.default_rng(5)
    way = Path([Waypoint(t, 60 + 100 * t, 90, 1.0, 3.0 * t) for t in np.arange(0, 0.61, 0.05)])
    square = Sprite("square", checks(rng, 36, 36, cell=9), np.ones((36, 36)), way)
    scene = Scene(240, 180, 0.6, 0.5 + 0.05 * smooth_noise(rng, 180, 240), (square,))
    events = concatenate(list(simulate(scene, seed=1, start_ns=1_000_000_000)))
    return scene.box("square", 0.0), list(FrameSource("atsltd_fine", 240, 180, Settings()).frames(events))


BEFORE_RESTART = 5


@pytest.mark.parametrize("given_again", [[], ["square"]])
@pytest.mark.parametrize(("of_class", "is_upright"), [("=person", True), ("", False)])
def test_a_person_is_one_after_a_restart_too(bench, tmp_path, of_class, is_upright, given_again):
    memory = tmp_path / "memory.csv"
    bench.listen("/tracker/detections", Detection2DArray)
    box, frames = frames_of_turning_square()
    images = bench.node.create_publisher(Image, "/accumulator/frames", FRAME_QOS)
    found = bench.messages["/tracker/detections"]

    def start(*parameters: str) -> None:
        words = [
            word
            for value in (f"memory_file:={memory}", "contours.refine_gain:=0.0", *parameters)
            for word in ("-p", value)
        ]
        bench.start("tracker", ros=tuple(words))
        bench.wait_until(lambda: images.get_subscription_count() == 1, "frames are read")

    def track(part: list[Frame]) -> list[Detection]:
        before = len(found)
        for number, frame in enumerate(part, before + 1):
            images.publish(encode_image(frame.data, stamp_ns=frame.stamp_ns, frame_id="camera"))
            bench.wait_until(lambda number=number: len(found) == number, "the frame is tracked")
        return [item for message in found[before:] for item in decode_detections(message).detections]

    def remembered_ns() -> int:
        rows = read_tracks(memory).get("square", []) if memory.is_file() else []
        return rows[-1].stamp_ns if rows else 0

    start("targets:=square:{},{},{},{}{}".format(*box, of_class))
    track(frames[:BEFORE_RESTART])
    bench.wait_until(lambda: remembered_ns() == frames[BEFORE_RESTART - 1].stamp_ns, "it is remembered")
    assert bench.end("tracker") == 0
    bench.wait_until(lambda: images.get_subscription_count() == 0, "it has left")
    at_box = "{},{},{},{}".format(*read_tracks(memory)["square"][-1].box)
    start(*(f"targets:={name}:{at_box}" for name in given_again))
    detections = track(frames[BEFORE_RESTART:])
    assert {item.class_id for item in detections} == {"person" if of_class else "square"}
    proportions = [item.box.w / item.box.h for item in detections]
    assert len(detections) == len(frames) - BEFORE_RESTART
    assert (max(proportions) - min(proportions) < 1e-6) == is_upright


@pytest.mark.parametrize(("person", "is_upright"), [(0.7, True), (0.1, False)])
def test_a_box_whose_best_class_is_a_person_is_followed_upright(bench, person, is_upright):
    bench.listen("/tracker/detections", Detection2DArray)
    bench.start("tracker", ros=("-p", "contours.refine_gain:=0.0"))
    targets = bench.node.create_publisher(Detection2DArray, "/tracker/targets", FRAME_QOS)
    images = bench.node.create_publisher(Image, "/accumulator/frames", FRAME_QOS)
    for publisher in (targets, images):
        bench.wait_until(lambda publisher=publisher: publisher.get_subscription_count() == 1, "it is read")
    box, frames = frames_of_turning_square()
    targets.publish(Detection2DArray(detections=[of_classes("square", box, car=0.2, Person=person)]))
    bench.wait_until(lambda: bench.figure("tracker", "targets") == "1", "the box is taken")
    # What starts it again says nothing of its class.
    targets.publish(Detection2DArray(detections=[of_classes("square", box)]))
    assert bench.next_figure("tracker", "targets") == bench.next_figure("tracker", "targets") == "1"
    found = bench.messages["/tracker/detections"]
    for number, frame in enumerate(frames, 1):
        images.publish(encode_image(frame.data, stamp_ns=frame.stamp_ns, frame_id="camera"))
        bench.wait_until(lambda number=number: len(found) == number, "the frame is tracked")
    detections = [item for message in found for item in decode_detections(message).detections]
    assert {item.class_id for item in detections} == {"Person" if is_upright else "car"}
    boxes = [item.box for item in detections]
    proportions = [box.w / box.h for box in boxes]
    assert len(boxes) == len(frames)
    assert (max(proportions) - min(proportions) < 1e-6) == is_upright
