"""What the nodes log to the Rerun viewer, and the overlay for the other ones."""

import socket

from rerun_files import logged
from sensor_msgs.msg import Image
from vision_msgs.msg import Detection2DArray

from msg_adapters import Layout, decode_detections, decode_image

EVENTS = ("-r", "~/events:=/event_camera/events")


def frames_tracked(bench, name: str) -> int:
    return int(bench.figure(name, "frames tracked") or 0)


def test_pipeline_logs_its_boxes_though_nobody_else_reads_any(bench, repository, tmp_path):
    bag, file = repository / "bags" / "demo", tmp_path / "log.rrd"
    targets = ("-p", f"targets_file:={bag / 'boxes.csv'}")
    bench.start("pipeline", ros=(*EVENTS, *targets, "-p", f"rerun:={file}"))
    bench.start("replay", str(bag), "--rate", "2", "--wait-for", "1")
    bench.wait_until(lambda: frames_tracked(bench, "pipeline") > 300, "frames are tracked")
    assert not file.exists()
    assert bench.end("pipeline") == 0
    found = logged(file)
    boxes = [row for _, row in found["boxes"] if row["labels" if "labels" in row else "text"]]
    assert len(found["boxes"]) > 100
    assert boxes
    assert len(found["nzge"]) == len(found["boxes"]) == len(found["scores/ball"])
    assert 3 <= len(found["events"]) < len(found["boxes"])
    assert [path.name for path in tmp_path.iterdir() if "rrd" in path.name] == ["log.rrd"]


def test_a_viewer_that_never_answers_keeps_no_node_from_its_end(bench, repository):
    bag = repository / "bags" / "demo"
    with socket.create_server(("127.0.0.1", 0)) as viewer:
        address = f"rerun+http://127.0.0.1:{viewer.getsockname()[1]}/proxy"
        bench.start("pipeline", ros=(*EVENTS, "-p", f"targets_file:={bag / 'boxes.csv'}", "-p", f"rerun:={address}"))
        bench.start("replay", str(bag), "--loop", "--wait-for", "1")
        bench.wait_until(lambda: frames_tracked(bench, "pipeline") > 300, "frames are tracked")
        assert bench.end("pipeline") == 0


def test_a_log_that_cannot_be_written_is_one_line(bench):
    process = bench.start("pipeline", ros=("-p", "rerun:=/missing/log.rrd"))
    assert process.wait(timeout=60) == 2
    (line,) = bench.log("pipeline").splitlines()
    assert "/missing/log.rrd" in line


def test_overlays_are_fewer_than_frames_and_show_frame_and_image_side_by_side(bench, repository):
    bag = repository / "bags" / "demo"
    bench.listen("/pipeline/detections", Detection2DArray)
    bench.listen("/pipeline/overlay", Image)
    bench.start("pipeline", ros=(*EVENTS, "-p", f"targets_file:={bag / 'boxes.csv'}"))
    bench.start("replay", str(bag), "--wait-for", "1")
    boxes, overlays = bench.messages["/pipeline/detections"], bench.messages["/pipeline/overlay"]
    bench.wait_until(lambda: len(boxes) > 400, "frames are tracked")
    assert 0 < len(overlays) < len(boxes) / 3
    stamps = {decode_detections(message).stamp_ns for message in boxes}
    last = decode_image(overlays[-1], Layout.ROS2)
    assert last.stamp_ns in stamps
    assert last.encoding == "bgr8"
    assert last.data.shape == (388, 960, 3)
