"""Nodes are configured, activated, deactivated and cleaned up by whoever manages them, or by themselves."""

import subprocess
import sys

import pytest
from conftest import Bench
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from sensor_msgs.msg import Image
from vision_msgs.msg import Detection2DArray

from etd_ros.nodes.connections import FRAME_QOS
from msg_adapters import decode_detections

EVENTS = "/event_camera/events"
REMAP = ("-r", f"~/events:={EVENTS}")
BY_HAND = ("-p", "autostart:=false")
SLOW = "0.2"
"""A pace at which the recording goes on after a pause, on a busy machine, too."""


def phase(bench: Bench, node: str) -> str:
    return bench.figure(node, "life cycle")


@pytest.mark.parametrize("name", ["accumulator", "reconstruction", "tracker", "pipeline"])
def test_a_node_goes_through_its_life_cycle_and_back_and_ends(bench, name):
    process = bench.start(name, ros=BY_HAND)
    bench.wait_until(lambda: phase(bench, name) == "unconfigured", "the node is there")
    assert bench.figure(name, "level") == "STALE"
    for _ in range(2):
        assert bench.change_state(name, "configure", "activate")
        bench.wait_until(lambda: phase(bench, name) == "active", "it is active")
        assert bench.change_state(name, "deactivate", "activate", "deactivate", "cleanup")
        bench.wait_until(lambda: phase(bench, name) == "unconfigured", "it is as at the start")
    assert bench.change_state(name, "configure")
    assert bench.change_state(name, "shutdown")
    assert process.wait(timeout=60) == 0
    assert "Traceback" not in bench.log(name)


@pytest.mark.parametrize("name", ["accumulator", "reconstruction", "tracker", "pipeline"])
def test_a_transition_that_cannot_be_is_refused_and_the_node_goes_on(bench, name):
    bench.start(name)
    bench.wait_until(lambda: phase(bench, name) == "active", "it is active")
    numbers = [
        Transition(id=number) for number in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE, 200)
    ]
    labels = [Transition(label=label) for label in ("activate", "fly")]
    for transition in (*labels, *numbers):
        request = ChangeState.Request(transition=transition)
        assert not bench.call(ChangeState, f"/{name}/change_state", request).success
    assert "transition 1 is refused: the node is active" in bench.log(name)
    assert "transition activate is refused: the node is active (from here it takes deactivate, " in bench.log(name)
    bench.wait_until(lambda: bench.figure(name, "errors") == "5", "the five are counted")
    assert bench.change_state(name, "deactivate", "activate")
    bench.wait_until(lambda: phase(bench, name) == "active", "it goes on")


def test_a_node_serves_its_topics_only_while_it_is_active(bench):
    bench.start("pipeline", ros=BY_HAND)
    targets = bench.node.create_publisher(Detection2DArray, "/pipeline/targets", FRAME_QOS)
    bench.wait_until(lambda: phase(bench, "pipeline") == "unconfigured", "the node is there")
    assert targets.get_subscription_count() == 0
    assert bench.change_state("pipeline", "configure", "activate")
    bench.wait_until(lambda: targets.get_subscription_count() == 1, "targets are taken")
    assert bench.change_state("pipeline", "deactivate")
    bench.wait_until(lambda: targets.get_subscription_count() == 0, "targets are not taken any more")
    assert bench.node.count_publishers("/pipeline/detections") == 1
    assert bench.change_state("pipeline", "cleanup")
    bench.wait_until(lambda: bench.node.count_publishers("/pipeline/detections") == 0, "its publishers are gone")


def test_wrong_parameters_are_refused_when_it_is_configured_and_may_be_mended(bench, tmp_path):
    bench.start("tracker", ros=(*BY_HAND, "-p", f"targets_file:={tmp_path / 'nowhere.csv'}"))
    bench.wait_until(lambda: phase(bench, "tracker") == "unconfigured", "the node is there")
    assert not bench.change_state("tracker", "configure")
    assert "nowhere.csv" in bench.log("tracker")
    assert bench.set_parameter("tracker", "targets_file", "") == (True, "")
    assert bench.change_state("tracker", "configure", "activate")


