"""What cameras, networks and clocks do to a stream, and that boxes go on being right."""

import dataclasses
import random

import numpy as np
import pytest
from camera import Camera, Shot, shots_of
from conftest import Bench

from etd_ros.benchmarking.encoders import event_packet, libcaer_cmp_payload
from etd_ros.events import Events
from msg_adapters import encode_event_packet

REMAP = ("-r", "~/events:=/event_camera/events")
HOUR_NS = 3_600_000_000_000
S_NS = 1_000_000_000
FIRST_NS = 1_700_000_000 * S_NS


@pytest.fixture
def truth(repository):
    return repository / "bags" / "demo" / "boxes.csv"


@pytest.fixture
def shots(repository):
    return shots_of(repository / "bags" / "demo")


@pytest.fixture
def camera(bench: Bench, truth):
    """Beside a pipeline that tracks the demo's ball and drum from the first frame on."""
    return camera_beside_pipeline(bench)


def camera_beside_pipeline(bench: Bench, at: str = "") -> Camera:
    """The same, whose targets may start at a stamp (`@STAMP_NS`)."""
    made = Camera(bench, "/pipeline/detections")
    targets = f"ball:64.866,34.762,40,40{at};drum:139.382,47.099,46,36{at}"
    bench.start("pipeline", ros=(*REMAP, "-p", f"targets:={targets}"))
    made.wait_for_readers()
    return made


def assert_right(camera: Camera, truth, since_s: float, until_s: float, shift_ns: int = 0) -> None:
    """Both targets' boxes agree with the truth in a part of the recording (s from its start)."""
    times = FIRST_NS + int(since_s * S_NS), FIRST_NS + int(until_s * S_NS)
    for name in ("ball", "drum"):
        assert camera.overlap(truth, name, *times, shift_ns) > 0.7, name


def counted(bench: Bench, key: str) -> int:
    return int(bench.figure("pipeline", key) or 0)


@pytest.mark.parametrize("share", [0.01, 0.1, 0.5])
def test_lost_messages_are_counted_and_the_boxes_stay_right(bench, camera, shots, truth, share):
    rng = random.Random(1)
    kept = [shot for shot in shots[10:250] if rng.random() >= share]
    camera.play(kept)
    lost = kept[-1].seq - kept[0].seq + 1 - len(kept)
    bench.wait_until(lambda: counted(bench, "lost messages") == lost, "the losses are counted")
    assert_right(camera, truth, 1.5, 2.4)
    assert bench.next_figure("pipeline", "errors") == "0"


@pytest.mark.parametrize("share", [0.01, 0.1, 0.5])
def test_messages_that_come_twice_do_no_harm(bench, camera, shots, truth, share):
    rng = random.Random(2)
    camera.play(copy for shot in shots[10:250] for copy in [shot] * (1 + (shot.seq == 40 or rng.random() < share)))
    assert_right(camera, truth, 1.5, 2.4)
    bench.wait_until(lambda: counted(bench, "sequence gaps") > 0, "they are counted")
    assert bench.next_figure("pipeline", "errors") == "0"


@pytest.mark.parametrize("share", [0.01, 0.1, 0.5])
def test_messages_out_of_order_do_no_harm(bench, camera, shots, truth, share):
    rng = random.Random(3)
    order = shots[10:250]
    for at in range(0, len(order) - 1, 2):
        if at == 40 or rng.random() < share:
            order[at], order[at + 1] = order[at + 1], order[at]
    camera.play(order)
    assert_right(camera, truth, 1.5, 2.4)
    bench.wait_until(lambda: counted(bench, "sequence gaps") > 0, "they are counted")


@pytest.mark.parametrize("step_ns", [-S_NS, S_NS, HOUR_NS, -HOUR_NS], ids=["1s_back", "1s_on", "1h_on", "1h_back"])
def test_a_step_of_the_clock_moves_no_target(bench, camera, shots, truth, step_ns):
    camera.play(shots[10:120])
    camera.boxes.clear()
    camera.play(dataclasses.replace(shot, shift_ns=step_ns) for shot in shots[120:250])
    assert_right(camera, truth, 1.5, 2.4, step_ns)
    bench.wait_until(lambda: bench.figure("pipeline", "state of ball") == "tracking", "the ball is still tracked")
    bench.wait_until(lambda: counted(bench, "steps back in time") == (step_ns < 0), "the step is counted")


