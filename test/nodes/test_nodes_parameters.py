"""Parameters change while the nodes run where that makes sense, and are refused with a reason where not."""

import pytest
from sensor_msgs.msg import Image

from msg_adapters import decode_image

EVENTS = "/event_camera/events"
REMAP = ("-r", f"~/events:={EVENTS}")


def test_the_length_of_frames_changes_while_they_come(bench, repository):
    stamps: list[int] = []
    bench.listen("/accumulator/frames", Image, lambda message: stamps.append(decode_image(message).stamp_ns))
    bench.start("accumulator", ros=(*REMAP, "-p", "conversion:=fixed_window"))
    bench.start("replay", str(repository / "bags" / "demo"), "--wait-for", "1", "--rate", "0.2")
    bench.wait_until(lambda: len(stamps) > 20, "frames come")
    assert stamps[11] - stamps[10] == 9_000_000
    assert bench.set_parameter("accumulator", "fixed_window.window_s", 0.02) == (True, "")
    stamps.clear()
    bench.wait_until(lambda: len(stamps) > 20, "frames go on")
    assert stamps[20] - stamps[19] == 20_000_000


REFUSED = {
    "accumulator": [
        ("conversion", "fixed_window", "deactivate"),
        ("atsltd.entropy_region", "targets", "deactivate"),
        ("atsltd.nzge_interval", [0.5, 0.1], "alpha <= beta"),
        ("atsltd.max_duration_s", -1.0, "max_duration_s"),
        ("queue_s", "long", "DOUBLE"),
    ],
    "pipeline": [("method", "etd", "deactivate"), ("targets", "ball:1,2,3,4", "deactivate")],
    "tracker": [("memory_file", "/tmp/memory.csv", "deactivate")],
}


@pytest.mark.parametrize("node", REFUSED)
def test_what_cannot_change_is_refused_with_a_reason(bench, node):
    bench.start(node)
    bench.wait_until(lambda: bench.figure(node, "life cycle") == "active", "the node runs")
    for name, value, reason in REFUSED[node]:
        succeeded, why = bench.set_parameter(node, name, value)
        assert not succeeded
        assert reason in why


def test_the_values_that_it_has_already_may_be_set_again_and_others_later(bench):
    bench.start("tracker")
    bench.wait_until(lambda: bench.figure("tracker", "life cycle") == "active", "the node runs")
    assert bench.set_parameter("tracker", "method", "etd-plus") == (True, "")
    assert bench.set_parameter("tracker", "queue_mib", 2.0) == (True, "")
    assert bench.set_parameter("tracker", "queue_s", 0.5) == (True, "")
    assert bench.set_parameter("tracker", "tracking.failure_iou", 0.4) == (True, "")
    bench.wait_until(lambda: "tracking.failure_iou: holds" in bench.log("tracker"), "it says when that holds")


@pytest.mark.parametrize("node", ["tracker", "pipeline"])
def test_what_cannot_be_is_refused_before_the_node_is_configured_too(bench, node, tmp_path):
    bench.start(node, ros=("-p", "autostart:=false"))
    bench.wait_until(lambda: bench.figure(node, "life cycle") == "unconfigured", "the node is there")
    for name, value, reason in (
        ("targets", "bad", "'bad' is not NAME:X,Y,W,H"),
        ("targets", "ball:1,2,3,4;ball:1,2,3,4", "given twice"),
        ("targets", "ball:1,2,3,4;dot:10,10,0.5,0.5", "box of target 'dot' (x 10, y 10, w 0.5, h 0.5) is too small"),
        ("method", "best", "choose one of"),
        ("image_wait_s" if node == "tracker" else "queue_s", -1.0, "range"),
    ):
        succeeded, why = bench.set_parameter(node, name, value)
        assert not succeeded, name
        assert reason in why
    assert bench.set_parameter(node, "targets", "ball:1,2,3,4@5;drum:5,6,7,8") == (True, "")
    assert bench.set_parameter(node, "targets_file", str(tmp_path / "later.csv")) == (True, "")
    assert not bench.change_state(node, "configure")
    assert "later.csv" in bench.log(node)


@pytest.mark.parametrize(
    ("targets", "reason"),
    [
        ("bad", "'bad' is not NAME:X,Y,W,H"),
        ("ball:nan,1,2,3", "box of target 'ball' (x nan, y 1, w 2, h 3) is not finite"),
        ("ball:10,10,30,30;flat:10,10,30,0", "box of target 'flat' (x 10, y 10, w 30, h 0) has no area"),
        ("a,b:10,10,30,30", "target name 'a,b' is unusable"),
    ],
)
def test_targets_that_cannot_be_end_the_start_with_one_line(bench, targets, reason):
    assert bench.start("tracker", ros=("-p", f"targets:={targets}")).wait(timeout=60) == 2
    (line,) = [line for line in bench.log("tracker").splitlines() if line.startswith("etd_ros:")]
    assert reason in line


def test_a_list_may_be_empty_if_it_may_have_any_length(bench):
    bench.start("pipeline", ros=("-p", "contours.person_classes:=[]"))
    bench.wait_until(lambda: bench.figure("pipeline", "life cycle") == "active", "it runs without classes of people")


def test_a_list_of_so_many_numbers_may_not_be_empty(bench):
    assert bench.start("pipeline", ros=("-p", "atsltd.nzge_interval:=[]")).wait(timeout=60) == 2
    (line,) = [line for line in bench.log("pipeline").splitlines() if line.startswith("etd_ros:")]
    assert "atsltd: parameter nzge_interval needs a list of 2 numbers" in line