def said_by(program):
    """What a program of its own says on the way to its good end."""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stderr


@pytest.mark.parametrize("error", ["EtdError", "ValueError"])
@pytest.mark.parametrize("fails", ["configure", "activate"])
def test_a_transition_that_fails_leaves_nothing_behind(fails, error):
    program = f"""
import threading
import rclpy
from rclpy.lifecycle import TransitionCallbackReturn
from std_msgs.msg import String
from etd_ros.errors import EtdError
from etd_ros.nodes.base import EtdNode
from etd_ros.nodes.node_parameters import NodeOptions

class Failing(EtdNode):
    def {fails}(self):
        self.create_publisher(String, "~/left", 1)
        raise {error}("on purpose")

rclpy.init()
node = Failing("failing", (), NodeOptions)
threads, publishers = threading.active_count(), len(list(node.publishers))
results = [node.trigger_configure()]
if "{fails}" == "activate":
    results.append(node.trigger_activate())
assert results[-1] != TransitionCallbackReturn.SUCCESS
assert len(list(node.publishers)) == publishers, "a publisher is left"
assert threading.active_count() == threads, "a thread is left"
node.stop()
node.destroy_node()
rclpy.shutdown()
"""
    assert "on purpose" in said_by(program)


def test_a_pipeline_that_cannot_begin_to_read_leaves_no_thread_behind():
    program = """
import threading
import rclpy
from etd_ros.errors import EtdError
from etd_ros.nodes.event_input import EventInput
from etd_ros.nodes.pipeline import Pipeline

def fail(self):
    raise EtdError("on purpose")

EventInput.open = fail
rclpy.init()
node = Pipeline()
node.trigger_configure()
threads = threading.active_count()
node.trigger_activate()
assert threading.active_count() == threads, "a thread is left"
node.stop()
node.destroy_node()
rclpy.shutdown()
"""
    assert "on purpose" in said_by(program)


def test_targets_are_kept_over_a_pause(bench, repository):
    boxes: list[set[str]] = []
    bench.listen(
        "/pipeline/detections",
        Detection2DArray,
        lambda message: boxes.append({found.id for found in decode_detections(message).detections}),
    )
    truth = repository / "bags" / "demo" / "boxes.csv"
    bench.start("pipeline", ros=(*REMAP, "-p", f"targets_file:={truth}"))
    bench.start("replay", str(repository / "bags" / "demo"), "--wait-for", "1", "--rate", SLOW)
    bench.wait_until(lambda: {"ball", "drum"} in boxes or {"ball", "drum", "tin"} in boxes, "there are boxes")
    assert bench.change_state("pipeline", "deactivate")
    boxes.clear()
    assert bench.change_state("pipeline", "activate")
    bench.wait_until(lambda: any({"ball", "drum"} <= found for found in boxes), "the same targets have boxes again")
    assert bench.next_figure("pipeline", "errors") == "0"


def test_frames_come_again_after_a_pause(bench, repository):
    bench.listen("/accumulator/frames", Image)
    bench.start("accumulator", ros=REMAP)
    bench.start("replay", str(repository / "bags" / "demo"), "--wait-for", "1", "--rate", SLOW)
    frames = bench.messages["/accumulator/frames"]
    bench.wait_until(lambda: len(frames) > 20, "frames come")
    assert bench.change_state("accumulator", "deactivate")
    frames.clear()
    assert bench.change_state("accumulator", "activate")
    bench.wait_until(lambda: len(frames) > 20, "frames come again")
    assert bench.next_figure("accumulator", "stream restarts") == "1"
    log = bench.log("accumulator")
    assert "the event stream starts anew: nobody read for a while" in log
    assert "messages were lost" not in log