@pytest.mark.parametrize("shift_ns", [-2 * S_NS, -FIRST_NS], ids=["2s_back", "0"])
def test_a_single_message_with_a_wrong_stamp_moves_no_target(bench, shots, truth, shift_ns):
    camera = camera_beside_pipeline(bench, f"@{FIRST_NS + S_NS // 10}")
    camera.play(shots[10:120])
    camera.play([dataclasses.replace(shots[120], shift_ns=shift_ns), *shots[121:250]])
    assert_right(camera, truth, 1.3, 2.4)
    bench.wait_until(lambda: counted(bench, "steps back in time") == 1, "the step is counted")


def test_a_driver_that_starts_again_counts_from_0_and_the_targets_go_on(bench, camera, shots, truth):
    camera.play(shots[10:120])
    camera.play(dataclasses.replace(shot, seq=shot.seq - 125) for shot in shots[125:250])
    assert_right(camera, truth, 1.6, 2.4)
    bench.wait_until(lambda: counted(bench, "sequence gaps") == 1, "the new start is counted")


def test_another_sensor_and_back_again_starts_the_targets_anew(bench, camera, shots, truth):
    camera.play(shots[10:60])
    times = np.linspace(shots[60].events.t[0], shots[60].events.t[0] + 50_000_000, 2000).astype(np.int64)
    other = Events(times, *(np.zeros(len(times), kind) for kind in ("u2", "u2", "u1")), 346, 260)
    camera.send(encode_event_packet(other, stamp_ns=int(times[0]), frame_id="camera", seq=60))
    bench.wait_until(lambda: camera.latest_ns > times[0] + 20_000_000, "the other sensor's frames come")
    camera.play(dataclasses.replace(shot, seq=shot.seq + 51, shift_ns=600_000_000) for shot in shots[10:120])
    bench.wait_until(lambda: counted(bench, "stream restarts") == 2, "the first one is back")
    assert_right(camera, truth, 0.5, 1.1, 600_000_000)


def test_another_encoding_between_two_messages_starts_a_new_stream_and_the_targets_go_on(bench, camera, shots, truth):
    def compressed(shot: Shot) -> bytes:
        base_ns = int(shot.events.t[0])
        payload = libcaer_cmp_payload(shot.events, base_ns)
        return event_packet(shot.events, "libcaer_cmp", payload, base_ns, shot.seq)

    camera.play(shots[10:120])
    camera.play(shots[120:250], compressed)
    assert_right(camera, truth, 1.5, 2.4)
    bench.wait_until(lambda: counted(bench, "stream restarts") == 1, "the new stream is counted")
    assert "the encoding changed" in bench.log("pipeline")
    assert (counted(bench, "sequence gaps"), counted(bench, "errors")) == (0, 0)


def test_garbage_cut_and_huge_messages_between_good_ones_are_counted(bench, camera, shots, truth):
    good = shots[60].encoded()
    half = encode_event_packet(shots[60].events, stamp_ns=0, frame_id="camera", seq=60)[: len(good) // 2]
    huge = encode_event_packet(
        Events(
            np.arange(3_000_000, dtype=np.int64) + shots[60].end_ns,
            *(np.zeros(3_000_000, kind) for kind in ("u2", "u2", "u1")),
            65535,
            65535,
        ),
        stamp_ns=0,
        frame_id="camera",
        seq=60,
    )
    camera.play(shots[10:60])
    for message in (half, huge, good[:40], good[:20] + bytes(len(good) - 20)):
        camera.send(message)
    camera.play(shots[61:250])
    bench.wait_until(lambda: counted(bench, "errors") >= 3, "what is wrong is counted")
    assert_right(camera, truth, 1.5, 2.4)
    assert "Traceback" not in bench.log("pipeline")
