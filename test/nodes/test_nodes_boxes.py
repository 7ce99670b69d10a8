"""The live nodes give the boxes that `track` gives."""

from pathlib import Path

import pytest
from conftest import Bench
from diagnostic_msgs.msg import DiagnosticArray
from vision_msgs.msg import Detection2DArray

from etd_ros.cli import main
from etd_ros.evaluation import read_tracks
from etd_ros.tracking import method_named
from msg_adapters import decode_detections, decode_diagnostics

EVENTS = "/event_camera/events"

Boxes = dict[tuple[str, int], tuple[float, ...] | None]


def offline_boxes(recording: Path, truth: Path, output: Path, method: str, *options: str) -> Boxes:
    command = ["track", str(recording), "--targets", str(truth), "--output", str(output), "--method", method]
    assert main([*command, *options]) == 0
    rows = [row for rows in read_tracks(output).values() for row in rows]
    return {(row.target, row.stamp_ns): row.box and tuple(row.box) for row in rows}


def live_boxes(detections: list[bytes], states: list[bytes]) -> Boxes:
    boxes: Boxes = {}
    for message in map(decode_diagnostics, states):
        boxes |= {(dict(status.values)["target"], message.stamp_ns): None for status in message.statuses}
    for message in map(decode_detections, detections):
        boxes |= {(item.id, message.stamp_ns): tuple(item.box) for item in message.detections}
    return boxes


def assert_same_boxes(live: Boxes, offline: Boxes) -> None:
    assert live.keys() == offline.keys()
    for key, box in offline.items():
        assert (live[key] is None) == (box is None), key
        assert box is None or live[key] == pytest.approx(box, abs=1e-6), key


@pytest.mark.parametrize("method", ["etd-plus", "etd", "etd-nr"])
def test_three_nodes_over_dds_give_the_offline_boxes_of_the_demo_recording(bench, repository, tmp_path, method):
    recording, truth = repository / "bags" / "demo", repository / "bags" / "demo" / "boxes.csv"
    expected = offline_boxes(recording, truth, tmp_path / "tracks.csv", method)
    remap = ("-r", f"~/events:={EVENTS}")
    chosen = method_named(method)
    bench.listen("/tracker/detections", Detection2DArray)
    bench.listen("/tracker/status", DiagnosticArray)
    bench.start("accumulator", ros=(*remap, "-p", f"conversion:={chosen.conversion}"))
    bench.start("reconstruction", ros=(*remap, "-p", f"image_interval_s:={chosen.image_interval_s}"))
    bench.start("tracker", ros=("-p", f"targets_file:={truth}", "-p", f"method:={method}", "-p", "image_wait_s:=30.0"))
    linked = {"accumulator": "2", "reconstruction": "0" if method == "etd-nr" else "1"}
    bench.wait_until(
        lambda: (
            bench.figure("accumulator", "frame subscribers") == linked["accumulator"]
            and bench.figure("reconstruction", "image subscribers") == linked["reconstruction"]
        ),
        "the nodes are linked",
    )
    replay = bench.start("replay", str(recording), "--rate", "0.5", "--wait-for", "1" if method == "etd-nr" else "2")
    stamps = {stamp for _, stamp in expected}
    bench.wait_until(lambda: replay.poll() is not None, "the replay is over")
    bench.wait_until(lambda: len(bench.messages["/tracker/status"]) >= len(stamps), "every frame is tracked")
    assert_same_boxes(live_boxes(bench.messages["/tracker/detections"], bench.messages["/tracker/status"]), expected)


def assert_pipeline_gives(expected: Boxes, bench: Bench, recording: Path, truth: Path, *parameters: str) -> None:
    """Replay a recording to a pipeline, until it has said as much."""
    bench.listen("/pipeline/detections", Detection2DArray)
    bench.listen("/pipeline/status", DiagnosticArray)
    assignments = [word for parameter in (f"targets_file:={truth}", *parameters) for word in ("-p", parameter)]
    bench.start("pipeline", ros=("-r", f"~/events:={EVENTS}", *assignments))
    replay = bench.start("replay", str(recording))
    bench.wait_until(lambda: replay.poll() is not None, "the replay is over")
    stamps = {stamp for _, stamp in expected}
    bench.wait_until(lambda: len(bench.messages["/pipeline/status"]) >= len(stamps), "every frame is tracked")
    assert_same_boxes(live_boxes(bench.messages["/pipeline/detections"], bench.messages["/pipeline/status"]), expected)


@pytest.mark.parametrize("region", ["sensor", "targets"])
@pytest.mark.parametrize("method", ["etd-plus", "etd"])
def test_the_pipeline_gives_the_offline_boxes_of_a_real_recording(bench, data, tmp_path, method, region):
    recording, truth = data / "traffic" / "traffic.mcap", data / "traffic" / "boxes.csv"
    entropy_region = ("--set", f"atsltd.entropy_region={region}")
    expected = offline_boxes(recording, truth, tmp_path / "tracks.csv", method, *entropy_region)
    parameters = (f"method:={method}", f"atsltd.entropy_region:={region}")
    assert_pipeline_gives(expected, bench, recording, truth, *parameters)


def test_the_pipeline_gives_the_offline_boxes_of_a_target_that_is_so_fast_that_its_frames_are_shorter(bench, tmp_path):
    recording = tmp_path / "whirl"
    assert main(["simulate", "whirl", "--output", str(recording)]) == 0
    truth = recording / "boxes.csv"
    expected = offline_boxes(recording, truth, tmp_path / "tracks.csv", "etd-plus")
    no_limit = offline_boxes(recording, truth, tmp_path / "no.csv", "etd-plus", "--set", "contours.frame_motion=100")
    assert len(expected) > len(no_limit)
    assert_pipeline_gives(expected, bench, recording, truth)
