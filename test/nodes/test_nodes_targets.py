"""Targets that cannot be started are counted, and the others are tracked."""

import pytest
from std_srvs.srv import Trigger
from vision_msgs.msg import Detection2DArray

from msg_adapters import decode_detections


def test_targets_off_the_sensor_or_too_early_are_counted_and_the_others_are_tracked(bench, repository):
    targets = "far:9000,9000,5,5;flat:10,10,0,5;early:20,20,100,80@5;near:20,20,100,80"
    bench.listen("/pipeline/detections", Detection2DArray)
    bench.start("pipeline", ros=("-r", "~/events:=/event_camera/events", "-p", f"targets:={targets}"))
    bench.start("replay", str(repository / "bags" / "demo"), "--rate", "2")
    bench.wait_until(
        lambda: any(decode_detections(message).detections for message in bench.messages["/pipeline/detections"]),
        "a target is tracked",
    )
    bench.wait_until(lambda: bench.figure("pipeline", "errors") == "3", "the others are counted")
    names = {
        item.id for message in bench.messages["/pipeline/detections"] for item in decode_detections(message).detections
    }
    assert names == {"early", "near"}
    assert bench.figure("pipeline", "targets") == "2"
    assert "internal error" not in bench.log("pipeline")


@pytest.mark.parametrize("name", ["tracker", "pipeline"])
def test_a_node_that_tracks_can_be_reset(bench, name):
    client = bench.node.create_client(Trigger, f"/{name}/reset")
    bench.start(name)
    bench.wait_until(client.service_is_ready, "the service is there")
    answer = client.call_async(Trigger.Request())
    bench.wait_until(answer.done, "the service answers")
    assert answer.result().success
    assert bench.end(name) == 0
